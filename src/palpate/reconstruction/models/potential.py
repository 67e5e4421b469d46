"""Potential functions of the prior: the built-in ones, and tables of a user's own."""

from typing import Literal, Protocol, get_args, runtime_checkable

import numpy as np

from palpate import _core
from palpate.arrays import Float32, Float64
from palpate.errors import DataError

Named = Literal["quadratic", "huber", "lange", "hyperbola", "generalized", "generalised"]
NAMES: tuple[Named, ...] = get_args(Named)[:-1]  # in the order of the kernels; the last is an old spelling
TABULATED = len(NAMES)


@runtime_checkable
class Potential(Protocol):
    """A potential of your own; see `examples/own_potential.py`.

    t: float64 array (N,) of differences in units of the prior's edge, of either sign and never 0. The prior sums
    δ² value(difference/δ), δ = edge, so that edge and `tune` mean for it what they mean for ours. Even, non-negative,
    finite to |t| = 65536; weight never grows with |t|: then the parabola of that curvature lies above (Huber 1981).
    """

    def value(self, t: Float64) -> Float64:
        """(N,): 0 at t = 0."""

    def weight(self, t: Float64) -> Float64:
        """(N,): value'(t)/t."""


def tabulate_potential(potential: Potential) -> Float32:
    """(2, entries) weights and values for the kernels: tabulated once, so that no Python runs inside them.

    32 entries a doubling of t from 2^-16 to 2^16, the weight linear in between (relative error about 1e-4 for smooth
    potentials). The values are the exact integral of t · weight as so interpolated, so that objective and slope are of
    one function. Raises `DataError` for what is no potential, with the t at which it fails.
    """
    steps, octaves = _core.statistics.TABLE_STEPS, _core.statistics.TABLE_OCTAVES
    octave, part = np.divmod(np.arange(steps * 2 * octaves + 1), steps)
    t = 2.0 ** (octave - octaves) * (1 + part / steps)
    value, weight = _checked(potential, t)
    weight = weight.astype(np.float32).astype(np.float64)
    # ∫ u w du over an interval, w linear from w0 to w1
    low, high, w0, w1 = t[:-1], t[1:], weight[:-1], weight[1:]
    pieces = (high - low) * (low * (2 * w0 + w1) + high * (w0 + 2 * w1)) / 6
    summed = np.concatenate([[0], np.cumsum(pieces)]) + weight[0] * t[0] ** 2 / 2
    _refuse(t, np.abs(summed - value) > 1e-3 * summed, value, "value(t) is not the integral of t weight(t)")
    return np.stack([weight, summed]).astype(np.float32)


def _checked(potential: Potential, t: Float64) -> tuple[Float64, Float64]:
    """Values and weights at t > 0, or the reason why these are not those of a potential."""
    answers = []
    for name in ("value", "weight"):
        function = getattr(potential, name)
        with np.errstate(all="ignore"):  # the checks below report what is wrong
            right, left = (np.asarray(function(x), dtype=np.float64) for x in (t, -t))
        if right.shape != t.shape or left.shape != t.shape:
            raise DataError(
                f"potential: {name}(t) of t with shape {t.shape} has shape {right.shape}; it is given arrays"
            )
        _refuse(t, ~np.isfinite(right) | ~np.isfinite(left), right, f"{name}(t) is not finite")
        _refuse(t, np.abs(right - left) > 1e-6 * np.abs(right), right, f"{name}(t) is not even, {name}(-t) differs")
        _refuse(t, right < 0, right, f"{name}(t) is negative")
        answers.append(right)
    value, weight = answers
    if not weight[0] > 0:
        raise DataError(f"potential: weight(t) near 0 is {weight[0]:g}; expected a value above 0, such as 1")
    grows = np.concatenate([[False], np.diff(weight) > 1e-6 * weight[:-1]])
    _refuse(t, grows, weight, "weight(t) grows with |t|, so no parabola of that curvature lies above")
    return value, np.minimum.accumulate(weight)


def _refuse(t: Float64, bad: np.ndarray, values: Float64, what: str) -> None:
    if bad.any():
        k = int(np.argmax(bad))
        raise DataError(
            f"potential: {what} (first at t = {t[k]:.4g} edges: {values[k]:.4g}); the prior needs an even, non-negative "
            f"value(t) with weight(t) = value'(t)/t that never grows, finite to |t| = {t[-1]:.0f}"
        )
