from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import palpate as pp
from palpate import _core
from palpate.errors import DataError

GRID = pp.Grid((4, 5, 40), (2.0, 0.7, 1.1), (0, 0, 0))


@dataclass(frozen=True)
class LogCosh:
    """Green's potential, in units of the edge."""

    def value(self, t):
        return np.logaddexp(t, -t) - np.log(2)

    def weight(self, t):
        return np.tanh(t) / t


POTENTIALS = ["quadratic", "huber", "lange", "hyperbola", "generalized", LogCosh()]
PRIORS = [pp.Prior(p, 1, 0.01, neighbours=n) for p in POTENTIALS for n in (6, 18, 26)]
PRIORS += [pp.Prior("generalized", 1, 0.01, exponent=q) for q in (1.0, 1.7, 2.0)]
INTERPOLATED = 2e-4  # how far the table of a potential of one's own is from it


def named(prior):
    return f"{prior.potential}-{prior.neighbours}-{prior.exponent}"


def psi(prior, t):
    """From the papers' formulas, float64."""
    t, d = np.abs(np.asarray(t, np.float64)), prior.edge
    if prior.potential == "lange":
        return d**2 * (t / d - np.log1p(t / d))
    if prior.potential == "huber":
        return np.where(t <= d, t**2 / 2, d * t - d**2 / 2)
    if prior.potential == "hyperbola":
        return d**2 * np.expm1(np.log1p((t / d) ** 2) / 2)
    if prior.potential == "generalized":
        return t**2 / 2 / (1 + (t / d) ** (2 - prior.exponent))
    if prior.potential == "quadratic":
        return t**2 / 2
    return d**2 * (t / d + np.log1p(np.exp(-2 * t / d)) - np.log(2))


def value(prior, f, grid):
    """R(f) in float64, each pair once, from the definition."""
    d, total = np.array(grid.spacing), 0.0
    f = f.astype(np.float64)
    for step in np.ndindex(3, 3, 3):
        step = np.array(step) - 1
        if tuple(step) <= (0, 0, 0):
            continue
        here = tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(step, f.shape, strict=True))
        there = tuple(slice(max(0, s), n - max(0, -s)) for s, n in zip(step, f.shape, strict=True))
        if np.count_nonzero(step) > {6: 1, 18: 2, 26: 3}[prior.neighbours]:
            continue
        weight = d.prod() / (np.linalg.norm(step * d) * d.min())
        total += weight * psi(prior, f[here] - f[there]).sum()
    return total


def noise(seed=0):
    return np.random.default_rng(seed).uniform(0, 0.05, GRID.shape).astype(np.float32)


@pytest.mark.parametrize("prior", PRIORS, ids=named)
def test_value_sums_each_pair_once(prior):
    rel = INTERPOLATED if isinstance(prior.potential, LogCosh) else 2e-6
    assert prior.value(noise(), GRID) == pytest.approx(value(prior, noise(), GRID), rel=rel)
    assert prior.value(np.full(GRID.shape, 0.3), GRID) == 0


@pytest.mark.parametrize("prior", PRIORS, ids=named)
def test_gradient_against_finite_differences(prior):
    f = noise().astype(np.float64)
    gradient, _ = prior.surrogate(f, GRID)
    for voxel in [(0, 0, 0), (2, 3, 17), (3, 4, 39), (1, 0, 20)]:
        up, down = f.copy(), f.copy()
        up[voxel] += 1e-5
        down[voxel] -= 1e-5
        fine = (value(prior, up, GRID) - value(prior, down, GRID)) / 2e-5
        assert gradient[voxel] == pytest.approx(fine, rel=1e-3, abs=1e-6)
        assert fine != 0


