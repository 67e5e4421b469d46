"""Least squares for the geometry of views from the shadows of points at known places, and what it cannot tell."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from palpate.arrays import Bool, Float64

FAR_OFF = 5.0  # times the scale: how far robust steps may go from the start without pull
REWEIGHTED = 5  # times
OUTLIER = 5.0  # times the usual residual
SMALL = 0.03  # of its largest component: what a direction in words leaves out
PART = 0.1  # of a direction that is not told, in a number that then counts as undetermined


@dataclass(frozen=True, eq=False)
class GeometryFit:
    """numbers and their standard deviations (n,), inf where undetermined; residuals (K, 2) pixels, measured − predicted;
    used (K,); directions (d, n): of the numbers, in units of the scales, that the data do not tell."""

    numbers: Float64
    deviations: Float64
    residuals: Float64
    used: Bool
    directions: Float64


def fit_geometry(
    predict: Callable[[Float64], Float64],
    slopes: Callable[[Float64], Float64],
    measured: Float64,
    deviations: Float64,
    scales: Float64,
) -> GeometryFit:
    """Numbers (n,) for which predict(numbers), (K, 2) pixels, comes nearest to what was measured, starting from 0.

    slopes(numbers): (K, 2, n). scales (n,): about how far the start may be from the truth. A direction whose standard
    deviation is above 1 in units of them is undetermined: the data tell less of it than the start does, so it stays as it
    was.
    """
    n, used, y = len(scales), np.ones(len(measured), bool), np.zeros(len(scales))

    def rest(y: Float64) -> Float64:
        return np.asarray((measured - predict(y * scales)) / deviations)

    def jacobian(y: Float64) -> Float64:
        return np.asarray(-slopes(y * scales) / deviations[..., None] * scales)

    for _ in range(2):  # robust, and held by the start where the data do not hold
        y = _robust(rest, jacobian, y, used)
        size = np.linalg.norm(rest(y), axis=1)
        used = np.asarray(size <= OUTLIER * max(float(np.median(size)), 0.2))
    triangle = np.linalg.qr(jacobian(y)[used].reshape(-1, n), mode="r")  # has the singular values, and is smaller
    _, s, turned = np.linalg.svd(triangle, full_matrices=True)
    s = np.concatenate([s, np.zeros(n - len(s))])
    left = rest(y)[used].ravel()
    spread = float(np.sqrt(left @ left / max(len(left) - n, 1)))
    told = s > max(spread, 1e-9 * s[0])
    ways = turned[told]

    def plain(x: Float64) -> Float64:
        return rest(x @ ways)[used].ravel()

    def plain_jacobian(x: Float64) -> Float64:
        return np.asarray(jacobian(x @ ways)[used].reshape(-1, n) @ ways.T)

    x = least_squares(plain, ways @ y, plain_jacobian, method="lm", xtol=1e-14, ftol=1e-14).x
    y = x @ ways
    left = rest(y)[used].ravel()
    variance = left @ left / max(len(left) - len(ways), 1)
    root = np.linalg.inv(np.linalg.qr(plain_jacobian(x), mode="r"))  # of the covariance (JᵀJ)⁻¹ of x
    own = np.sqrt(variance * ((ways.T @ root) ** 2).sum(axis=1)) * scales
    lost = (turned[~told] ** 2).sum(axis=0) > PART**2
    numbers = y * scales
    return GeometryFit(numbers, np.where(lost, np.inf, own), measured - predict(numbers), used, _reduced(turned[~told]))


def _robust(
    rest: Callable[[Float64], Float64], jacobian: Callable[[Float64], Float64], y: Float64, used: Bool
) -> Float64:
    """Numbers, in units of the scales, from residuals (K, 2) of which some are wrong: reweighted least squares."""
    n, typical = len(y), max(1.4826 * float(np.median(np.abs(rest(y)[used]))), 1.0)
    for _ in range(REWEIGHTED):
        r = rest(y)[used].reshape(-1, 2)
        weight = (1 + (np.linalg.norm(r, axis=1) / (3 * typical)) ** 2) ** -0.25 / typical  # root of that of soft L1

        def held(y: Float64, weight: Float64 = weight) -> Float64:
            return np.concatenate([(rest(y)[used] * weight[:, None]).ravel(), y / FAR_OFF])

        def held_jacobian(y: Float64, weight: Float64 = weight) -> Float64:
            J = jacobian(y)[used] * weight[:, None, None]
            return np.concatenate([J.reshape(-1, n), np.eye(n) / FAR_OFF])

        y = np.asarray(least_squares(held, y, held_jacobian, method="lm", xtol=1e-6, ftol=1e-6).x)
        typical = max(1.4826 * float(np.median(np.abs(rest(y)[used]))), 1.0)
    return y


def _reduced(basis: Float64) -> Float64:
    """The same space in reduced echelon form, so that each direction names as few numbers as can be."""
    rows, free = basis.copy(), list(range(len(basis)))
    while free:
        i, column = np.unravel_index(np.argmax(np.abs(rows[free])), (len(free), rows.shape[1]))
        pivot = free.pop(int(i))
        rows[pivot] /= rows[pivot, column]
        others = np.arange(len(rows)) != pivot
        rows[others] -= rows[others, column][:, None] * rows[pivot]
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def in_words(direction: Float64, scales: Float64, names: tuple[str, ...], units: tuple[str, ...]) -> str:
    """A direction as the moves it is made of: those that go together so that no shadow moves."""
    large = np.flatnonzero(np.abs(direction) > SMALL * np.abs(direction).max())
    large = large[np.argsort(-np.abs(direction[large]))][:6]
    size = direction * scales
    size = size / abs(size[large[0]])
    if size[large[0]] < 0:
        size = -size
    parts = [f"{names[j]} by {size[j]:.2g} {units[j]}" for j in large]
    return ", together with ".join([parts[0], ", ".join(parts[1:])] if len(parts) > 1 else parts)
