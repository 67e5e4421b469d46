"""Tissue that folds: its surface meets itself, and does not go through."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial import cKDTree
from support.brick_meshes import brick
from support.example_organs import organ

import palpate as pp
from palpate import _core
from palpate.tissue.neo_hookean_energy import neo_hookean_energy
from palpate.tissue.reference.linear_elasticity import nodal_shear

CELL, CELLS = 4.0, (11, 4, 10)
SLOT = (20.0, 24.0)  # mm: a cleft along y, open at the top
LEFT, RIGHT, RADIUS = (0.0, 8.0, 34.0), (44.0, 8.0, 34.0), 8.0
TOLERANCE = 1e-3  # of a push
GAP = _core.hyperelastic.SelfContact.gap


@pytest.fixture(scope="module")
def flaps():
    """Two flaps of 20 mm on one base, 4 mm apart."""
    whole = brick(CELLS, tuple(CELL * n for n in CELLS))
    x, _, z = whole.nodes[whole.tets].mean(axis=1).T
    tets = whole.tets[~((x > SLOT[0]) & (x < SLOT[1]) & (z > 2 * CELL))]
    used, numbered = np.unique(tets, return_inverse=True)
    mesh = pp.TetMesh(whole.nodes[used], numbered.reshape(tets.shape))
    return pp.Tissue(mesh, 5.0, 0.4, mesh.nodes[:, 2] == 0)


@pytest.fixture(scope="module")
def model(flaps):
    return pp.model(flaps, "neo-hookean", self_contact=True)


def with_contact(tissue):
    shear = nodal_shear(tissue.mesh, tissue.young, tissue.poisson)
    elements = neo_hookean_energy(tissue)
    return _core.hyperelastic.SelfContact(elements, tissue.surface, shear), elements


def distances(points, faces):
    """(points,) mm to the nearest of triangles (faces, 3, 3): above its inside, else to one of its edges."""
    least = np.full(len(points), np.inf)
    for face in faces:
        inner = np.ones(len(points), dtype=bool)
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        for a, b in zip(face, np.roll(face, -1, axis=0), strict=True):
            along = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            least = np.minimum(least, np.linalg.norm(points - a - along[:, None] * (b - a), axis=1))
            inner &= (points - a) @ np.cross(normal, b - a) > 0
        above = np.abs((points - face[0]) @ normal) / np.linalg.norm(normal)
        least = np.where(inner, np.minimum(least, above), least)
    return least


def overlap(tissue, u):
    """mm: how deep points of the left flap's surface lie in elements of the right one, or the other way round."""
    mesh, x = tissue.mesh, tissue.mesh.nodes + u
    left = mesh.nodes[:, 0] < np.mean(SLOT)
    high = mesh.nodes[:, 2] > 2 * CELL
    weights = np.array([(i, j, 8 - i - j) for i in range(9) for j in range(9 - i)]) / 8  # half a mm apart
    deepest = 0.0
    for side in (left, ~left):
        faces = [mesh.surface[(part & high)[mesh.surface].all(axis=1)] for part in (side, ~side)]
        points, other = (np.einsum("wc,fck->fwk", weights, x[f]).reshape(-1, 3) for f in faces)
        tets = x[mesh.tets[(~side)[mesh.tets].all(axis=1)]]
        near = points[cKDTree(other).query(points)[0] < CELL]
        inside = np.zeros(len(near), dtype=bool)
        for tet in tets:
            within = ((near > tet.min(axis=0)) & (near < tet.max(axis=0))).all(axis=1)
            part = np.linalg.solve((tet[1:] - tet[0]).T, (near[within] - tet[0]).T)
            inside[np.flatnonzero(within)[(part > 0).all(axis=0) & (part.sum(axis=0) < 1)]] = True
        if inside.any():
            deepest = max(deepest, distances(near[inside], x[faces[1]]).max())
    return deepest


@pytest.mark.parametrize("depth", [5.0, 12.0])
def test_a_fold_of_two_flaps_does_not_overlap(flaps, model, depth):
    free = pp.model(flaps, "neo-hookean").push(LEFT, (depth, 0, 0), RADIUS)
    answer = model.push(LEFT, (depth, 0, 0), RADIUS)
    assert overlap(flaps, free.displacement) > 0.8
    assert overlap(flaps, answer.displacement) <= 0.2
    assert -answer.force[0] > 1.1 * -free.force[0]  # the other flap resists


@settings(max_examples=10)
@given(
    left=st.booleans(),
    y=st.floats(2, 14),
    z=st.floats(18, 38),
    way=st.tuples(st.floats(5, 12), st.floats(-6, 6), st.floats(-6, 3)),
)
@example(left=True, y=7.7, z=21.2, way=(10.1, -4.6, -2.5))  # low in the cleft, where its sides hang together
def test_nor_do_they_wherever_and_however_one_is_pushed(flaps, model, left, y, z, way):
    """Unless the answer says that it has not settled, as of some pushes of 12 mm low in the cleft."""
    point, side = (LEFT[0], 1) if left else (RIGHT[0], -1)
    answer = model.push((point, y, z), (side * way[0], *way[1:]), RADIUS)
    assert answer.error > TOLERANCE or overlap(flaps, answer.displacement) <= 0.2


