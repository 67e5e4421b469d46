"""Boussinesq, Love and Hertz: a disc pressed on a large block sinks as theory says, the better the finer the mesh."""

import numpy as np
import pytest
import skfem
from support.boussinesq import PRESSURE, compliance, displacement, pressure, sinking
from support.brick_meshes import brick

import palpate as pp


def slab(n, size, grading):
    """A block of half-width and depth `size` mm whose top is z = 0, finest at the origin, held all round but there."""
    mesh = brick((n, n, n // 2), (2.0, 2.0, 1.0))
    nodes = size * np.sinh(grading * (mesh.nodes - 1)) / np.sinh(grading)
    inside = (nodes[:, 2] > -size * (1 - 1e-9)) & (np.abs(nodes[:, :2]) < size * (1 - 1e-9)).all(axis=1)
    return pp.Tissue(pp.TetMesh(nodes, mesh.tets), 5.0, 0.3, ~inside)


def pressed(fe, kind, endless):
    """Displacement and compliance mm/N under a pressure. endless: held where theory's half space goes."""
    top = skfem.FacetBasis(
        fe.space.mesh, fe.space.elem, facets=fe.space.mesh.facets_satisfying(lambda x: np.abs(x[2]) < 1e-9), intorder=8
    )
    load = skfem.LinearForm(lambda v, w: -pressure(kind, w.x[0], w.x[1]) * v[2]).assemble(top)
    u = np.zeros(len(load))
    if endless:
        for k in range(3):
            every = np.concatenate([fe.space.nodal_dofs[k], *([fe.space.edge_dofs[k]] if fe.element != "P1" else [])])
            held = np.setdiff1d(every, fe.free)
            u[held] = displacement(kind, fe.space.doflocs[:, held])[k]
    u += fe.solve((load - fe.K @ u)[:, None])[:, 0]
    return u, load @ u / PRESSURE[kind][1] ** 2


def test_the_closed_forms_agree_with_each_other():
    for kind, (_, force, centre) in PRESSURE.items():
        assert sinking(kind, 0.0) == pytest.approx(centre, rel=1e-6)
        deep = np.array([[0.0], [0.0], [-200.0]])  # far off, all pressures are point forces
        assert displacement(kind, deep)[2, 0] == pytest.approx(
            displacement("Love", deep)[2, 0] * force / np.pi, rel=1e-4
        )
    rho = np.linspace(0, 0.99, 5)  # Hertz: a paraboloid
    expected = PRESSURE["Hertz"][2] * (1 - rho**2 / 2)
    np.testing.assert_allclose([sinking("Hertz", r) for r in rho], expected, rtol=1e-5)


@pytest.mark.parametrize(("element", "meshes", "orders", "last"), [
    ("P1", (12, 24), (1.5, 2.1), 0.04), ("P2", (8, 12), (2.8, 4.1), 0.005)
])  # fmt: skip
def test_the_compliance_of_our_contact_converges_to_that_of_the_half_space(element, meshes, orders, last):
    exact = compliance("kernel")
    error = [1 - pressed(pp.finite_elements(slab(n, 2.0, 0.8), element), "kernel", True)[1] / exact for n in meshes]
    assert 0 < error[1] < last  # elements are too stiff
    order = np.log(error[0] / error[1]) / np.log(meshes[1] / meshes[0])
    assert orders[0] < order < orders[1]


@pytest.mark.parametrize("kind", ["Love", "Hertz"])
def test_the_disc_sinks_as_love_and_hertz_say(kind):
    tissue = slab(12, 2.0, 0.8)
    fe = pp.finite_elements(tissue, "P2")
    u, _ = pressed(fe, kind, True)
    x = tissue.mesh.nodes
    under = np.flatnonzero((x[:, 2] == 0) & (np.linalg.norm(x, axis=1) < 0.95))
    assert len(under) > 10
    expected = [sinking(kind, np.linalg.norm(x[i])) for i in under]
    np.testing.assert_allclose(-u[fe.nodal[under, 2]], expected, rtol=0.02)
    centre = np.argmin(np.linalg.norm(x, axis=1))
    assert -u[fe.nodal[centre, 2]] == pytest.approx(PRESSURE[kind][2], rel=0.003)


def test_a_block_twice_as_large_is_half_as_far_from_the_half_space():
    lack = []
    for size, grading in ((5.0, 2.0), (10.0, 2.75), (20.0, 3.45)):  # cells at the disc much alike
        fe = pp.finite_elements(slab(8, size, grading), "P2")
        clamped, endless = (pressed(fe, "kernel", e)[1] for e in (False, True))
        lack.append(1 - clamped / endless)
    assert 0.02 < lack[1] < 0.08
    np.testing.assert_allclose(np.log2(np.array(lack[:-1]) / lack[1:]), 1, atol=0.15)
