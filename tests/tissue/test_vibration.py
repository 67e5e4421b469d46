"""Tissue with mass: its modes, and force and surface in time against all modes of the same matrices."""

import numpy as np
import pytest
from scipy.linalg import eigh
from support.brick_meshes import block
from support.example_organs import organ
from support.running_server import until
from support.vibrating_body import TICK, AllModes, smooth

import palpate as pp
from palpate.errors import MaterialError
from palpate.simulation.scripted_device import ScriptedDevice
from palpate.tissue.contact_patches import patch
from palpate.tissue.vibration import lowest_modes, nodal_mass

RADIUS, TOP = 12.0, np.array([25.0, 25.0, 50.0])
SPECTRUM = pp.Relaxation((0.3, 0.2), (0.05, 0.5))


def swinging(n=8, relaxation=None, **options):
    return block(n, poisson=0.45, inertia=pp.Inertia(**options), relaxation=relaxation)


def test_the_modes_are_those_of_the_dense_matrices():
    tissue = swinging(6)
    model = pp.model(block(6, poisson=0.45), "compliance")
    K = model._stiffness
    mass = nodal_mass(tissue.mesh, 1060)[~tissue.held].repeat(3)
    found, shapes = lowest_modes(K, mass, model.factors, 30)
    exact = np.sqrt(eigh(K.toarray(), np.diag(mass), eigvals_only=True)[:30])
    np.testing.assert_allclose(found, exact, rtol=1e-6)
    np.testing.assert_allclose(shapes.T @ (mass[:, None] * shapes), np.eye(30), atol=1e-9)


def test_the_mass_is_that_of_the_body_and_lies_where_the_body_does():
    """Linear tetrahedra give each node a quarter: mass and its first moments are exact."""
    mesh = organ(7).mesh
    mass = nodal_mass(mesh, 1000)
    corners = mesh.nodes[mesh.tets]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    assert mass.sum() == pytest.approx(1e-9 * volume.sum())
    np.testing.assert_allclose(mass @ mesh.nodes, 1e-9 * volume @ corners.mean(axis=1), atol=1e-12)


def test_a_slow_push_is_static():
    model = pp.model(swinging(damping=0.3), "compliance")
    state, d = model.native.make_state(), np.array([1.0, 0.0, -3.0])
    under = patch(model.tissue, TOP, RADIUS)
    for t in range(3000):
        force = model.native.relax(state, under, smooth(t, 2000) * d, 1)
    expected = model.push(TOP, d, RADIUS)
    np.testing.assert_allclose(force, expected.force, atol=1e-3 * np.abs(expected.force).max())
    shown = model.native.displayed_displacement(state, model.vertices)
    np.testing.assert_allclose(shown, expected.displacement[model.vertices], atol=3e-3)


@pytest.mark.parametrize(("damping", "relaxation"), [(0.02, None), (0.1, None), (0.02, SPECTRUM)])
def test_a_tap_and_a_let_go_are_those_of_all_modes(damping, relaxation):
    """4 mm in 40 ms, held for 0.1 s, let go: RMS of the force within 3 %, of the surface within 2 % of the largest value."""
    tissue = swinging(damping=damping, relaxation=relaxation)
    model, truth = pp.model(tissue, "compliance"), AllModes(tissue, RADIUS)
    state, under = model.native.make_state(), patch(tissue, TOP, RADIUS)
    way = [4.0 * smooth(t, 40) for t in range(1, 141)]
    found, expected, last = [], [], np.zeros(3)
    for depth in way:
        d = np.array([0, 0, -depth])
        found.append(model.native.relax(state, under, d, 1))
        expected.append(truth.tick(TOP, last, d))
        last = d
    found, expected = np.array(found), np.array(expected)
    rms = np.sqrt(((found - expected) ** 2).sum(axis=1).mean()) / np.abs(expected).max()
    assert rms < 0.03
    surface, true = [], []
    for _ in range(300):
        model.native.relax(state, None, np.zeros(3), 1)
        truth.tick()
        surface.append(model.native.displayed_displacement(state, model.vertices))
        true.append(truth.whole()[model.vertices])
    surface, true = np.array(surface), np.array(true)
    assert np.sqrt(((surface - true) ** 2).mean()) < 0.02 * np.abs(true).max()
    assert np.abs(true[100:]).max() > 0.1  # it swings


