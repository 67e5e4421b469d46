"""What a hand feels of a tissue, in frequency and in the closed loop with a device, against closed forms."""

import numpy as np
import pytest
from support.brick_meshes import block
from support.example_organs import organ

import palpate as pp
from palpate import _core
from palpate.errors import DataError, MaterialError
from palpate.simulation.rendered_chain import TICK, RenderedChain
from palpate.simulation.z_width import ClosedLoop

RADIUS, TOP = 12.0, (25.0, 25.0, 50.0)
WIDE = [0.1, 1.0, 3.3, 10.0, 30.0, 100.0]
SPECTRUM = pp.Relaxation((0.35, 0.25), (0.03, 0.4))
APPROACH = 0.08  # of a held tool, a tick


@pytest.fixture(scope="module")
def elastic():
    return pp.model(block(7, poisson=0.45), "compliance")


@pytest.fixture(scope="module")
def relaxing():
    return pp.model(block(7, poisson=0.45, relaxation=SPECTRUM), "compliance")


def delay(hertz):
    """z⁻¹ of a tick."""
    return np.exp(-2j * np.pi * np.asarray(hertz) * TICK)


def motion_filter(hertz):
    """Of a held tool: y += APPROACH (x − y)."""
    return APPROACH / (1 - (1 - APPROACH) * delay(hertz))


def test_a_tool_in_space_is_transparent(elastic):
    felt = pp.transparency(elastic, TOP, RADIUS, WIDE)
    np.testing.assert_allclose(felt.ratio, 1, atol=1e-3)
    assert felt.distortion.max() < 1e-3
    assert felt.bandwidth == np.inf


@pytest.mark.parametrize("name", ["compliance", "blocks"])
def test_at_low_frequency_an_organ_feels_as_it_is_pushed(name):
    tissue = organ(7)
    top = tissue.mesh.nodes[tissue.mesh.nodes[:, 2].argmax()]
    felt = pp.transparency(pp.model(tissue, name), top, 9.0, [0.5], sweeps=20)
    np.testing.assert_allclose(felt.ratio, 1, atol=0.02)


def test_a_held_tool_feels_behind_its_motion_filter(elastic):
    felt = pp.transparency(elastic, TOP, RADIUS, WIDE, kind="hold")
    np.testing.assert_allclose(felt.ratio / motion_filter(WIDE), 1, atol=0.02)
    fine = np.geomspace(1, 50, 2000)
    cut = fine[np.abs(motion_filter(fine)) < 10 ** (-3 / 20)][0]
    late = fine[np.degrees(np.angle(motion_filter(fine))) < -45][0]
    assert felt.bandwidth == pytest.approx(min(cut, late), rel=0.15)  # read off between 10 and 30 Hz


def test_a_relaxing_tissue_has_its_complex_modulus(relaxing, elastic):
    felt = pp.transparency(relaxing, TOP, RADIUS, WIDE)
    long_term = pp.transparency(elastic, TOP, RADIUS, [1.0]).tissue[0].real
    s = 2j * np.pi * np.array(WIDE)
    modulus = 1 + sum(
        share / (1 - sum(SPECTRUM.shares)) * s * tau / (1 + s * tau)
        for share, tau in zip(SPECTRUM.shares, SPECTRUM.times, strict=True)
    )
    np.testing.assert_allclose(felt.tissue, long_term * modulus, rtol=1e-4)
    np.testing.assert_allclose(felt.rendered / (long_term * modulus), 1, atol=2e-3)


@pytest.mark.parametrize("kind", ["free", "hold"])
def test_behind_a_coupling_the_hand_feels_both_springs_in_series(elastic, relaxing, kind):
    """Of a held tool too: the servo goes on from where the tool is, not from where it was sent."""
    coupling, hertz = 0.5, [0.5, 3.0, 10.0, 20.0]
    felt = pp.transparency(elastic, TOP, RADIUS, hertz, coupling=coupling, kind=kind)
    damper = min(_core.haptics.ServoSettings().damping, 1e-3 * coupling)
    spring = coupling + damper * (1 - delay(hertz)) / TICK  # implicit Euler
    np.testing.assert_allclose(felt.rendered, spring * felt.tissue / (spring + felt.tissue), rtol=0.02)
    felt = pp.transparency(relaxing, TOP, RADIUS, hertz, coupling=coupling, kind=kind)
    ratio = felt.rendered / (spring * felt.tissue / (spring + felt.tissue))
    assert np.abs(20 * np.log10(np.abs(ratio))).max() < 1  # the servo does not know how much relaxes within a tick
    assert np.abs(np.degrees(np.angle(ratio))).max() < 5


