"""How far a cut opens under a tension at rest."""

import numpy as np
import pytest
from scipy.sparse.linalg import splu
from support.brick_meshes import brick
from support.cut_stiffness import stiffness

import palpate as pp


def plane(x, depth):
    """A blade in the plane x, from above the 50 mm cube down to z = 50 - depth."""
    return pp.Blade.swept([(x, -5, 55), (x, 55, 55)], (0, 0, -1), 5 + depth)


@pytest.fixture(scope="module")
def slot():
    """The cube cut between its elements, to the middle."""
    mesh = brick((6, 6, 6))
    return pp.cut(pp.Tissue(mesh, 5.0, 0.45, mesh.nodes[:, 2] == 0), plane(25.0, 25.0))


def test_traction_on_the_faces_of_the_cut(slot):
    """Against a solution whose loads are put on the nodes of the cut plane by hand."""
    mesh = slot.mesh
    beyond = mesh.nodes[mesh.tets].mean(axis=1)[:, 0] > 25
    load = np.zeros((len(mesh.nodes), 3))
    for tet, right in zip(mesh.tets, beyond, strict=True):
        face = tet[np.isclose(mesh.nodes[tet, 0], 25)]
        if len(face) == 3 and mesh.nodes[face, 2].min() > 24:  # of an element whose face the blade passed
            a, b, c = mesh.nodes[face]
            load[face, 0] += (1 if right else -1) * 2e-3 * np.linalg.norm(np.cross(b - a, c - a)) / 6
    K = stiffness(mesh, slot.young, slot.poisson)
    free = np.flatnonzero(np.repeat(~slot.held, 3))
    u = np.zeros(load.size)
    u[free] = splu(K[free][:, free]).solve(load.ravel()[free])
    gaping = pp.gape(slot, tension=2.0)
    assert np.abs(gaping.ravel() - u).max() < 1e-10 * np.abs(u).max()
    assert np.abs(load).sum() > 2


def test_lips_draw_back(slot):
    skin, mesh = slot.mesh.skin, slot.mesh
    mouth = np.unique(skin.triangles[skin.lip])
    mouth = mouth[mesh.places[mouth, 2] > 49]
    outwards = np.sign(mesh.nodes[mesh.tets[skin.tet[mouth]]].mean(axis=1)[:, 0] - 25)
    moved = skin.carried(mesh.tets, pp.gape(slot, 1.0))[mouth, 0] * outwards
    assert set(outwards) == {-1, 1}
    assert moved.min() > 0.1
    assert np.allclose(pp.gape(slot, 3.0), 3 * pp.gape(slot, 1.0))
    assert not pp.gape(slot, 0.0).any()


def test_a_tension_of_a_region_pulls_there_alone(slot):
    with pytest.raises(pp.errors.MaterialError, match="no region"):
        pp.gape(slot, {7: 1.0})
    assert np.array_equal(pp.gape(slot, {1: 1.0}), pp.gape(slot, 1.0))


def test_what_cannot_gape_is_refused(slot):
    with pytest.raises(pp.errors.DataError, match="not been cut"):
        pp.gape(pp.Tissue(slot.mesh.uncut, 5, 0.4, slot.mesh.uncut.nodes[:, 2] == 0), 1.0)
    with pytest.raises(pp.errors.DataError, match="0 or more"):
        pp.gape(slot, -1.0)
