"""Tissue whose parts relax differently: its stiffness over the Laplace variable, and the creep that follows it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq, linprog

from palpate.arrays import ArrayLike, Float64, Int32
from palpate.errors import MaterialError
from palpate.tissue.relaxation import Relaxation

MOST_TIMES = 7  # creep times: what the core takes
WIDE = 3.0  # from this ratio of its ends on, an interval gets a time in its middle, too
LARGEST = 100.0  # of the mix: the tables are in single precision
_STEPS, _MOMENTS = 15, 40  # times of an interval, and moments, at which the fit is judged


@dataclass(frozen=True, eq=False)
class CreepFit:
    """Creep of a body whose parts relax differently: u = G(∞) f + Σ_k C_k x_k with τ_k dx_k/dt = f − x_k.

    G(s) is the body's compliance at the Laplace variable s, and C_k = Σ_j mix_kj G(s_j).

    times: (k,) s, the τ_k. samples: (j,) 1/s, the s_j from 0 to ∞. mix: (k, j). error: bound on the error of the creeping
    displacement under a constant force, relative to what it becomes in the end.
    """

    times: Float64
    samples: Float64
    mix: Float64
    error: float


def by_region(relaxation: Relaxation | Mapping[int, Relaxation] | None, region: Int32) -> dict[int, Relaxation]:
    """The relaxation of each region that relaxes. region: (M,) of the tetrahedra."""
    if isinstance(relaxation, Relaxation):
        return {int(number): relaxation for number in np.unique(region)}
    return dict(relaxation or {})


def at_rate(
    young: Float64, poisson: Float64, region: Int32, relaxations: Mapping[int, Relaxation], s: float
) -> tuple[Float64, Float64]:
    """(M,) Young's modulus, kPa, and Poisson's ratio of the tetrahedra at the Laplace variable s, 1/s, 0 to inf.

    young, poisson: (M,) in the long term. Where the bulk does not relax, the bulk modulus stays, and Poisson's ratio changes.
    """
    stiff, ratio = young.copy(), poisson.copy()
    for number, one in relaxations.items():
        inside, rise = region == number, one.at_rate(s)
        stiff[inside] *= rise
        if not one.bulk:
            shear = young[inside] / (2 * (1 + poisson[inside])) * rise
            bulk = young[inside] / (3 * (1 - 2 * poisson[inside]))
            stiff[inside] = 9 * bulk * shear / (3 * bulk + shear)
            ratio[inside] = (3 * bulk - 2 * shear) / (2 * (3 * bulk + shear))
    return stiff, ratio


def creep_of(relaxations: Iterable[Relaxation]) -> CreepFit:
    """The creep of a body whose parts relax so.

    Raises `MaterialError` if they have too many relaxation times together.
    """
    most: dict[float, float] = {}
    for one in relaxations:
        for share, time in zip(one.shares, one.times, strict=True):
            most[time] = max(most.get(time, 0.0), share * one.instantaneous)
    times = sorted(most)
    return _fit(tuple(times), tuple(most[time] for time in times))


def creep_intervals(times: ArrayLike, ratios: ArrayLike) -> list[tuple[float, float]]:
    """Intervals, s, which hold all creep times of a body with K(s) = K + Σ_k D_k sτ_k/(1 + sτ_k).

    times: (k,) s, the τ_k, ascending. ratios: (k,) such that 0 ≤ D_k ≤ ratio_k K. A creep time is −1/s where K(s) v = 0;
    so it is a zero of vᵀK(s)v, a scalar function that has one between each two poles. The zero after τ_k is the later, the
    larger the terms up to k and the smaller those after it.
    """
    tau, ratio = np.asarray(times, dtype=np.float64), np.asarray(ratios, dtype=np.float64)
    found = []
    for k in range(len(tau)):

        def stiffness(x: float, k: int = k) -> float:
            return float(1 - (ratio[: k + 1] * x * tau[: k + 1] / (1 - x * tau[: k + 1])).sum())

        slow = 1 / brentq(stiffness, 1e-12 / tau[k], (1 - 1e-12) / tau[k])
        found.append((float(tau[k]), min(slow, float(tau[k + 1])) if k + 1 < len(tau) else slow))
    return found


@lru_cache(maxsize=32)
def _fit(times: tuple[float, ...], ratios: tuple[float, ...]) -> CreepFit:
    """The mix with the least error among those that never give energy, by a linear programme.

    The compliance is G(s) = G(∞) + ∫ dM(τ)/(1 + sτ), with a positive semidefinite measure M on the intervals. A mix makes
    C_k = ∫ l_k(τ) dM(τ) of it, with l_k(τ) = Σ_j mix_kj/(1 + s_jτ). So whatever the body is, C_k is positive semidefinite
    if l_k ≥ 0 on the intervals, the long-term compliance is exact if Σ_k l_k = 1, and the error under a constant force is
    at most the largest |Σ_k l_k(τ) exp(−t/τ_k) − exp(−t/τ)|.
    """
    intervals = creep_intervals(times, ratios)
    poles = _creep_times(intervals)
    if len(poles) > MOST_TIMES:
        raise MaterialError(
            f"relaxation: the regions have {len(times)} relaxation times together; where parts relax differently, at most "
            f"3 can be followed; give regions the same times"
        )
    samples = np.concatenate([[0.0], 1 / np.sqrt(poles[1:] * poles[:-1])[::-1]])
    tau = np.unique(np.concatenate([np.geomspace(*ends, _STEPS) for ends in intervals]))
    t = np.geomspace(poles[0] / 20, 8 * poles[-1], _MOMENTS)
    seen = 1 / (1 + np.outer(samples, tau))  # (j, τ)
    fitted = np.einsum("tk,js->tskj", np.exp(-t[:, None] / poles), seen).reshape(len(t) * len(tau), -1)
    true = np.exp(-t[:, None] / tau).ravel()
    sign = np.einsum("ki,js->kisj", -np.eye(len(poles)), seen).swapaxes(1, 2).reshape(len(poles) * len(tau), -1)
    column = np.ones((len(fitted), 1))
    rows = np.vstack([np.hstack([fitted, -column]), np.hstack([-fitted, -column]), np.pad(sign, ((0, 0), (0, 1)))])
    whole = np.pad(np.tile(np.eye(len(samples)), len(poles)), ((0, 0), (0, 1)))  # Σ_k mix_kj is 1 for s = 0, else 0
    cost = np.append(np.zeros(fitted.shape[1]), 1.0)
    found = linprog(
        cost,
        rows,
        np.concatenate([true, -true, np.zeros(len(sign))]),
        whole,
        np.eye(len(samples))[0],
        [(-LARGEST, LARGEST)] * fitted.shape[1] + [(0, None)],
        method="highs",
    )
    if found.x is None:
        raise MaterialError(
            f"relaxation: times {', '.join(f'{time:g}' for time in times)} s of parts that relax differently cannot be told "
            f"apart; give them one time where they are nearly equal"
        )
    mix = found.x[:-1].reshape(len(poles), len(samples))
    mix = np.hstack([mix, -mix.sum(axis=1, keepdims=True)])
    return CreepFit(poles, np.append(samples, np.inf), mix, float(found.x[-1]))


def _creep_times(intervals: list[tuple[float, float]]) -> Float64:
    """(k,) s, ascending: the ends of the intervals, and as far as there is room the middles of the widest."""
    ends = sorted(time for interval in intervals for time in interval)
    times = [ends[0], *(b for a, b in pairwise(ends) if b > 1.02 * a)]
    wide = [(high / low, float(np.sqrt(low * high))) for low, high in intervals if high > WIDE * low]
    middles = [middle for _, middle in sorted(wide, reverse=True)][: max(MOST_TIMES - len(times), 0)]
    return np.sort([*times, *middles])