def test_a_push_half_way_up_a_flap_settles(model):
    assert all(model.push((LEFT[0], 8.0, z), (10.0, -3.0, -2.0), RADIUS).error <= TOLERANCE for z in (22.0, 28.0, 34.0))


@pytest.fixture(scope="module")
def pressed(model):
    return model.push(LEFT, (8.0, 0, 0), RADIUS).displacement


@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_the_force_of_contacts_is_their_energys_gradient_and_balances(flaps, pressed, seed):
    """Total force and moment are zero, as of every energy that does not change when all is moved or turned."""
    energy, elements = with_contact(flaps)
    rng = np.random.default_rng(seed)
    u = pressed + rng.normal(0, 0.02, pressed.shape)
    force = energy.energy(u)[1] - elements.energy(u)[1]
    size = np.abs(force).sum()
    assert size > 0
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * size
    assert np.abs(np.cross(flaps.mesh.nodes + u, force).sum(axis=0)).max() < 1e-8 * size
    way, h = rng.normal(size=u.shape), 1e-6
    ahead, behind = (energy.energy(u + s * h * way)[0] - elements.energy(u + s * h * way)[0] for s in (1, -1))
    assert (ahead - behind) / (2 * h) == pytest.approx((force * way).sum(), rel=1e-4, abs=1e-7 * size)


def test_flaps_that_meet_half_way_feel_a_wall_there(flaps):
    """Both outer faces are moved inwards: each flap is as if before a frictionless wall, found by bounds in SciPy.

    The contacts act within the gap on either side of the middle, so that two walls enclose them.
    """
    energy, elements = with_contact(flaps)
    mesh = flaps.mesh
    x, _, z = mesh.nodes.T
    moved = ((x == 0) | (x == 44)) & (z > 16)
    free = ~(moved | flaps.held)
    inner = np.isin(x, SLOT) & (z > 2 * CELL)
    start = np.zeros_like(mesh.nodes)
    start[moved, 0] = np.where(x[moved] == 0, 4.0, -4.0)

    def reaction(solid, wall=None):
        """N on the left face, at the minimum. wall: mm, which the left flap's inner nodes may move to, and the right's."""
        bounds = np.full((*start.shape, 2), [-np.inf, np.inf])
        if wall is not None:
            bounds[inner & (x == SLOT[0]), 0, 1] = wall
            bounds[inner & (x == SLOT[1]), 0, 0] = -wall

        def value(part):
            u = start.copy()
            u[free] = part.reshape(-1, 3)
            e, f, _ = solid.energy(u)
            return (e, f[free].ravel()) if np.isfinite(e) else (1e9, np.zeros(part.size))

        options = {"maxiter": 3000, "maxfun": 6000, "ftol": 1e-12, "gtol": 1e-6}
        guess = np.zeros_like(start)  # no element is turned over, and the flaps do not meet yet
        guess[:, 0] = np.interp(x, (0, *SLOT, 44), (4, 1.8, -1.8, -4)) * np.clip((z - 2 * CELL) / (2 * CELL), 0, 1)
        found = minimize(
            value, guess[free].ravel(), jac=True, method="L-BFGS-B", bounds=bounds[free].reshape(-1, 2), options=options
        )
        u = start.copy()
        u[free] = found.x.reshape(-1, 3)
        return solid.energy(u)[1][moved & (x == 0), 0].sum()

    apart = reaction(elements)
    soft, met, stiff = reaction(elements, 2 + GAP / 2), reaction(energy), reaction(elements, 2 - GAP / 2)
    assert apart < 0.8 * soft
    assert soft <= met <= stiff


def test_a_body_that_does_not_meet_itself_is_as_without(model, flaps):
    for tissue in (flaps, organ()):
        energy, elements = with_contact(tissue)
        rng = np.random.default_rng(1)
        for size in (0.0, 0.05):
            u = size * rng.normal(size=tissue.mesh.nodes.shape)
            assert energy.energy(u)[0] == elements.energy(u)[0]
            assert (energy.energy(u)[1] == elements.energy(u)[1]).all()
    away = [pp.model(flaps, "neo-hookean", self_contact=s).push(LEFT, (1.5, 0, 0), RADIUS).force for s in (True, False)]
    np.testing.assert_allclose(*away, rtol=1e-3)


def test_in_a_session_a_flap_meets_the_other_and_gives_no_work(flaps, model):
    session = pp.Session(model, radius=RADIUS)
    stored = 0.0
    for ways in (np.linspace(0, 9, 180), np.full(400, 9.0), np.linspace(9, 0, 180), np.zeros(400)):
        session.step([[pp.Command(True, LEFT, (way, 0, 0))] for way in ways])
        frame = session.frame()
        if ways[-1] == 9:
            stored = -0.5 * float(np.dot(frame.force[0], frame.displacement[0]))
            assert overlap(flaps, session.displacement) <= 0.2
    assert stored > 0
    assert frame.work > -0.01 * stored
