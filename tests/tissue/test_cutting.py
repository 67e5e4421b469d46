"""Cut tissue: its stiffness, its forces, and who takes it."""

import numpy as np
import pytest
import scipy.linalg
from support.brick_meshes import brick
from support.cut_stiffness import solution, stiffness
from support.example_organs import organ

import palpate as pp
from palpate.meshes.cutting.cut_mesh import cut_mesh
from palpate.tissue.contact_patches import contacts, patch
from palpate.tissue.models.block_gauss_seidel import ordered_by_node


def plane(x, depth):
    """A blade in the plane x, from above the 50 mm cube down to z = 50 - depth."""
    return pp.Blade.swept([(x, -5, 55), (x, 55, 55)], (0, 0, -1), 5 + depth)


@pytest.fixture(scope="module")
def cube():
    mesh = brick((4, 4, 4), warp=0.3, region=lambda x: np.where(x[:, 0] < 20, 1, 2))
    return pp.Tissue(mesh, {1: 5.0, 2: 9.0}, 0.45, mesh.nodes[:, 2] == 0)


@pytest.fixture(scope="module")
def slot(cube):
    """Cut from above to the middle."""
    return pp.cut(cube, plane(23.0, 28.0))


PUSH = (12.0, 25.0, 50.0), (0.5, 0.2, -2.0), 9.0


@pytest.mark.parametrize("element", ["smoothed", "P1"])
def test_stiffness_of_a_cut_mesh(cube, slot, element):
    """Against one that other code assembles, cell by cell."""
    cut = pp.cut(pp.Tissue(cube.mesh, cube.young, cube.poisson, cube.fixed, element=element), plane(23.0, 28.0))
    K = ordered_by_node(cut).toarray()
    own = stiffness(cut.mesh, cut.young, cut.poisson, element).toarray()
    assert np.abs(K - own).max() < 1e-12 * np.abs(own).max()
    assert (cut.mesh.share < 1).sum() > 50


def test_force_of_a_cut_body(slot):
    """Against a solution with that stiffness."""
    W = np.kron(contacts(slot, *PUSH).weights(len(slot.mesh.nodes)), np.eye(3))
    force, u = solution(slot, W, PUSH[1])
    for name in ("compliance", "blocks", "multigrid"):
        model = pp.model(slot, name, **({"contact": False} if name == "compliance" else {}))
        answer = model.push(*PUSH, tolerance=1e-7)
        assert np.allclose(answer.force, -force, rtol=1e-6), name
        assert np.abs(answer.displacement.ravel() - u).max() < 1e-6 * np.abs(u).max()
    exact = pp.model(slot, "compliance", contact=False).push(*PUSH)
    assert np.allclose(exact.force, -force, rtol=1e-10)
    assert np.allclose(pp.finite_elements(slot).push(*PUSH).force, -force, rtol=1e-10)
    assert exact.estimate is None


def conforming(mesh, x, tip):
    """A mesh whose nodes at x above z = tip are there twice, and the node that each is a copy of."""
    split = np.flatnonzero((mesh.nodes[:, 0] == x) & (mesh.nodes[:, 2] > tip))
    number = np.arange(len(mesh.nodes))
    number[split] = len(mesh.nodes) + np.arange(len(split))
    beyond = mesh.nodes[mesh.tets].mean(axis=1)[:, 0] > x
    tets = np.where(beyond[:, None], number[mesh.tets], mesh.tets)
    return pp.TetMesh(np.concatenate([mesh.nodes, mesh.nodes[split]]), tets, mesh.region)


@pytest.mark.parametrize("element", ["smoothed", "P1"])
def test_a_cut_between_elements_is_the_conforming_one(element):
    mesh = brick((4, 4, 4))
    split = conforming(mesh, 25.0, 25.0)
    whole = pp.Tissue(mesh, 5.0, 0.45, mesh.nodes[:, 2] == 0, element=element)
    cut = pp.cut(whole, plane(25.0, 25.0))
    other = pp.Tissue(split, 5.0, 0.45, split.nodes[:, 2] == 0, element=element)

    def ordered(tissue):
        centre = tissue.mesh.nodes[tissue.mesh.tets].mean(axis=1)[:, 0]
        mean = np.bincount(tissue.mesh.tets.ravel(), np.repeat(centre, 4)) / np.bincount(tissue.mesh.tets.ravel())
        order = np.lexsort((mean, *tissue.mesh.nodes.T))
        rows = (3 * order[:, None] + np.arange(3)).ravel()
        return ordered_by_node(tissue).toarray()[np.ix_(rows, rows)]

    assert len(cut.mesh.nodes) == len(split.nodes)
    assert np.abs(ordered(cut) - ordered(other)).max() < 1e-12 * np.abs(ordered(other)).max()


