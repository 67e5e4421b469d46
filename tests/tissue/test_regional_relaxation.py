"""Tissue whose parts relax differently: creep of small bodies by eigenvalues, forces and dents by an implicit solution."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh, expm
from scipy.sparse.linalg import splu
from support.brick_meshes import brick
from support.running_server import until
from typer.testing import CliRunner

import palpate as pp
from palpate.commands import app
from palpate.errors import MaterialError
from palpate.simulation.recorded_session import session_like
from palpate.simulation.scripted_device import ScriptedDevice
from palpate.tissue.contact_patches import patch
from palpate.tissue.reference.linear_elasticity import FiniteElements
from palpate.tissue.regional_relaxation import creep_intervals, creep_of

TICK = 1e-3  # s
RADIUS = 12.0
SLOW, QUICK = pp.Relaxation((0.5,), (0.4,)), pp.Relaxation((0.35, 0.25), (0.03, 0.4))
SHEAR = pp.Relaxation((0.5,), (0.1,), bulk=False)


def two_layers(relaxation, n=8, poisson=0.45, young=(5.0, 15.0)):
    """The 50 mm cube held at its bottom: region 1, whose top is touched, on region 2."""
    mesh = brick((n - 1,) * 3, region=lambda centre: np.where(centre[:, 2] > 28.0, 1, 2))
    return pp.Tissue(mesh, {1: young[0], 2: young[1]}, poisson, mesh.nodes[:, 2] == 0, relaxation=relaxation)


class Body:
    """A small dense body K(s) = K + sum D_k s tau_k / (1 + s tau_k) of random parts, and its creep by eigenvalues."""

    def __init__(self, rng, times, ratios, n=6):
        def part(rank):
            G = rng.standard_normal((rank, n))
            return G.T @ G

        self.times = np.array(times)
        self.parts = [part(int(rng.integers(1, n))) for _ in times]
        self.K = part(n) + 0.1 * np.eye(n)
        self.D = []
        for D, ratio in zip(self.parts, ratios, strict=True):  # the largest eigenvalue of D for K is the ratio
            self.D.append(D * ratio / eigh(D, self.K, eigvals_only=True)[-1])
        # The branches' dashpots y_k, y_k' = (u - y_k) / tau_k, move by a matrix of their own under a constant force.
        whole = self.K + sum(self.D)
        pull = np.linalg.solve(whole, np.hstack(self.D))
        self.A = (np.tile(pull, (len(times), 1)) - np.eye(n * len(times))) / np.repeat(self.times, n)[:, None]
        self.pull, self.instant = pull, np.linalg.inv(whole)

    def compliance(self, s):
        if np.isinf(s):
            return self.instant
        return np.linalg.inv(self.K + sum(D * s * t / (1 + s * t) for D, t in zip(self.D, self.times, strict=True)))

    def creep(self, t):
        """(n, n): displacement at time t under unit forces that came at 0."""
        n, terms = len(self.K), len(self.times)
        drive = np.tile(self.instant, (terms, 1)) / np.repeat(self.times, n)[:, None]
        y = np.linalg.solve(self.A, (expm(self.A * t) - np.eye(n * terms)) @ drive)
        return self.instant + self.pull @ y


spectra = st.lists(
    st.tuples(st.floats(-2, 2), st.floats(0.02, 0.6)), min_size=1, max_size=3, unique_by=lambda term: round(term[0], 1)
).map(lambda terms: sorted((10**time, share) for time, share in terms))


def relaxation_of(terms):
    shares = np.array([share for _, share in terms])
    shares *= min(1.0, 0.9 / shares.sum())
    return pp.Relaxation(tuple(shares), tuple(time for time, _ in terms))


@settings(max_examples=5, deadline=None)
@given(spectra, st.integers(0, 2**31))
def test_creep_times_lie_in_their_intervals(terms, seed):
    one = relaxation_of(terms)
    ratios = np.array(one.shares) * one.instantaneous
    body = Body(np.random.default_rng(seed), one.times, ratios)
    creep = -1 / np.linalg.eigvals(body.A)
    assert np.abs(creep.imag).max() < 1e-6 * np.abs(creep).max()
    inside = np.zeros(len(creep), dtype=bool)
    for low, high in creep_intervals(one.times, ratios):
        inside |= (creep.real >= low * (1 - 1e-6)) & (creep.real <= high * (1 + 1e-6))
    assert inside.all()


@settings(max_examples=5, deadline=None)
@given(spectra, st.integers(0, 2**31))
def test_no_body_creeps_otherwise_than_the_fit_by_more_than_it_says_and_none_gives_energy(terms, seed):
    """Judged in the energy of the whole creep: v'(found - true)v against v'(G(0) - G(inf))v for all v."""
    one = relaxation_of(terms)
    fit = creep_of([one])
    body = Body(np.random.default_rng(seed), one.times, np.array(one.shares) * one.instantaneous)
    sampled = np.array([body.compliance(s) for s in fit.samples])
    parts = np.einsum("kj,jab->kab", fit.mix, sampled)
    whole = body.compliance(0) - body.instant
    np.testing.assert_allclose(parts.sum(axis=0), whole, atol=1e-6 * np.abs(whole).max())  # exact in the end
    root, shape = np.linalg.eigh(whole)
    good = shape[:, root > 1e-9 * root[-1]] / np.sqrt(root[root > 1e-9 * root[-1]])
    for part in parts:
        assert np.linalg.eigvalsh(good.T @ part @ good)[0] > -2e-3
    for t in np.geomspace(fit.times[0] / 5, 5 * fit.times[-1], 8):
        found = body.instant + np.einsum("k,kab->ab", -np.expm1(-t / fit.times), parts)
        off = np.linalg.eigvalsh(good.T @ (found - body.creep(t)) @ good)
        assert np.abs(off).max() < fit.error + 2e-3


def test_one_relaxation_of_all_regions_is_what_it_was():
    assert two_layers({1: QUICK, 2: QUICK}, 3).relaxation == QUICK
    assert two_layers({1: QUICK, 2: QUICK}, 3).relaxes_alike
    assert not two_layers({1: QUICK}, 3).relaxes_alike
    assert two_layers({}, 3).relaxation is None


def test_constants_over_the_rate():
    """The bulk modulus stays where shear alone relaxes; elsewhere Poisson's ratio does."""
    tissue = two_layers({1: SHEAR, 2: QUICK}, 3)
    first = tissue.mesh.region == 1
    for s in (0.0, 3.0, np.inf):
        young, poisson = tissue.at_rate(s)
        bulk, shear = young / (3 * (1 - 2 * poisson)), young / (2 * (1 + poisson))
        np.testing.assert_allclose(bulk[first], 5.0 / 0.3, rtol=1e-12)
        rise = 2.0 if np.isinf(s) else 1 + s * 0.1 / (1 + s * 0.1)
        np.testing.assert_allclose(shear[first], 5.0 / 2.9 * rise, rtol=1e-12)
        np.testing.assert_allclose(poisson[~first], 0.45, rtol=1e-12)
        np.testing.assert_allclose(young[~first], 15.0 * QUICK.at_rate(s), rtol=1e-12)
    np.testing.assert_allclose(tissue.at_rate(0.0), [tissue.young, tissue.poisson], rtol=1e-12)