@settings(max_examples=120, deadline=None)
@given(
    st.sampled_from(PRIORS),
    st.floats(1e-5, 9),
    st.sampled_from([(0, 0, 0), (2, 3, 17), (3, 2, 39)]),
    st.lists(st.floats(-0.3, 0.3), min_size=3, max_size=3),
    st.integers(0, 5),
)
def test_surrogate_of_one_voxel_lies_above(prior, edge, voxel, moves, seed):
    """Moving one voxel: R <= R(f) + R' t + c t²/2 for any t, equality for the quadratic."""
    prior = replace(prior, edge=edge)
    f = noise(seed)
    gradient, curvature = prior.surrogate(f, GRID)
    for t in [*moves, -f[voxel], 1e-3]:  # -f: where it would cross its neighbours and reach 0
        moved = f.astype(np.float64)
        moved[voxel] += t
        gained = around(prior, moved, voxel) - around(prior, f, voxel)
        bound = gradient[voxel] * t + curvature[voxel] * t**2 / 2
        rounding = 4e-6 * (abs(gradient[voxel] * t) + curvature[voxel] * t**2) + 1e-6 * curvature[voxel] * 0.05 * abs(t)
        rounding += 1e-13 * around(prior, moved, voxel)  # the oracle's own: a difference of two sums
        if isinstance(prior.potential, LogCosh):
            rounding += INTERPOLATED * around(prior, moved, voxel)
        assert gained <= bound + rounding
        if prior.potential == "quadratic":
            assert gained == pytest.approx(bound, rel=1e-3, abs=float(rounding))


def around(prior, f, voxel):
    """The part of R that a voxel has a share in."""
    part = tuple(slice(max(0, i - 1), i + 2) for i in voxel)
    return value(prior, f[part], pp.Grid(f[part].shape, GRID.spacing, (0, 0, 0)))


def test_objective_and_slope_of_a_table_are_of_one_function():
    """Finer than the table follows the potential: along a line, the value's difference is the slope's integral."""
    prior, f, step = PRIORS[-4], noise(3), 2e-5
    assert isinstance(prior.potential, LogCosh)
    line = [f.astype(np.float64) + k * step * np.sin(np.arange(f.size)).reshape(f.shape) for k in range(3)]
    values = [prior.value(x, GRID) for x in line]
    gradient = prior.surrogate(line[1], GRID)[0].astype(np.float64)
    assert values[2] - values[0] == pytest.approx((gradient * (line[2] - line[0])).sum(), rel=2e-4)


def test_smooth_structure_costs_the_same_on_any_grid():
    """ω is in mm: a linear ramp over the same box costs nearly the same R on cells of half the size."""

    def ramp(n):
        grid = pp.Grid((n, n, n), (16 / n,) * 3, (0, 0, 0))
        x = (np.arange(n) + 0.5) * 16 / n * 1e-3
        return pp.Prior("quadratic", 1).value(np.broadcast_to(x, grid.shape), grid)

    interior = ramp(64) / ramp(32)
    assert interior == pytest.approx(1, abs=0.06)  # the missing pairs at the faces are 1/n of all


@pytest.mark.parametrize("prior", PRIORS, ids=named)
def test_same_bits_for_any_number_of_threads(prior):
    answers = []
    for n in (1, 2, 3):
        _core.base.set_threads(n)
        answers.append((prior.value(noise(), GRID), *(a.tobytes() for a in prior.surrogate(noise(), GRID))))
    _core.base.set_threads(0)
    assert answers[0] == answers[1] == answers[2]


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.9, 2.0])
def test_fast_power_keeps_six_digits(exponent):
    """Over 80 doublings of t/δ. Two voxels, no other pair: the curvature is ω ψ'(t)/t."""
    grid = pp.Grid((1, 1, 2), (1, 1, 1), (0, 0, 0))
    for s in 2.0 ** np.arange(-40, 41, 0.37):
        edge = min(1.0, 9 / s)
        prior = pp.Prior("generalized", 1, edge, exponent=exponent)
        f = np.array([0, s * edge], np.float32).reshape(grid.shape)
        s = np.float64(f.max()) / np.float64(np.float32(edge))
        u = s ** (2 - exponent)
        expected = (1 + exponent / 2 * u) / (1 + u) ** 2
        assert prior.surrogate(f, grid)[1].max() == pytest.approx(expected, rel=3e-6)


def test_a_table_of_lange_does_what_lange_does():
    class Own:
        def value(self, t):
            return np.abs(t) - np.log1p(np.abs(t))

        def weight(self, t):
            return 1 / (1 + np.abs(t))

    for edge in (1e-4, 0.01, 1.0):
        own, lange = pp.Prior(Own(), 1, edge), pp.Prior("lange", 1, edge)
        assert own.value(noise(), GRID) == pytest.approx(lange.value(noise(), GRID), rel=INTERPOLATED)
        for made, expected in zip(own.surrogate(noise(), GRID), lange.surrogate(noise(), GRID), strict=True):
            np.testing.assert_allclose(made, expected, rtol=0, atol=INTERPOLATED * np.abs(expected).max())


