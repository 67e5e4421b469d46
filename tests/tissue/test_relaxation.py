"""Tissue whose stiffness relaxes: forces and dents over time, against closed forms and an implicit solution by SciPy."""

import numpy as np
import pytest
from scipy.sparse.linalg import splu
from support.brick_meshes import block
from support.example_organs import organ
from support.running_server import until

import palpate as pp
from palpate.errors import MaterialError
from palpate.simulation.recorded_session import session_like
from palpate.simulation.scripted_device import ScriptedDevice
from palpate.tissue.contact_patches import patch
from palpate.tissue.reference.linear_elasticity import FiniteElements

TICK = 1e-3  # s
RADIUS, TOP = 12.0, np.array([25.0, 25.0, 50.0])
SPECTRUM = pp.Relaxation((0.35, 0.25), (0.03, 0.4))


def relaxing(n=8, spectrum=SPECTRUM, poisson=0.45):
    return block(n, poisson=poisson, relaxation=spectrum)


def force_of(model, state, displacement, at=TOP):
    return model.native.relax(state, patch(model.tissue, at, RADIUS), np.asarray(displacement, dtype=float), 1)


SIX = pp.Relaxation((0.1, 0.15, 0.1, 0.05, 0.2, 0.1), (0.01, 0.02, 0.05, 0.1, 0.3, 2.0))  # as many as there may be


@pytest.mark.parametrize("spectrum", [pp.Relaxation((0.6,), (0.05,)), SPECTRUM, SIX])
def test_after_a_ramp_the_force_relaxes_as_the_closed_form_says(spectrum):
    """F(t) = S (d(t) + sum of rho tau v (1 - exp(-t/tau))) on a ramp of speed v, then each branch decays."""
    model = pp.model(relaxing(spectrum=spectrum), "compliance")
    stiffness = pp.model(block(8, poisson=0.45), "compliance").native
    speed, ramp, hold = np.array([5.0, -3.0, -60.0]), 40, 400
    state, elastic_state = model.native.make_state(), stiffness.make_state()
    found = []
    for n in range(1, ramp + hold + 1):
        found.append(force_of(model, state, min(n, ramp) * TICK * speed))
    elastic = stiffness.relax(elastic_state, patch(model.tissue, TOP, RADIUS), ramp * TICK * speed, 1)
    t = TICK * np.arange(1, ramp + hold + 1)
    strained = np.minimum(t, ramp * TICK)
    expected = strained.copy()
    for share, tau in zip(spectrum.shares, spectrum.times, strict=True):
        rho = share * spectrum.instantaneous
        expected += rho * tau * (np.exp(-(t - strained) / tau) - np.exp(-t / tau))
    expected = expected[:, None] / (ramp * TICK) * elastic
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


def test_a_step_relaxes_from_the_instantaneous_stiffness_to_that_of_a_push():
    """The step is a ramp of one tick, so that the first force is the mean of the modulus over it."""
    spectrum = pp.Relaxation((0.5, 0.2), (0.05, 0.6))
    model = pp.model(relaxing(spectrum=spectrum), "compliance")
    state, d = model.native.make_state(), np.array([1.0, 0.0, -3.0])
    found = np.array([force_of(model, state, d) for _ in range(8000)])
    final = model.push(TOP, d, RADIUS).force
    np.testing.assert_allclose(found[-1], final, rtol=1e-4, atol=1e-4 * np.abs(final).max())
    ends = TICK * np.arange(1, len(found) + 1)
    fine = (np.arange(1000) + 0.5) / 1000 * TICK
    means = np.array([spectrum.modulus(t - fine).mean() for t in ends[:300]])
    np.testing.assert_allclose(found[:300, 2] / found[-1, 2], means / spectrum.modulus(ends[-1]), rtol=1e-5)