@pytest.mark.parametrize("seed", [6, 10])
def test_the_error_of_a_force_beside_slivers_is_certified(seed):
    """A millionth of a tetrahedron at a node of its own: the least stiffness is that much less than the others."""
    whole, rng = organ(10), np.random.default_rng(seed)
    top = whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]
    across = rng.uniform(-8, 8)
    ends = top + (-15, across, 0), top + (15, across + rng.uniform(-5, 5), 0)
    path = [whole.surface.closest(end).point for end in ends]
    opened = pp.cut(whole, pp.incision(whole, path, depth=18.9))
    assert opened.mesh.share.min() < 1e-5
    model = pp.model(opened, "compliance")
    assert model.push(top + (0, 14, 0), (0, 2, 0), 8).error < 1e-8
    K = model._stiffness
    M = scipy.linalg.block_diag(*model._diagonal[0])
    least = scipy.linalg.eigh(K.toarray(), M, eigvals_only=True, subset_by_index=[0, 0])[0]
    assert 0.4 * least < model._least <= least


def test_a_cut_makes_softer(cube, slot):
    deeper = pp.cut(cube, plane(23.0, 40.0))
    forces = [pp.model(t, "compliance").push(*PUSH).force @ PUSH[1] for t in (cube, slot, deeper)]
    assert forces[0] < 1.05 * forces[1] < 1.05 * forces[2]


def test_the_other_half_does_not_move(cube):
    through = pp.cut(cube, plane(23.0, 60.0))
    x = through.mesh.nodes[through.mesh.tets].mean(axis=1)[:, 0]
    far = through.mesh.body != through.mesh.body[np.argmin(x)]
    still = np.unique(through.mesh.tets[far])
    away, towards = (-0.5, 0.2, 2.0), PUSH[1]
    for way, contact in ((towards, False), (away, False), (away, True)):
        answer = pp.model(through, "compliance", contact=contact).push(PUSH[0], way, PUSH[2])
        assert np.abs(answer.displacement).max() > 1
        # By contact, the half that is pulled away presses on the other one where it bulges at its support.
        assert np.abs(answer.displacement[still]).max() <= (0.05 if contact else 0)  # of 2 mm
    assert np.abs(pp.model(through, "compliance").push(*PUSH).displacement[still]).max() > 0.1
    half = brick((4, 4, 4))
    assert still.size > len(half.nodes) / 2


def test_patches_have_the_mean_of_what_the_surface_does(slot):
    """Of a linear field, on the lips too."""
    gradient = np.array([0.3, -0.2, 0.5])
    uncut = pp.Tissue(brick((4, 4, 4)), 5.0, 0.45, brick((4, 4, 4)).nodes[:, 2] == 0)
    for point, at in [((12, 25, 50), uncut), ((22, 30, 50), slot), ((23, 20, 35), slot)]:
        found = patch(at, point, 6.0)
        assert found.weights.sum() == pytest.approx(1)
        vertices, weights = at.surface.wide_patch(at.surface.closest(np.array(point, float)), 6.0)
        places = at.mesh.places if at is slot else at.mesh.nodes
        assert found.weights @ (at.mesh.nodes[found.nodes] @ gradient) == pytest.approx(
            weights @ (places[vertices] @ gradient)
        )


def test_a_patch_far_from_the_cut_is_that_of_the_whole(cube):
    cut = pp.cut(cube, plane(40.0, 10.0))
    one, other = patch(cube, (8, 25, 50), 9.0), patch(cut, (8, 25, 50), 9.0)
    assert np.array_equal(np.sort(one.nodes), np.sort(cut.mesh.origin[other.nodes]))
    assert np.allclose(one.weights[np.argsort(one.nodes)], other.weights[np.argsort(other.nodes)])