class Implicit:
    """Maxwell elements of each region: the displacement of their dashpots at every node, by the trapezoidal rule."""

    def __init__(self, tissue, relaxations, substeps=4):
        self.tissue, self.substeps = tissue, substeps
        elements = FiniteElements(tissue)
        self.free = elements.free
        K = elements.K[self.free][:, self.free].tocsc()
        self.D, self.keep, self.gain = [], [], []
        for region, one in relaxations.items():
            part = self.part_of(region, one.bulk) - K
            for share, time in zip(one.shares, one.times, strict=True):
                h = TICK / substeps / (2 * time)
                self.D.append(part * share * one.instantaneous)
                self.keep.append((1 - h) / (1 + h))
                self.gain.append(h / (1 + h))
        self.lu = splu((K + sum(D * (1 - g) for D, g in zip(self.D, self.gain, strict=True))).tocsc())
        self.u, self.v = np.zeros(len(self.free)), np.zeros((len(self.D), len(self.free)))

    def part_of(self, region, bulk):
        """The stiffness with the shear modulus of a region doubled, and its bulk modulus too if `bulk`."""
        inside = self.tissue.mesh.region == region
        E, nu = self.tissue.young.copy(), self.tissue.poisson.copy()
        if bulk:
            E[inside] *= 2
        else:
            kappa, mu = E / (3 * (1 - 2 * nu)), E / (1 + nu)  # mu: twice the shear modulus
            E[inside] = (9 * kappa * mu / (3 * kappa + mu))[inside]
            nu[inside] = ((3 * kappa - 2 * mu) / (6 * kappa + 2 * mu))[inside]
        double = FiniteElements(pp.Tissue(self.tissue.mesh, E, nu, self.tissue.fixed, element=self.tissue.element))
        return double.K[self.free][:, self.free].tocsc()

    def weights(self, at):
        W = np.zeros((3 * len(self.tissue.mesh.nodes), 3))
        one = patch(self.tissue, at, RADIUS)
        for node, w in zip(one.nodes, one.weights, strict=True):
            W[3 * node + np.arange(3), np.arange(3)] = w
        return W[self.free]

    def tick(self, at, start, end):
        """The force (3,) of the tissue on the tool at the end; at None: no tool."""
        W = None if at is None else self.weights(at)
        Y = None if at is None else self.lu.solve(W)
        force = np.zeros(3)
        for s in range(1, self.substeps + 1):
            pull = sum(
                D @ (k * v + g * self.u) for D, k, g, v in zip(self.D, self.keep, self.gain, self.v, strict=True)
            )
            u = self.lu.solve(pull)
            if at is not None:
                force = np.linalg.solve(W.T @ Y, start + (end - start) * s / self.substeps - W.T @ u)
                u = u + Y @ force
            for k, (keep, gain) in enumerate(zip(self.keep, self.gain, strict=True)):
                self.v[k] = keep * self.v[k] + gain * (self.u + u)
            self.u = u
        return -force

    def whole(self):
        out = np.zeros(3 * len(self.tissue.mesh.nodes))
        out[self.free] = self.u
        return out.reshape(-1, 3)