def test_it_swings_at_its_lowest_frequency_and_settles():
    tissue = swinging(damping=0.05)
    model = pp.model(tissue, "compliance")
    state, under = model.native.make_state(), patch(tissue, TOP, RADIUS)
    for t in range(2000):
        model.native.relax(state, under, smooth(t, 500) * np.array([4.0, 0, 0]), 1)
    top = np.array([np.argmin(np.linalg.norm(tissue.mesh.nodes - TOP, axis=1))], dtype=np.int32)
    seen = []
    for _ in range(4000):
        model.native.relax(state, None, np.zeros(3), 1)
        seen.append(model.native.displayed_displacement(state, top)[0, 0])
    crossings = np.flatnonzero(np.diff(np.sign(seen[100:2000])))
    period = 2 * np.diff(crossings).mean() * TICK
    mass = nodal_mass(tissue.mesh, 1060)[~tissue.held].repeat(3)
    lowest = lowest_modes(model._stiffness, mass, model.factors, 1)[0][0]
    assert 2 * np.pi / period == pytest.approx(lowest * np.sqrt(1 - 0.05**2), rel=0.02)
    left = np.exp(-0.05 * lowest * TICK * (len(seen) - 100))
    assert np.abs(seen[-100:]).max() < 1.5 * left * np.abs(seen[:100]).max()


@pytest.mark.parametrize("seed", range(4))
def test_no_way_gains_energy(seed):
    """20,000 ticks of random hands, undamped, half of them on tissue that relaxes. The work, a tick's being that of its
    force, never sinks below zero in all.
    """
    rng = np.random.default_rng(seed)
    tissue = swinging(5, SPECTRUM if seed % 2 else None, damping=0.0)
    model = pp.model(tissue, "compliance")
    state, work, least, largest = model.native.make_state(), 0.0, 0.0, 0.0
    places = np.array([[15.0, 20.0, 50.0], [30.0, 30.0, 50.0]])
    patches = [patch(tissue, at, RADIUS) for at in places]
    for _ in range(100):
        under = patches[rng.integers(2)]
        _, where = model.native.relax_all(state, [under], 0, np.zeros((1, 3)), 1)
        before, speed = where[0], rng.choice([0.01, 0.1, 1.0])
        d = before.copy()
        for _ in range(150):
            d = d + speed * rng.standard_normal(3) - 0.02 * d
            work -= model.native.relax(state, under, d, 1) @ (d - before)
            before = d.copy()
            least, largest = min(least, work), max(largest, abs(work))
        for _ in range(49):
            model.native.relax(state, None, np.zeros(3), 1)
    assert work > 0
    assert least > -1e-6 * largest


def test_a_session_by_the_clock_replays_to_the_bit():
    like = organ(9)
    tissue = pp.Tissue(like.mesh, 5.0, 0.45, like.fixed, inertia=pp.Inertia(modes=40))
    model = pp.model(tissue, "compliance")
    session = pp.Session(model, radius=9.0, sweeps=1)
    x, y, z = (float(v) for v in tissue.mesh.nodes[np.argmax(tissue.mesh.nodes[:, 2])])
    line = [np.array([x + s, y, z]) for s in np.linspace(-15, 15, 60)]
    places = [tuple(float(v) for v in tissue.surface.closest(p).point) for p in line]
    commands = [pp.Command(True, at, (0, 0, -3.0)) for at in places] + [pp.Command()]
    commands += [pp.Command(True, at, (0, 0, -2.0)) for at in places[::-1]] + [pp.Command()]
    with session:
        session.start(ScriptedDevice([10 * k for k in range(len(commands))], commands))
        until(lambda: session.frame().tick > 10 * len(commands) + 100)
    record = session.record()
    assert pp.Session(model, radius=9.0, sweeps=1).replay(record) is None


def test_a_tissue_file_keeps_its_mass(tmp_path):
    tissue = swinging(3, damping=0.1, density=900)
    pp.write_tissue(tmp_path / "tissue.vtu", tissue)
    assert pp.read_tissue(tmp_path / "tissue.vtu").inertia == tissue.inertia


def test_other_models_are_refused():
    with pytest.raises(MaterialError, match="blocks does not follow the tissue's inertia"):
        pp.Session(pp.model(swinging(5), "blocks"))


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"damping": -0.1}, "damping: -0.1"),
        ({"damping": 1.0}, "damping: 1"),
        ({"damping": np.nan}, "damping: nan"),
        ({"density": 0.9}, "density: 0.9 kg"),
        ({"modes": 0}, "modes: 0"),
        ({"modes": 2.5}, "modes: 2.5"),
        ({"lag": 0.0}, "lag: 0 s"),
    ],
)
def test_what_is_no_inertia_is_refused(options, complaint):
    with pytest.raises(MaterialError, match=complaint):
        pp.Inertia(**options)