def test_a_cut_tissue_relaxes_as_before(cube):
    """One relaxation, or one for each region that is left."""
    one, other = pp.Relaxation((0.3,), (0.5,)), pp.Relaxation((0.2,), (1.0,))
    for relaxation in (one, {1: one, 2: other}):
        whole = pp.Tissue(cube.mesh, cube.young, 0.45, cube.mesh.nodes[:, 0] == 0, relaxation=relaxation)
        assert pp.cut(whole, plane(23.0, 28.0)).relaxation == whole.relaxation
    assert pp.cut(whole, plane(12.0, 60.0), loose="remove").relaxations[1] == one


def test_cuts_one_after_the_other(cube):
    second = pp.Blade.swept([(-5, 31, 55), (55, 26, 55)], (0, 0, -1), 25)
    both, later = pp.cut(cube, [plane(23.0, 28.0), second]), pp.cut(pp.cut(cube, plane(23.0, 28.0)), second)
    assert np.array_equal(both.mesh.tets, later.mesh.tets)
    for name in ("young", "poisson", "stiffening", "young_spread", "fixed"):
        assert np.array_equal(getattr(both, name), getattr(later, name))
    assert np.array_equal(both.young, np.where(both.mesh.region == 1, 5.0, 9.0))


def test_what_comes_free(cube):
    mesh = cube.mesh
    held = pp.Tissue(mesh, cube.young, 0.45, mesh.nodes[:, 0] == 0)
    with pytest.raises(pp.errors.MaterialError, match="1 of 2 pieces come free"):
        pp.cut(held, plane(23.0, 60.0))
    left = pp.cut(held, plane(23.0, 60.0), loose="remove")
    assert left.mesh.volumes.sum() == pytest.approx(23 * 50 * 50, rel=1e-6)  # slivers go with the larger part
    assert left.mesh.places[:, 0].max() == pytest.approx(23)
    assert pp.model(left, "compliance").push(*PUSH).force[2] > 0
    with pytest.raises(pp.errors.MeshError, match="taken away"):
        pp.cut(left, plane(10.0, 10.0))


def test_what_cannot_be_cut_is_refused(cube):
    with pytest.raises(pp.errors.MaterialError, match='"P2" is not built for cuts'):
        pp.cut(pp.Tissue(cube.mesh, 5, 0.45, cube.fixed, element="P2"), plane(23.0, 10.0))
    with pytest.raises(pp.errors.DataError, match="none given"):
        pp.cut(cube, [])
    with pytest.raises(pp.errors.DataError, match="loose: 'drop'"):
        pp.cut(cube, plane(23.0, 10.0), loose="drop")


@pytest.mark.parametrize(
    ("use", "said"),
    [
        (lambda t: pp.model(t, "springs"), "springs: takes no tissue that has been cut"),
        (lambda t: pp.model(t, "neo-hookean"), "neo-hookean: takes no tissue that has been cut"),
        (lambda t: pp.finite_strain(t), "finite strain: takes no tissue that has been cut"),
        (lambda t: pp.finite_elements(t, "P2"), '"P2": takes no tissue that has been cut'),
        (lambda t: pp.finite_elements(t, "mixed"), '"mixed": takes no tissue that has been cut'),
        (lambda t: pp.force_error_map(t, radius=9), "a cut mesh"),
        (lambda t: pp.fit(t.mesh, 5, 0.45, t.fixed), "fit: takes no tissue that has been cut"),
        (lambda t: pp.resting_on(t.mesh, (0, 0, -1)), "a cut mesh"),
    ],
)
def test_who_takes_no_cut_tissue_says_so(slot, use, said):
    with pytest.raises(pp.errors.MeshError, match=said):
        use(slot)


def test_a_lump_may_be_cut():
    whole = organ(7)
    top = whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]
    opened = pp.cut(whole, pp.Blade.swept([top - (30, 0, -5), top + (30, 0, 5)], (0, 0, -1), 25))
    assert {1, 2} <= set(opened.mesh.region[opened.mesh.side != 0])
    stiff, soft = (pp.model(t, "compliance").push(top + (0, 8, 0), (0, 2, 0), 8).force[1] for t in (whole, opened))
    assert 0.2 < soft / stiff < 0.95


def test_the_mesh_of_a_cut_mesh_is_the_one_before(cube, slot):
    before = slot.mesh.uncut
    assert np.array_equal(before.nodes, cube.mesh.nodes)
    assert np.array_equal(before.tets, cube.mesh.tets)
    assert np.array_equal(before.region, cube.mesh.region)
    assert np.array_equal(cut_mesh(before, slot.mesh.blades).tets, slot.mesh.tets)
