"""The Monte Carlo of scatter: cross sections, angles, energies and single scatter against closed forms and integrals."""

import numpy as np
import pytest

from palpate import _core
from palpate.errors import DataError
from palpate.scans.scatter.cross_sections import attenuation, elements, mass_attenuation, material, monte_carlo_tables
from palpate.scans.scatter.monte_carlo import LINEAR_GRID, AntiscatterGrid, Part, pencil_kernels, scatter_image

REST = 510.99895  # keV, of an electron
SLAB = Part("breast", (-1e4, -1e4, 15.0), (1e4, 1e4, 45.0))

# μ/ρ, cm²/g, at 15, 20, 30, 40, 50, 60 keV: Hubbell & Seltzer, NISTIR 5632 (1995), tables 4 of physics.nist.gov
NIST = {
    "water": (1.673, 0.8096, 0.3756, 0.2683, 0.2269, 0.2059),
    "adipose ICRU-44": (1.083, 0.5677, 0.3063, 0.2396, 0.2123, 0.1974),
    "breast ICRU-44": (1.378, 0.6889, 0.3403, 0.2530, 0.2186, 0.2006),
    "PMMA": (1.101, 0.5714, 0.3032, 0.2350, 0.2074, 0.1924),
}


@pytest.mark.parametrize("name", NIST)
def test_attenuation_is_that_of_nist_within_two_percent(name):
    np.testing.assert_allclose(mass_attenuation(name, (15, 20, 30, 40, 50, 60)), NIST[name], rtol=0.02)


def test_unknown_materials_and_energies_are_refused():
    with pytest.raises(DataError, match="no 'butter'"):
        material("butter")
    with pytest.raises(DataError, match="5 to 150 keV"):
        mass_attenuation("water", [3.0])


def samples(compton: bool, keV: float, count: int, seed: int = 1) -> np.ndarray:
    return np.asarray(_core.scatter.samples(*monte_carlo_tables(["water"]), compton, keV, count, seed))


def interpolated(name: str, z: int, x: np.ndarray) -> np.ndarray:
    table = elements()
    return np.interp(x, table["x"], table[name][list(table["z"]).index(z)])


def differential(compton: bool, keV: float, cosine: np.ndarray) -> np.ndarray:
    """dσ/dΩ of a water molecule, cm²/sr without r₀²/2, from the table of elements."""
    x = keV / 12.398419843 * np.sqrt((1 - cosine) / 2)
    if not compton:
        F2 = 2 * interpolated("F", 1, x) ** 2 + interpolated("F", 8, x) ** 2
        return (1 + cosine**2) * F2
    e = 1 / (1 + keV / REST * (1 - cosine))
    S = 2 * interpolated("S", 1, x) + interpolated("S", 8, x)
    return e**2 * (e + 1 / e - (1 - cosine**2)) * S


@pytest.mark.parametrize("keV", [18.0, 45.0])
def test_energy_after_compton_follows_the_angle(keV):
    cosine, after = samples(True, keV, 2000).T
    np.testing.assert_allclose(after, keV / (1 + keV / REST * (1 - cosine)), rtol=1e-12)
    assert cosine.min() < -0.9 < 0.9 < cosine.max()


@pytest.mark.parametrize("compton", [True, False])
@pytest.mark.parametrize("keV", [18.0, 45.0])
def test_angles_follow_the_differential_cross_section(compton, keV):
    count, edges = 200_000, np.linspace(-1, 1, 41)
    seen = np.histogram(samples(compton, keV, count)[:, 0], edges)[0]
    fine = np.linspace(-1, 1, 400 * 40 + 1)
    middle = (fine[1:] + fine[:-1]) / 2
    expected = differential(compton, keV, middle).reshape(40, 400).sum(axis=1)
    expected *= count / expected.sum()
    many = expected > 20
    chi2 = ((seen - expected)[many] ** 2 / expected[many]).sum()
    free = np.count_nonzero(many) - 1
    assert abs(chi2 - free) < 4 * np.sqrt(2 * free)


def test_what_a_slab_lets_through_falls_exponentially():
    photons, keV = 400_000, 22.0
    found = scatter_image([SLAB], (0, 0, 600), (0, 0, 0, 0), (1, 1), 2.0, (-1, -1), keV, 1.0, photons, 3)
    expected = photons * np.exp(-attenuation("breast", keV) * 30)
    assert abs(found.primary.sum() / keV - expected) < 4 * np.sqrt(expected)


def test_energy_is_kept_and_goes_to_body_or_space():
    found = scatter_image([SLAB], (0, 0, 600), (-20, 0, 20, 40), (4, 4), 10.0, (-20, 0), [20, 30], [1, 1], 50_000, 4)
    assert found.deposited > 0.2 * found.emitted
    assert found.escaped > 0.05 * found.emitted
    assert found.deposited + found.escaped == pytest.approx(found.emitted, rel=1e-6)
    assert found.emitted == pytest.approx(25 * 50_000, rel=0.01)


def test_energy_is_kept_where_photons_leave_the_table_of_cross_sections():
    """Just above its lowest energy a Compton recoil takes a photon below: what it still has stays in the body."""
    found = scatter_image([SLAB], (0, 0, 600), (-20, 0, 20, 40), (4, 4), 10.0, (-20, 0), 5.02, 1.0, 200_000, 4)
    assert found.deposited + found.escaped == pytest.approx(found.emitted, rel=1e-6)


def test_a_seed_gives_one_answer_for_any_number_of_threads():
    def run(seed):
        return scatter_image([SLAB], (0, 0, 600), (-20, 0, 20, 40), (8, 8), 5.0, (-20, 0), 20.0, 1.0, 20_000, seed)

    before = _core.base.threads()
    try:
        _core.base.set_threads(1)
        alone = run(5)
        _core.base.set_threads(3)
        np.testing.assert_array_equal(run(5).scatter, alone.scatter)
    finally:
        _core.base.set_threads(before)
    assert (run(6).scatter != alone.scatter).any()


