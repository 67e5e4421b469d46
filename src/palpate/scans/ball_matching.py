"""Assigns spots in a view to balls, from a geometry that is wrong.

A wrong geometry displaces the shadows by a field that is nearly linear in the balls' places. It is found together with the
assignment, by expectation and maximisation while the spots' width shrinks (coherent point drift: Myronenko and Song, IEEE
TPAMI 32(12), 2010), from the few common shifts that bring most shadows onto spots.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from palpate.arrays import Float64, Int64

STARTS = 6  # common shifts that are tried
SHRINK = 0.8
FALSE = 0.1  # of the balls: as many spots at least are no ball


def assign(expected: Float64, balls: Float64, found: Float64, reach: float, width: float) -> Int64:
    """(N,): index of each ball's spot, -1 for none.

    expected (N, 2), found (M, 2): places on the panel. balls (N, 3): mm. reach: how far from each other a shadow and its
    spot may be expected; width: how far from its place a spot may lie at the end. All three in one unit.
    """
    middle, extent = balls.mean(axis=0), np.maximum(np.ptp(balls, axis=0) / 2, 1e-6)
    field = np.column_stack([np.ones(len(balls)), (balls - middle) / extent])
    best, least = np.full(len(balls), -1), np.inf
    for shift in _common_shifts(expected, found, reach, width):
        chosen, rest = _drift(expected, field, found, shift, reach, width)
        more = np.count_nonzero(chosen >= 0) - np.count_nonzero(best >= 0)
        if more > 0 or (more == 0 and rest < least):
            best, least = chosen, rest
    return best


def _common_shifts(expected: Float64, found: Float64, reach: float, width: float) -> list[Float64]:
    """Differences that many pairs of a shadow and a spot share, the most frequent first."""
    pairs = (found[None] - expected[:, None]).reshape(-1, 2)
    pairs = pairs[np.hypot(*pairs.T) <= reach]
    shifts = [np.zeros(2)]
    if not len(pairs):
        return shifts
    gap = np.linalg.norm(pairs[:, None] - pairs[None], axis=2)
    votes = np.exp(-0.5 * (gap / (2 * width)) ** 2).sum(axis=1)
    for k in np.argsort(-votes):
        if all(np.hypot(*(pairs[k] - s)) > 3 * width for s in shifts[1:]):
            shifts.append(pairs[k])
        if len(shifts) > STARTS:
            break
    return shifts


def _drift(
    expected: Float64, field: Float64, found: Float64, shift: Float64, reach: float, width: float
) -> tuple[Int64, float]:
    n, ridge = len(expected), np.diag([0.0, 1.0, 1.0, 1.0])
    move = np.zeros((4, 2))
    move[0] = shift
    others = max(len(found) - n, 0) + FALSE * n  # spots that are no ball, anywhere
    spread, density = reach / 3, others / max(np.prod(np.ptp(found, axis=0)), 1e-9)
    while spread > width / 3:
        gap = found[None] - (expected + field @ move)[:, None]
        near = np.exp(-0.5 * (gap**2).sum(axis=2) / spread**2) / (2 * np.pi * spread**2)
        share = near / (near.sum(axis=0) + density)
        weight = share.sum(axis=1)
        wanted = share @ found - weight[:, None] * expected
        # The ridge holds the field near a common shift: its linear part is below a third of the reach.
        normal = (field.T * weight) @ field + ridge * (spread / (reach / 3)) ** 2
        move = np.linalg.solve(normal + 1e-9 * np.eye(4), field.T @ wanted)
        spread *= SHRINK
    gap = np.linalg.norm(found[None] - (expected + field @ move)[:, None], axis=2)
    rows, columns = linear_sum_assignment(np.minimum(gap, 2 * width))
    chosen = np.full(n, -1)
    near_enough = gap[rows, columns] <= width
    chosen[rows[near_enough]] = columns[near_enough]
    rest = float(np.sqrt(np.mean(gap[rows, columns][near_enough] ** 2))) if near_enough.any() else np.inf
    return chosen, rest