def test_steps_that_are_no_neighbours_have_no_pair():
    """One voxel alone is tied to just so many others."""
    f = np.zeros((3, 3, 3), np.float32)
    f[1, 1, 1] = 1
    for neighbours in (6, 18, 26):
        gradient, _ = pp.Prior("quadratic", 1, neighbours=neighbours).surrogate(
            f, pp.Grid(f.shape, (1, 1, 1), (0, 0, 0))
        )
        assert np.count_nonzero(gradient) == 1 + neighbours


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("gibbs",), ("prior: there is no potential 'gibbs'", "lange")),
        (("lange", -1.0), ("prior strength", "-1.0", "None lets the data choose")),
        (("huber", 1.0, 0.0), ("prior edge", "0.0", "1/mm")),
        (("huber", 1.0, 25.0), ("prior edge", "25.0", "1/mm")),
        (("lange", 1.0, 0.1, 8), ("prior neighbours", "6, 18 or 26", "8")),
        (("generalized", 1.0, 0.1, 26, 0.7), ("prior exponent", "0.7")),
        ((LogCosh,), ("an object with value(t) and weight(t)",)),
        ((3,), ("an object with value(t) and weight(t)", "3")),
    ],
)
def test_priors_that_cannot_be_are_refused(arguments, told):
    with pytest.raises(DataError) as refusal:
        pp.Prior(*arguments)
    for words in told:
        assert words in str(refusal.value)


def test_an_edge_left_open_is_refused_where_it_is_needed():
    with pytest.raises(DataError, match="prior edge: a lange potential needs one"):
        pp.Prior("lange", 1).value(noise(), GRID)


@pytest.mark.parametrize(
    ("value", "weight", "told"),
    [
        (lambda t: t**2 / 2, lambda t: 1.0, "weight(t) of t with shape"),
        (lambda t: np.cosh(t) - 1, lambda t: np.sinh(t) / t, "value(t) is not finite (first at t = 7"),
        (lambda t: np.where(t > 0, t**2, 2 * t**2), lambda t: 2 + 0 * t, "value(t) is not even"),
        (lambda t: -(t**2), lambda t: -2 + 0 * t, "value(t) is negative"),
        (lambda t: t**4 / 4, lambda t: t**2, "weight(t) grows with |t|"),
        (lambda t: t**2, lambda t: 1 + 0 * t, "value(t) is not the integral of t weight(t)"),
        (lambda t: 0 * t, lambda t: 0 * t, "weight(t) near 0 is 0"),
    ],
)
def test_what_is_no_potential_is_refused(value, weight, told):
    own = type("Own", (), {"value": staticmethod(value), "weight": staticmethod(weight)})()
    with pytest.raises(DataError) as refusal:
        pp.Prior(own)
    assert told in str(refusal.value)


@pytest.mark.parametrize("size", [1e-6, 1e-3, 0.1, 1.0, 40.0, 1e5, 1e12])
def test_lange_keeps_its_digits_from_tiny_to_huge_differences(size):
    """In edges: s²/2 where s − log(1 + s) as written has none left, and sums of products where those would overflow."""
    for n in (2, 9, 70, 333):
        grid = pp.Grid((1, 2, n), (1, 1, 1), (0, 0, 0))
        f = (np.random.default_rng(n).uniform(0, 1, grid.shape) * size).astype(np.float32)
        prior, d = pp.Prior("lange", 1, edge=1.0, neighbours=6), []
        for a, b in ((f[:, 1:], f[:, :-1]), (f[..., 1:], f[..., :-1])):
            d.append(np.abs(a - b).astype(np.float64).ravel())
        s = np.concatenate(d)
        exact = np.where(s < 1e-3, s**2 / 2 - s**3 / 3 + s**4 / 4, s - np.log1p(s)).sum()
        assert prior.value(f, grid) == pytest.approx(exact, rel=1e-6)