def test_no_period_gives_the_hand_energy(elastic, relaxing):
    """But for a held tool without a coupling: its force lags its command."""
    for model, coupling in ((elastic, None), (relaxing, None), (elastic, 0.5), (relaxing, 0.5)):
        felt = pp.transparency(model, TOP, RADIUS, [1.0, 10.0, 20.0, 30.0], coupling=coupling)
        whole = np.pi * felt.amplitude**2 * np.abs(felt.rendered)
        assert (felt.dissipated > -1e-4 * whole).all()
    held = pp.transparency(elastic, TOP, RADIUS, [10.0], kind="hold")
    assert held.dissipated[0] < 0


@pytest.mark.parametrize("seed", range(4))
def test_no_way_of_a_hand_gains_energy_from_tissue_that_relaxes(relaxing, seed):
    rng, s = np.random.default_rng(seed), np.arange(3000) * TICK
    way = 1 - np.exp(-s / 0.05)
    for hertz in rng.uniform(0.5, 30, 12):
        way += 0.5 * rng.normal() * min(1, 3 / hertz) * np.sin(2 * np.pi * hertz * s + rng.uniform(0, 2 * np.pi))
    chain = RenderedChain(relaxing, TOP, RADIUS, coupling=2.0)
    depths = [*[chain.depth] * 600, *(way - way[0] + chain.depth), *np.linspace(way[-1] - way[0], -0.1, 500)]
    forces = np.array([chain.tick(float(depth)) for depth in depths])
    work = np.cumsum(forces[:-1] * np.diff(depths))  # N mm, of the hand: a device holds a force until the next tick
    assert work.max() > 0.1
    assert work.min() > -0.01 * work.max()
    assert work[-1] > 0


def test_a_force_limit_shows_as_distortion(elastic):
    stiffness = pp.transparency(elastic, TOP, RADIUS, [5.0]).tissue[0].real
    felt = pp.transparency(elastic, TOP, RADIUS, [5.0], amplitude=0.5, limit=stiffness)
    assert felt.distortion[0] > 0.2
    assert felt.decibels[0] < -3
    assert felt.bandwidth == 0


def test_the_coupled_chain_is_the_one_that_a_device_runs(elastic):
    chain = RenderedChain(elastic, TOP, RADIUS, coupling=0.5)
    servo = _core.haptics.Servo(chain._servo_settings(0.5, 20.0))
    device = _core.haptics.ServoDevice(servo)
    session = pp.Session(elastic, radius=RADIUS)
    depths = [-0.1] * 600 + list(np.linspace(-0.1, 1, 50)) + list(1 + 0.2 * np.sin(0.3 * np.arange(800)))
    found, expected = [], []
    for n, depth in enumerate(depths, 1):
        found.append(chain.tick(float(depth)))
        felt = servo.tick((-depth * chain.normal).tolist(), 0, 1_000_000 * (1000 + n))
        session.loop.step(device, 1)
        expected.append(np.array(felt) @ chain.normal)
    assert max(expected) > 0.05
    np.testing.assert_allclose(found, expected, atol=1e-9)


class Wall:
    """A plain virtual wall, sampled and held."""

    def __init__(self, stiffness):
        self.stiffness = stiffness

    def tick(self, depth):
        return self.stiffness * depth


def greatest(loop, low, high, wall=Wall):
    """N/mm at which a loop with a wall is no longer stable."""
    for _ in range(12):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if loop.fades(wall(middle), middle, 1.0) else (low, middle)
    return low


@pytest.mark.parametrize(("mass", "damping"), [(0.1, 5e-4), (0.1, 2e-3), (0.3, 1e-3)])
def test_a_plain_wall_is_stable_up_to_the_closed_form(mass, damping):
    """b > K T/2 (Colgate & Brown 1994)."""
    wall = 2 * damping / TICK
    assert greatest(ClosedLoop(mass, damping, pp.HandImpedance()), wall / 4, 4 * wall) == pytest.approx(wall, rel=0.01)
    with_hand = ClosedLoop(mass, damping, pp.HandImpedance(damping=damping))
    assert greatest(with_hand, wall / 4, 8 * wall) == pytest.approx(2 * wall, rel=0.02)


