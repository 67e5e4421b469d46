"""The compliance of a cut body from the factors of the whole one."""

import numpy as np
import pytest
from fuzz import cut_forces
from support.brick_meshes import brick

import palpate as pp
from palpate.tissue.contact_patches import contacts
from palpate.tissue.cut_compliance import CutCompliance

PUSH = (12.0, 25.0, 50.0), (0.5, 0.2, -2.0), 9.0


def plane(x, depth):
    """A blade in the plane x, from above the 50 mm cube down to z = 50 - depth."""
    return pp.Blade.swept([(x, -5, 55), (x, 55, 55)], (0, 0, -1), 5 + depth)


def cube(element="smoothed", held=lambda x: x[:, 2] == 0):
    mesh = brick((4, 4, 4), warp=0.3)
    return pp.Tissue(mesh, 5.0, 0.45, held(mesh.nodes), element=element)


def test_a_sample_of_random_cuts():
    """Against factorisations of the cut mesh from scratch, whose stiffness the tests assemble."""
    found = cut_forces.run(4, seed=3, kidney=False)
    rows = np.array([row for some in found.values() for row in some])
    assert rows[:, :2].max() < 1e-9
    assert rows[:, 2].min() > 0


@pytest.mark.parametrize("element", ["smoothed", "P1"])
def test_both_elements_and_a_cut_all_the_way(element):
    whole = cube(element)
    model = pp.model(whole, "compliance")
    for depth in (28.0, 60.0):
        opened = pp.cut(whole, plane(23.0, depth))
        update = CutCompliance(model, opened)
        mine, other = update.push(*PUSH), pp.model(opened, "compliance", contact=False).push(*PUSH)
        assert np.allclose(mine.force, other.force, rtol=1e-10)
        assert np.abs(mine.displacement - other.displacement).max() < 1e-10 * np.abs(other.displacement).max()
        if element == "P1":
            assert update.unknowns == 3 * len(update.copies)


def test_the_other_half_does_not_move():
    whole = cube()
    through = pp.cut(whole, plane(23.0, 60.0))
    answer = CutCompliance(pp.model(whole, "compliance"), through).push(*PUSH)
    x = through.mesh.nodes[through.mesh.tets].mean(axis=1)[:, 0]
    far = np.unique(through.mesh.tets[through.mesh.body != through.mesh.body[np.argmin(x)]])
    assert np.abs(answer.displacement).max() > 1
    assert np.abs(answer.displacement[far]).max() < 1e-12


def test_several_contacts():
    whole = cube()
    opened = pp.cut(whole, plane(23.0, 28.0))
    two = [(12, 25, 50), (38, 20, 50)], [(0, 0, -1), (0.3, 0, -0.5)], 8.0
    mine = CutCompliance(pp.model(whole, "compliance"), opened).push(*two)
    other = pp.model(opened, "compliance", contact=False).push(*two)
    assert np.allclose(mine.force, other.force, rtol=1e-10)
    C = CutCompliance(pp.model(whole, "compliance"), opened).compliance(contacts(opened, *two))
    assert np.array_equal(C, C.T)
    assert np.linalg.eigvalsh(C)[0] > 0


def test_a_blade_that_meets_nothing():
    whole = cube()
    update = CutCompliance(pp.model(whole, "compliance"), pp.cut(whole, plane(70.0, 28.0)))
    assert update.unknowns == 0
    assert np.allclose(update.push(*PUSH).force, pp.model(whole, "compliance").push(*PUSH).force, rtol=1e-12)


def test_another_tissue_is_refused():
    whole = cube()
    opened = pp.cut(whole, plane(23.0, 28.0))
    model = pp.model(whole, "compliance")
    with pytest.raises(pp.errors.DataError, match="before the cut"):
        CutCompliance(model, whole)
    with pytest.raises(pp.errors.DataError, match="before the cut"):
        CutCompliance(pp.model(opened, "compliance"), opened)
    other = brick((5, 4, 4))
    with pytest.raises(pp.errors.DataError, match="another tissue"):
        CutCompliance(pp.model(pp.Tissue(other, 5.0, 0.45, other.nodes[:, 2] == 0), "compliance"), opened)
