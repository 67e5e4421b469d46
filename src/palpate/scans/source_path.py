"""What the order of the focal spots along their path gives away."""

import numpy as np

from palpate.arrays import Float64

FLAT, SAME = 1e-3, 1e-3  # of the path's size: as good as a line; as good as the same point
ORDERS = 1, 2  # of the curve: circles and ellipses; deltoids and other hypocycloids of three cusps


def degrees_as_radians(sources: Float64) -> bool:
    """Whether focal spots that were meant to be spread evenly over a closed path have degrees taken as radians.

    sources: (views, 3) mm.

    A closed path is a trigonometric polynomial, x(t) + i y(t) = sum over |m| <= M of c_m exp(i m t), of low order M. n focal
    spots spread evenly have t = 360 k / n degrees. If that number is taken as radians, they lie on the same curve, at other
    places. So a polynomial goes through all of them with that step, and none does with the step in degrees.
    """
    count = len(sources)
    about = sources - sources.mean(axis=0)
    xy = about @ np.linalg.svd(about)[2][:2].T
    size = np.ptp(xy, axis=0)
    if size.min() < FLAT * size.max():
        return False
    step = 360 / count
    return any(
        _on_curve(xy, step, order) and not _on_curve(xy, np.radians(step), order)
        for order in ORDERS
        if count >= 2 * order + 3  # two spots more than the polynomial has coefficients
    )


def _on_curve(xy: Float64, step: float, order: int) -> bool:
    """Whether a closed curve of an order goes through all points, if each is a step, radians, further than the last."""
    basis = np.exp(1j * step * np.outer(np.arange(len(xy)), np.arange(-order, order + 1)))
    points = xy[:, 0] + 1j * xy[:, 1]
    off = points - basis @ np.linalg.lstsq(basis, points, rcond=None)[0]
    return bool(np.abs(off).max() < SAME * np.ptp(xy, axis=0).max())