class Implicit:
    """Maxwell elements all over the body: nodal displacements of the springs' far ends, by the trapezoidal rule."""

    def __init__(self, tissue, substeps=4):
        elements = FiniteElements(tissue, "smoothed")
        self.free, self.tissue, self.substeps = elements.free, tissue, substeps
        self.K = elements.K[self.free][:, self.free].tocsc()
        self.lu = splu(self.K)
        spectrum = tissue.relaxation
        h = TICK / substeps / (2 * np.array(spectrum.times))
        self.ratio = spectrum.instantaneous * np.array(spectrum.shares)
        self.keep, self.gain = (1 - h) / (1 + h), h / (1 + h)
        self.u = np.zeros(self.K.shape[0])
        self.v = np.zeros((len(self.ratio), self.K.shape[0]))
        self.before: dict[tuple, np.ndarray] = {}

    def weights(self, at):
        W = np.zeros((3 * len(self.tissue.mesh.nodes), 3))
        one = patch(self.tissue, at, RADIUS)
        for node, w in zip(one.nodes, one.weights, strict=True):
            W[3 * node + np.arange(3), np.arange(3)] = w
        return W[self.free]

    def tick(self, held):
        """held: {name: (point, displacement from, to)}; the forces (m, 3) of the tissue on the tools at the end."""
        W = np.hstack([self.weights(at) for at, _, _ in held.values()]) if held else None
        for s in range(1, self.substeps + 1):
            scale = 1 + (self.ratio * (1 - self.gain)).sum()
            pull = (self.ratio[:, None] * (self.keep[:, None] * self.v + self.gain[:, None] * self.u)).sum(axis=0)
            rest = pull / scale
            u, multiplier = rest, None
            if held:
                d = np.concatenate([a + (b - a) * s / self.substeps for _, a, b in held.values()])
                Y = self.lu.solve(W)
                multiplier = np.linalg.solve(W.T @ Y, d - W.T @ rest)
                u = rest + Y @ multiplier
            self.v = self.keep[:, None] * self.v + self.gain[:, None] * (self.u + u)
            self.u = u
        return -scale * multiplier.reshape(-1, 3) if held else np.zeros((0, 3))

    def whole(self):
        out = np.zeros(3 * len(self.tissue.mesh.nodes))
        out[self.free] = self.u
        return out.reshape(-1, 3)


def compare(tissue, ticks):
    """ticks: of each tick a dict of tools: name -> (point, displacement). Largest errors of force and surface, relative."""
    model, truth = pp.model(tissue, "compliance"), Implicit(tissue)
    state, last = model.native.make_state(), {}
    shown = model.vertices
    found, expected, surface, true_surface = [], [], [], []
    for n, tools in enumerate(ticks):
        held = {name: (np.asarray(at), last.get(name, np.zeros(3)), np.asarray(d)) for name, (at, d) in tools.items()}
        true = truth.tick(held)
        last = {name: d for name, (_, _, d) in held.items()}
        patches = [patch(tissue, at, RADIUS) for at, _, _ in held.values()]
        moves = np.array([d for _, _, d in held.values()]).reshape(-1, 3)
        force, _ = model.native.relax_all(state, patches, len(patches), moves, 1)
        found.append(np.vstack([force, np.zeros((2 - len(force), 3))]))
        expected.append(np.vstack([true, np.zeros((2 - len(true), 3))]))
        if n % 20 == 19:
            surface.append(model.native.displayed_displacement(state, shown))
            true_surface.append(truth.whole()[shown])
    found, expected = np.array(found), np.array(expected)
    surface, true_surface = np.array(surface), np.array(true_surface)
    off = np.abs(found - expected).max() / np.abs(expected).max()
    rms = np.sqrt(((surface - true_surface) ** 2).mean(axis=(1, 2)))
    return off, (rms / np.sqrt((true_surface**2).mean(axis=(1, 2)).max())).max()


def press(depth, ticks):
    return [np.array([0, 0, -depth * k / ticks]) for k in range(1, ticks + 1)]


def slide():
    """Press, slide 30 mm, and let go."""
    down = [{"a": ((10.0, 25.0, 50.0), d)} for d in press(3.0, 30)]
    way = [{"a": ((10.0 + 30 * k / 200, 25.0, 50.0), (0.3, 0, -3.0))} for k in range(1, 201)]
    return [*down, *way, *[{}] * 200]


def second_touch():
    """5 mm beside the first, when half of the slow relaxation time has gone by."""
    first = [{"a": (tuple(TOP), d)} for d in press(4.0, 20)] + [{"a": (tuple(TOP), (0, 0, -4.0))}] * 300
    second = [{"b": ((30.0, 25.0, 50.0), d)} for d in press(2.0, 20)]
    return [*first, *[{}] * 100, *second, *[{"b": ((30.0, 25.0, 50.0), (0, 0, -2.0))}] * 50]


def two_tools():
    both = []
    for k in range(1, 301):
        tools = {"a": ((15.0, 25.0, 50.0), (0, 0, -3.0 * min(k, 100) / 100))}
        if 80 < k <= 220:
            tools["b"] = ((37.0 - 3 * (k - 80) / 140, 25.0, 50.0), (0, 0, 2.0 * min(k - 80, 50) / 50))
        both.append(tools)
    return both


@pytest.mark.parametrize("way", [slide, second_touch, two_tools])
def test_force_and_surface_are_those_of_an_implicit_solution(way):
    """Where a tool leaves, the one lets go evenly over a tick, the other at its first quarter: some 1 % of 30 ms apart."""
    force, surface = compare(relaxing(), way())
    assert force < 2e-3
    assert surface < 5e-3