def press_slide_rest_and_touch_again():
    """(place, displacement) of each tick; None: no tool."""
    down = [((15.0, 25.0, 50.0), np.array([0, 0, -3.0 * k / 30])) for k in range(1, 31)]
    hold = [((15.0, 25.0, 50.0), np.array([0, 0, -3.0]))] * 120
    slide = [((15.0 + 20 * k / 150, 25.0, 50.0), np.array([0.3, 0, -3.0])) for k in range(1, 151)]
    again = [((25.0, 30.0, 50.0), np.array([0, 0, -2.0 * k / 20])) for k in range(1, 21)]
    return [*down, *hold, *slide, *[(None, np.zeros(3))] * 100, *again, *[again[-1]] * 80]


@pytest.mark.parametrize(
    "relaxations",
    [{1: SLOW}, {1: QUICK, 2: SLOW}, {1: SHEAR, 2: SHEAR}],
    ids=["one layer", "two spectra", "shear alone"],
)
def test_force_and_surface_are_those_of_an_implicit_solution(relaxations):
    """At Poisson's ratio 0.35, where it matters whether the bulk relaxes."""
    tissue = two_layers(relaxations, 6, poisson=0.35)
    model, truth = pp.model(tissue, "compliance"), Implicit(tissue, relaxations)
    state, last, forces, fields = model.native.make_state(), np.zeros(3), [], []
    for n, (at, d) in enumerate(press_slide_rest_and_touch_again()):
        expected = truth.tick(at, last, d)
        last = d
        patches = [] if at is None else [patch(tissue, at, RADIUS)]
        found, _ = model.native.relax_all(state, patches, len(patches), d[None][: len(patches)], 1)
        forces.append((found.sum(axis=0), expected))
        if n % 20 == 19:
            fields.append((model.native.displayed_displacement(state, model.vertices), truth.whole()[model.vertices]))
    found, expected = np.array(forces).swapaxes(0, 1)
    assert np.abs(found - expected).max() < 0.02 * np.abs(expected).max()
    shown, true = np.array(fields).swapaxes(0, 1)
    assert np.sqrt(((shown - true) ** 2).mean(axis=(1, 2))).max() < 0.02 * np.sqrt((true**2).mean(axis=(1, 2)).max())


def test_near_incompressibility_shear_alone_is_felt_nearly_as_the_whole():
    """The bulk gives a part at nu = 0.45: the force is somewhat less at once, and the same in the end."""
    alike, creeping = (two_layers({1: one, 2: one}, 6) for one in (pp.Relaxation((0.5,), (0.1,)), SHEAR))
    at = patch(alike, np.array([25.0, 25.0, 50.0]), RADIUS)
    found = []
    for tissue in (alike, creeping):
        model = pp.model(tissue, "compliance")
        state = model.native.make_state()
        found.append([model.native.relax(state, at, np.array([0, 0, -2.0]), 1)[2] for _ in range(400)])
    first, second = np.array(found)
    np.testing.assert_allclose(second, first, rtol=0.1)
    assert first[0] > second[0] > 0.9 * first[0]  # the bulk gives less at once
    assert second[-1] == pytest.approx(first[-1], rel=1e-2)