def single_scatter(keV: float, thickness: float, gap: float, edges: np.ndarray) -> np.ndarray:
    """Energy scattered once to each ring under a pencil beam, over the energy sent: an integral over depth and angle."""
    z = (np.arange(400) + 0.5) * thickness / 400  # depth
    angle = (np.arange(3000) + 0.5) * (np.pi / 2) / 3000
    cosine = np.cos(angle)
    inside, found = np.exp(-attenuation("water", keV) * z), np.zeros(len(edges) - 1)
    full = np.linspace(0, np.pi, 20_001)
    for compton in (True, False):
        shape = differential(compton, keV, cosine) * np.sin(angle)
        whole = np.trapezoid(differential(compton, keV, np.cos(full)) * np.sin(full), full)
        process = "compton" if compton else "rayleigh"
        mu = mass_attenuation("water", keV, [process]) / 10
        after = keV / (1 + keV / REST * (1 - cosine)) if compton else np.full_like(cosine, keV)
        rest = attenuation("water", after)
        below = thickness - z[:, None]
        arrives = np.exp(-rest * below / cosine) * after / keV * shape / whole
        energy = mu * inside[:, None] * arrives * (thickness / 400) * (np.pi / 2 / 3000)
        r = (below + gap) * np.tan(angle)
        found += np.histogram(r, edges, weights=energy)[0]
    return found


@pytest.mark.parametrize(("keV", "gap"), [(18.0, 15.0), (32.0, 40.0)])
def test_single_scatter_is_that_of_a_deterministic_integral(keV, gap):
    """Within 3 % in all and five standard deviations in each ring."""
    photons, thickness, half = 1_500_000, 40.0, 100
    slab = Part("water", (-1e4, -1e4, gap), (1e4, 1e4, gap + thickness))
    found = scatter_image(
        [slab], (0, 0, 600), (0, 0, 0, 0), (2 * half, 2 * half), 1.0, (-half, -half), keV, 1.0, photons, 8
    )
    y, x = np.mgrid[-half:half, -half:half] + 0.5
    edges = np.array([0.0, 15, 30, 50, 75, 99])
    energy = np.histogram(np.hypot(x, y), edges, weights=found.compton + found.rayleigh)[0]
    expected = single_scatter(keV, thickness, gap, edges) * photons * keV
    assert energy.sum() == pytest.approx(expected.sum(), rel=0.03)
    assert (np.abs(energy - expected) < 5 * np.sqrt(expected * keV) + 0.01 * expected).all()


def test_kernels_are_the_image_of_a_pencil_beam():
    edges = np.array([0.0, 20, 50, 90])
    rings = pencil_kernels("breast", 30.0, 20.0, [15.0], edges, [AntiscatterGrid(0, 0, 0)], 400_000, 2)[0, 0]
    found = scatter_image([SLAB], (0, 0, 600), (0, 0, 0, 0), (200, 200), 1.0, (-100, -100), 20.0, 1.0, 400_000, 3)
    y, x = np.mgrid[-100:100, -100:100] + 0.5
    expected = np.histogram(np.hypot(x, y), edges, weights=found.scatter)[0]
    np.testing.assert_allclose(rings[:-1], expected, rtol=0.05)
    assert abs(rings[-1]) < 2 * rings[:-1].sum()  # its middle lies within 2 mm of the pencil


def septa_by_sampling(grid: AntiscatterGrid, keV: float, tangent: float) -> float:
    """Mean over 4,000 places of rays in the plane across the septa, in 4,000 steps of depth."""
    depth = (np.arange(4000) + 0.5) / 4000 * grid.height
    x = np.arange(4000)[:, None] / 4000 * (grid.septum + grid.interspace) + tangent * depth
    lead = (x % (grid.septum + grid.interspace) < grid.septum).mean(axis=1)
    path = grid.height * np.hypot(1, tangent)
    mu, open_ = attenuation("lead", keV), attenuation("polystyrene", keV)
    return float(np.exp(-path * (mu * lead + open_ * (1 - lead))).mean())


@pytest.mark.parametrize("tangent", [0.0, 0.02, 0.15, 0.3, 0.7])
def test_grid_lets_through_what_rays_through_its_septa_say(tangent):
    """A weak grid, so that each part of the formula matters."""
    grid, keV = AntiscatterGrid(1.0, 0.004, 0.2), 60.0
    sizes = (grid.height, grid.septum, grid.interspace)
    mu = [float(attenuation(name, keV)) for name in ("lead", "polystyrene")]
    passed = _core.scatter.grid_transmission(sizes, *mu, tangent, float(np.hypot(1, tangent)))
    assert passed == pytest.approx(septa_by_sampling(grid, keV, tangent), rel=2e-3)


def test_primary_behind_a_grid_is_that_of_open_and_covered_parts():
    photons, keV = 100_000, 20.0
    found = scatter_image(
        [SLAB], (0, 0, 600), (-30, 0, 30, 30), (1, 2), 30.0, (-30, 0), keV, 1.0, photons, 3, LINEAR_GRID
    )
    bare = scatter_image([SLAB], (0, 0, 600), (-30, 0, 30, 30), (1, 2), 30.0, (-30, 0), keV, 1.0, photons, 3)
    ratio = found.primary.sum() / bare.primary.sum()
    assert ratio == pytest.approx(float(LINEAR_GRID.transmission(keV)), rel=0.02)
    assert found.scatter.sum() < 0.35 * bare.scatter.sum()
