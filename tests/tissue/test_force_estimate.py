"""The estimated error of the force: exact where a quadratic solution can be had, close to the continuum, cheap to ask for."""

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support.brick_meshes import block, brick

import palpate as pp
from palpate.tissue import discretization_error
from palpate.tissue.contact_patches import contacts
from palpate.tissue.discretization_error import DiscretizationError
from palpate.tissue.hierarchical_basis import HierarchicalBasis
from palpate.tissue.reference.linear_elasticity import assembled, basis, lame
from palpate.tissue.smoothed_elements import smoothing_cells

sys.path.append(str(Path(__file__).parents[2]))
from benchmarks.continuum_truth import compliance

RADIUS = 15.0


@pytest.fixture(scope="module")
def irregular():
    mesh = brick((4, 3, 4), (50, 40, 50), warp=0.25)
    return pp.Tissue(mesh, 5.0, 0.3, mesh.nodes[:, 2] == 0)


def hierarchical(tissue):
    lam, mu = lame(tissue.young, tissue.poisson)
    return HierarchicalBasis(tissue, smoothing_cells(tissue.mesh, lam, mu), mu)


def test_the_hierarchical_basis_has_the_energy_of_quadratic_elements(irregular):
    """scikit-fem's unknown at an edge is the value at its middle: the mean of its ends, and one bubble."""
    ours, theirs = hierarchical(irregular), basis(irregular.mesh, "P2")
    K = assembled(theirs, np.zeros(len(irregular.mesh.tets)), ours.mu)
    ends = theirs.mesh.edges.T
    rng = np.random.default_rng(0)
    z, other = (rng.standard_normal((len(ours.held), 3)) for _ in range(2))

    def quadratic(z):
        u = np.zeros(theirs.N)
        u[theirs.nodal_dofs.T] = z[: ours.nodes]
        u[theirs.edge_dofs.T] = z[ends].mean(axis=1) + z[ours.edges(ends)]
        return u

    forces = ours.forces(ours.shear_stress(ours.slopes(z)))
    assert (other * forces).sum() == pytest.approx(quadratic(other) @ K @ quadratic(z), rel=1e-12)


def test_conjugate_gradients_find_the_displacement_under_a_load(irregular):
    ours = hierarchical(irregular)
    z = np.random.default_rng(1).standard_normal((len(ours.held), 3))
    z[ours.held] = 0
    load = ours.forces(ours.shear_stress(ours.slopes(z)))
    np.testing.assert_allclose(ours.solve(load, 500), z, atol=1e-6)


@pytest.mark.parametrize("element", ["smoothed", "P1"])
def test_without_a_pressure_it_converges_to_quadratic_elements(irregular, element, monkeypatch):
    """With ν = 0 the functional is that of the displacement alone, and its maximum the compliance of P2."""
    monkeypatch.setattr(discretization_error, "ITERATIONS", 400)
    monkeypatch.setattr(discretization_error, "SATURATION", 1.0)
    tissue = pp.Tissue(irregular.mesh, 5.0, 0.0, irregular.fixed, element=element)
    point, push = np.array([22.0, 19.0, 50.0]), (0.3, -0.2, -1.0)
    found, answer = contacts(tissue, point, push, RADIUS), pp.finite_elements(tissue).push(point, push, RADIUS)
    told = DiscretizationError(tissue)(answer.displacement, found, -answer.force[None])
    # Under the same forces: the compliance of P2 over that of the element.
    quadratic = pp.finite_elements(tissue, "P2")
    loads = quadratic.loads(found)
    C = loads.T @ quadratic.solve(loads)
    softer = answer.force @ C @ answer.force / -(answer.realised @ answer.force)
    assert abs(softer - 1) > 0.005
    assert told == pytest.approx(softer - 1, rel=2e-3)


@cache
def continuum(poisson):
    return compliance(block(7, poisson=poisson), np.array([22.0, 27.0, 50.0]), RADIUS, levels=3)


@pytest.mark.parametrize("poisson", [0.3, 0.49])
@pytest.mark.parametrize("element", ["smoothed", "P1"])
def test_it_is_near_the_error_against_the_continuum(poisson, element):
    """Within 1 % of the force or half of the error, as promised for 95 of 100 places."""
    tissue, point = block(7, poisson=poisson, element=element), np.array([22.0, 27.0, 50.0])
    C = continuum(poisson)
    model = pp.model(tissue, "compliance")
    for push in np.array([[0, 0, -1.0], [1.0, 0, 0]]):
        answer = model.push(point, push, RADIUS)
        error = (answer.force @ push) / -(np.linalg.solve(C, push) @ push) - 1
        assert answer.estimate.solver == answer.error
        assert abs(answer.estimate.mesh - error) < max(0.01, abs(error) / 2)


def test_a_stiff_lump_is_seen():
    """A lump eight times stiffer under the contact: smoothing cells end at its boundary."""
    mesh = brick((6, 6, 6), region=lambda x: (np.linalg.norm(x - [25, 25, 38], axis=1) < 10).astype(int))
    stiff = np.where(mesh.region == 1, 40.0, 5.0)
    tissue, point = pp.Tissue(mesh, stiff, 0.45, mesh.nodes[:, 2] == 0), np.array([25.0, 25.0, 50.0])
    C = compliance(tissue, point, RADIUS, levels=3)
    answer = pp.model(tissue, "compliance").push(point, (0, 0, -1), RADIUS)
    error = answer.force[2] * C[2, 2] - 1
    assert error > 0.02
    assert abs(answer.estimate.mesh - error) < max(0.01, error / 2)


def test_contacts_at_once_and_points(irregular):
    """Two tools share an estimate, as they share an energy; a tool without extent has a finite one."""
    model = pp.model(irregular, "compliance")
    two = model.push([[12.0, 12, 50], [38.0, 30, 50]], [[0, 0, -1.0], [0, 0, -2.0]], 10.0).estimate
    one = [model.push(x, (0, 0, d), 10.0).estimate for x, d in (([12.0, 12, 50], -1.0), ([38.0, 30, 50], -2.0))]
    assert min(e.mesh for e in one) - 0.02 < two.mesh < max(e.mesh for e in one) + 0.02
    assert np.isfinite(model.push([20.0, 20, 50], (0, 0, -1), 0.0).estimate.mesh)
    assert model.push([20.0, 20, 50], (0, 0, 0), 10.0).estimate.mesh == 0


def test_models_that_are_no_linear_elasticity_have_none(irregular):
    assert pp.model(irregular, "springs").push([20.0, 20, 50], (0, 0, -1), 10.0).estimate is None
    assert pp.model(irregular, "neo-hookean").push([20.0, 20, 50], (0, 0, -1), 10.0).estimate is None


def test_the_models_of_one_equation_agree(irregular):
    point, push = [20.0, 20, 50], (0.5, 0, -1)
    names = ("compliance", "blocks", "multigrid")
    told = [pp.model(irregular, name).push(point, push, 10.0, tolerance=1e-4).estimate.mesh for name in names]
    np.testing.assert_allclose(told, told[0], atol=1e-4)