@pytest.mark.parametrize("seed", range(2))
def test_no_way_gains_energy(seed):
    """10,000 ticks of random pushes at two places, with rests: the tools' work is never negative."""
    rng = np.random.default_rng(seed)
    tissue = two_layers({1: pp.Relaxation((0.4,), (0.05,), bulk=False), 2: QUICK}, 5)
    model = pp.model(tissue, "compliance")
    state, work, least, force = model.native.make_state(), 0.0, 0.0, np.zeros(3)
    places = np.array([[15.0, 20.0, 50.0], [30.0, 30.0, 50.0]])
    for _ in range(50):
        at, before, d = patch(tissue, places[rng.integers(2)], RADIUS), np.zeros(3), np.zeros(3)
        speed = rng.choice([0.01, 0.1, 1.0])
        for k in range(150):
            d = d + speed * rng.standard_normal(3) - (0.02 * d if k < 100 else 0.3 * d)
            now = model.native.relax(state, at, d, 1)
            work -= 0.5 * (force + now) @ (d - before)
            force, before = now, d
            least = min(least, work)
        force = np.zeros(3)
        for _ in range(50):
            model.native.relax(state, None, np.zeros(3), 1)
    assert work > 0
    assert least > -1e-9


def test_a_session_by_the_clock_replays_to_the_bit():
    tissue = two_layers({1: SLOW, 2: SHEAR}, 6)
    model = pp.model(tissue, "compliance")
    session = pp.Session(model, radius=RADIUS, sweeps=1)
    commands = [pp.Command(True, (float(x), 25.0, 50.0), (0, 0, -3.0)) for x in np.linspace(10, 40, 30)]
    commands += [pp.Command(), pp.Command(True, (20.0, 20.0, 50.0), (0, 0, -2.0)), pp.Command()]
    device = ScriptedDevice([10 * k for k in range(len(commands))], commands)
    with session:
        session.start(device)
        until(lambda: session.frame().tick > 10 * len(commands) + 100)
    record = session.record()
    assert session_like(record, tissue).replay(record) is None
    assert pp.Session(model, radius=RADIUS, sweeps=1).replay(record) is None


def test_the_command_gives_a_region_a_relaxation_in_shear_alone(tmp_path):
    tissue = two_layers(None, 4)
    pp.write_mesh(tmp_path / "mesh.vtu", tissue.mesh)
    words = ["fit", str(tmp_path / "mesh.vtu"), "--young", "5", "-o", str(tmp_path / "tissue.vtu"), "--no-bulk"]
    done = CliRunner().invoke(app, [*words, "--region-relaxation", "1=0.5@0.1"])
    assert done.exit_code == 0, done.output
    assert "just after a strain stiffness in shear alone is 2 times" in done.output
    assert "of what creeps at most 1.5% is off" in done.output
    assert pp.read_tissue(tmp_path / "tissue.vtu").relaxation == {1: SHEAR}
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code == 2
    assert "--no-bulk" in refused.output


def test_a_tissue_file_keeps_the_relaxation_of_each_region(tmp_path):
    for one in ({1: SLOW, 2: SHEAR}, {2: QUICK}, SHEAR):
        pp.write_tissue(tmp_path / "tissue.vtu", two_layers(one, 3))
        assert pp.read_tissue(tmp_path / "tissue.vtu").relaxation == one


@pytest.mark.parametrize(
    ("relaxation", "complaint"),
    [
        ({3: SLOW}, "no region 3"),
        ({"lump": SLOW}, "no region 'lump'"),
        ({1: 0.5}, r"give a pp.Relaxation"),
        ({1: pp.Relaxation((0.6,), (0.1,), bulk=False)}, "Poisson's ratio of tet .* just after"),
    ],
)
def test_what_is_no_relaxation_of_a_region_is_refused(relaxation, complaint):
    with pytest.raises(MaterialError, match=complaint):
        two_layers(relaxation, 3, poisson=0.2)


def test_parts_that_relax_differently_do_not_swing_and_have_few_times():
    mesh = brick((2, 2, 2), region=lambda centre: np.where(centre[:, 2] > 25.0, 1, 2))
    with pytest.raises(MaterialError, match="cannot swing"):
        pp.Tissue(mesh, 5.0, 0.4, mesh.nodes[:, 2] == 0, relaxation={1: SLOW}, inertia=pp.Inertia())
    many = {1: pp.Relaxation((0.1,) * 3, (0.01, 0.1, 1.0)), 2: pp.Relaxation((0.1,) * 2, (0.03, 10.0))}
    tissue = pp.Tissue(mesh, 5.0, 0.4, mesh.nodes[:, 2] == 0, relaxation=many)
    with pytest.raises(MaterialError, match="5 relaxation times"):
        pp.model(tissue, "compliance")
