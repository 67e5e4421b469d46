import numpy as np
import pytest

import palpate as pp
from palpate import _core
from palpate.errors import DataError

GRID = pp.Grid((4, 5, 40), (2.0, 0.7, 1.1), (0, 0, 0))
PRIORS = [pp.Prior("lange", 1, 0.01), pp.Prior("huber", 1, 0.01), pp.Prior("quadratic", 1)]


def psi(prior, t):
    t, d = np.abs(t), prior.edge
    if prior.potential == "lange":
        return d**2 * (t / d - np.log1p(t / d))
    if prior.potential == "huber":
        return np.where(t <= d, t**2 / 2, d * t - d**2 / 2)
    return t**2 / 2


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
        weight = d.prod() / (np.linalg.norm(step * d) * d.min())
        total += weight * psi(prior, f[here] - f[there]).sum()
    return total


def noise(seed=0):
    return np.random.default_rng(seed).uniform(0, 0.05, GRID.shape).astype(np.float32)


@pytest.mark.parametrize("prior", PRIORS)
def test_value_sums_each_pair_once(prior):
    assert prior.value(noise(), GRID) == pytest.approx(value(prior, noise(), GRID), rel=1e-6)
    assert prior.value(np.full(GRID.shape, 0.3), GRID) == 0


@pytest.mark.parametrize("prior", PRIORS)
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


@pytest.mark.parametrize("prior", PRIORS)
def test_surrogate_of_one_voxel_lies_above(prior):
    """Moving one voxel: R <= R(f) + R' t + c t²/2 for any t, equality for the quadratic."""
    f = noise(1)
    gradient, curvature = prior.surrogate(f, GRID)
    for voxel in [(0, 0, 0), (2, 3, 17)]:
        for t in (-0.04, -0.003, 0.001, 0.02, 0.3):
            moved = f.astype(np.float64)
            moved[voxel] += t
            gained = value(prior, moved, GRID) - value(prior, f, GRID)
            bound = gradient[voxel] * t + curvature[voxel] * t**2 / 2
            assert gained <= bound + 1e-6 * abs(bound) + 1e-9
            if prior.potential == "quadratic":
                assert gained == pytest.approx(bound, rel=1e-4)


def test_smooth_structure_costs_the_same_on_any_grid():
    """ω is in mm: a linear ramp over the same box costs nearly the same R on cells of half the size."""

    def ramp(n):
        grid = pp.Grid((n, n, n), (16 / n,) * 3, (0, 0, 0))
        x = (np.arange(n) + 0.5) * 16 / n * 1e-3
        return pp.Prior("quadratic", 1).value(np.broadcast_to(x, grid.shape), grid)

    interior = ramp(64) / ramp(32)
    assert interior == pytest.approx(1, abs=0.06)  # the missing pairs at the faces are 1/n of all


def test_same_bits_for_any_number_of_threads():
    answers = []
    for n in (1, 2, 3):
        _core.set_threads(n)
        answers.append((PRIORS[0].value(noise(), GRID), PRIORS[0].surrogate(noise(), GRID)[0].tobytes()))
    _core.set_threads(0)
    assert answers[0] == answers[1] == answers[2]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("gibbs",), ("prior: there is no potential 'gibbs'", "lange")),
        (("lange", -1.0), ("prior strength", "-1.0", "None lets the data choose")),
        (("huber", 1.0, 0.0), ("prior edge", "0.0", "1/mm")),
        (("huber", 1.0, 25.0), ("prior edge", "25.0", "1/mm")),
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