def test_a_dent_lasts_when_the_tool_has_left_and_recovers():
    """By the modulus' creep: here half of the dent of a long hold remains at first and goes with tau / (1 - g)."""
    spectrum = pp.Relaxation((0.5,), (0.1,))
    tissue = relaxing(spectrum=spectrum)
    model = pp.model(tissue, "compliance")
    state = model.native.make_state()
    top = np.array([np.argmin(np.linalg.norm(tissue.mesh.nodes - TOP, axis=1))], dtype=np.int32)
    for _ in range(3000):
        force_of(model, state, (0, 0, -4.0))
    held = model.native.displayed_displacement(state, top)[0, 2]
    depths = []
    for _ in range(600):
        model.native.relax(state, None, np.zeros(3), 1)
        depths.append(model.native.displayed_displacement(state, top)[0, 2] / held)
    t = TICK * np.arange(1, 601)
    # The elastic part leaves at the first tick; e^(-t/lambda) with lambda = tau / (1 - g), from the end of that tick.
    expected = 0.5 * np.exp(-t / 0.2)
    np.testing.assert_allclose(depths, expected, atol=0.5 * TICK / 0.1)
    assert np.diff(depths).max() < 0


@pytest.mark.parametrize("seed", range(3))
def test_no_way_gains_energy(seed):
    """20,000 ticks of random pushes at two places, with rests: the tools' work is never negative."""
    rng = np.random.default_rng(seed)
    tissue = relaxing(5, pp.Relaxation((0.3, 0.3, 0.2), (0.003, 0.05, 1.0)))
    model = pp.model(tissue, "compliance")
    state, work, least, force = model.native.make_state(), 0.0, 0.0, np.zeros(3)
    places = np.array([[15.0, 20.0, 50.0], [30.0, 30.0, 50.0]])
    for _ in range(100):
        at, before, d = places[rng.integers(2)], np.zeros(3), np.zeros(3)
        speed = rng.choice([0.01, 0.1, 1.0])
        for k in range(150):
            d = d + speed * rng.standard_normal(3) - (0.02 * d if k < 100 else 0.3 * d)
            now = force_of(model, state, d, at)
            work -= 0.5 * (force + now) @ (d - before)
            force, before = now, d
            least = min(least, work)
        force = np.zeros(3)
        for _ in range(50):
            model.native.relax(state, None, np.zeros(3), 1)
    assert work > 0
    assert least > -1e-9


def test_a_session_by_the_clock_replays_to_the_bit():
    tissue = pp.Tissue(organ(9).mesh, 5.0, 0.45, organ(9).fixed, relaxation=SPECTRUM)
    model = pp.model(tissue, "compliance")
    session = pp.Session(model, radius=9.0, sweeps=1)
    top = tissue.mesh.nodes[np.argmax(tissue.mesh.nodes[:, 2])]
    x, y, z = (float(v) for v in top)
    places = [
        tuple(float(v) for v in tissue.surface.closest(np.array([x + s, y, z])).point) for s in np.linspace(-15, 15, 60)
    ]
    commands = [pp.Command(True, at, (0, 0, -3.0)) for at in places] + [pp.Command()]
    commands += [pp.Command(True, at, (0, 0, -2.0)) for at in places[::-1]] + [pp.Command()]
    device = ScriptedDevice([10 * k for k in range(len(commands))], commands)
    with session:
        session.start(device)
        until(lambda: session.frame().tick > 10 * len(commands) + 100)
    record = session.record()
    assert session_like(record, tissue).replay(record) is None
    assert pp.Session(model, radius=9.0, sweeps=1).replay(record) is None


def test_other_models_refuse_a_tissue_that_relaxes():
    tissue = relaxing(5)
    with pytest.raises(MaterialError, match="blocks does not follow the tissue's relaxation"):
        pp.Session(pp.model(tissue, "blocks"))
    session = pp.Session(pp.model(tissue, "compliance"))
    with pytest.raises(MaterialError, match="multigrid does not follow"):
        session.change(pp.model(tissue, "multigrid"))


def test_a_tissue_file_keeps_its_relaxation(tmp_path):
    pp.write_tissue(tmp_path / "tissue.vtu", relaxing(3))
    assert pp.read_tissue(tmp_path / "tissue.vtu").relaxation == SPECTRUM
    pp.write_tissue(tmp_path / "elastic.vtu", block(3))
    assert pp.read_tissue(tmp_path / "elastic.vtu").relaxation is None


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("0.3", "give share@seconds"),
        ("0.3@x", "give share@seconds"),
        ("0.3@0.1@2", "give share@seconds"),
        ("1.2@1", "a share of 1.2"),
        ("0@1", "a share of 0"),
        ("0.5@0.0001", "a time of 0.0001 s"),
        ("0.5@inf", "a time of inf s"),
        ("nan@1", "a share of nan"),
        ("0.6@1,0.5@2", "sum to 1.1"),
        (",".join(["0.1@1"] * 7), "7 shares"),
    ],
)
def test_what_is_no_relaxation_is_refused(text, complaint):
    with pytest.raises(MaterialError, match=complaint):
        pp.Relaxation.parse(text)