def test_a_tissue_is_stable_as_far_as_a_plain_wall(elastic):
    found = pp.z_width(elastic, TOP, RADIUS)
    assert found.bound == "passivity"
    assert found.least == 0
    assert found.greatest == pytest.approx(found.virtual_wall, rel=0.01)
    assert found.scale * pp.transparency(elastic, TOP, RADIUS, [5.0]).tissue[0].real == pytest.approx(
        found.greatest, rel=0.01
    )


def test_a_held_tool_shows_much_less(elastic):
    """The poles of device, hold and motion filter lie on the unit circle at the greatest stiffness."""
    mass, damping = 0.1, 5e-4
    (xx, xv, xf), (vx, vv, vf) = ClosedLoop(mass, damping, pp.HandImpedance()).step

    def growth(k):
        follows = np.array([APPROACH, 0, 1 - APPROACH])  # of (x, v, y): y after the tick
        free = np.array([[xx, xv, 0], [vx, vv, 0], [0, 0, 0]])
        return np.abs(np.linalg.eigvals(free - k * np.outer([xf, vf, 0], follows) + np.outer([0, 0, 1], follows))).max()

    low, high = 1e-4, 1.0
    for _ in range(40):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if growth(middle) < 1 else (low, middle)
    found = pp.z_width(elastic, TOP, RADIUS, mass=mass, damping=damping, kind="hold")
    assert found.greatest == pytest.approx(low, rel=0.02)
    assert found.greatest < 0.1 * found.virtual_wall


def test_limit_and_coupling_end_the_range(elastic):
    limited = pp.z_width(elastic, TOP, RADIUS, limit=0.5)
    assert limited.bound == "force"
    assert 0.2 < limited.greatest < 0.5
    coupled = pp.z_width(elastic, TOP, RADIUS, coupling=0.5)
    assert coupled.bound == "coupling"
    assert coupled.greatest == pytest.approx(0.5, rel=0.02)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"frequencies": []}, "frequencies"),
        ({"frequencies": [0.0, 1.0]}, "more than 0"),
        ({"frequencies": [300.0]}, "at most 250"),
        ({"frequencies": [np.nan]}, "not finite"),
        ({"amplitude": 1.0}, "amplitude: 1 mm"),
        ({"amplitude": -0.1}, "amplitude"),
        ({"depth": np.inf}, "depth"),
        ({"kind": "needle"}, "kind: 'needle'"),
        ({"coupling": 0.0}, "coupling: 0"),
        ({"limit": 0.0}, "limit: 0"),
        ({"point": (25.0, 25.0, 90.0)}, "off the surface"),
        ({"radius": -1.0}, "radius"),
    ],
)
def test_what_cannot_be_measured_is_refused(elastic, changes, complaint):
    given = {"point": TOP, "radius": RADIUS, "frequencies": [1.0], **changes}
    with pytest.raises(DataError, match=complaint):
        pp.transparency(elastic, **given)


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"mass": 0.0}, "mass: 0"),
        ({"damping": -1.0}, "damping: -1"),
        ({"depth": 0.0}, "depth"),
        ({"limit": 0.1}, "N of"),
    ],
)
def test_a_device_that_cannot_be_is_refused(elastic, changes, complaint):
    with pytest.raises(DataError, match=complaint):
        pp.z_width(elastic, TOP, RADIUS, **changes)
    with pytest.raises(DataError, match="hand: mass -1"):
        pp.HandImpedance(mass=-1.0)


def test_a_tissue_whose_own_stiffness_is_not_known_is_refused():
    shear = block(3, relaxation=pp.Relaxation((0.5,), (0.2,), bulk=False))
    swinging = block(3, inertia=pp.Inertia(modes=3))
    for tissue, complaint in ((shear, "relax differently"), (swinging, "has inertia")):
        with pytest.raises(MaterialError, match=complaint):
            pp.transparency(pp.model(tissue, "compliance"), TOP, 20.0, [1.0])
