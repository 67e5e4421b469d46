"""The local impulse response of a quadratic prior: how wide a point becomes, and the strength for a wanted width."""

import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from palpate import _core
from palpate.arrays import AnyArray, Float32
from palpate.errors import DataError
from palpate.reconstruction.circulant_response import CirculantResponse
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.projector import Projector, check_upright
from palpate.scans.blur import Blur
from palpate.scans.views import Panel, Views
from palpate.volumes.grid import Grid

SIDE, DEEP = 65, 33  # voxels a side of the window in which the response is computed, and its slices
WIDEST = 0.15  # of the window: a wider response would feel its rim
RANGE = (0.1, 1e6)  # of strength × R_jj: how hard the neighbours of a voxel pull, over how hard the data do
SOFTEST = 0.01  # its lower end where a blur is in the model, of which a weaker prior takes more back
POINT = 0.2  # side of a point, in voxels
POINTS = 9  # of whose widths the mean is taken, since a shadow falls differently between pixels
CLOSE = 0.01  # relative accuracy of the width
TRIES, SETTLED = 4, 0.5  # what corrects the width changes by about 1 % where the strength changes by a factor e
STEP = 0.5  # of the logarithm of the strength, for the slope of the width
MOST, SMALL = 300, 0.03  # steps of conjugate gradients; the residual at which they end, relative
SMALLER = 0.003  # where a blur is in the model, whose inverse is steep
NOISY = 10.0  # times the noise of views without blur, of which a word is said


def strength_for_resolution(
    prior: Prior, views: Views, grid: Grid, resolution: float, blur: Blur | None = None
) -> float:
    """Return the strength with which a point becomes as wide as is wanted.

    The image of a small change e of the object is its local impulse response l = (F + β R)⁻¹ F e, with the Fisher
    information F = AᵀA of rays of equal weight and β = strength × F_jj. So the strength depends on geometry, voxels and
    neighbours, and on neither dose nor object. With a blur B in the model F is AᵀBᵀB A, and F_jj is that without it.

    Fourier transforms give a first strength. The response in a window in the middle of the grid, by conjugate gradients
    with these transforms as preconditioner, corrects it.

    Parameters
    ----------
    prior : Prior
        A quadratic prior; its neighbours count.
    views : Views
        The geometry.
    grid : Grid
        The voxels of the finest level.
    resolution : float
        Full width at half maximum of the response to a point in the slice, along the wider axis, mm; the mean over points
        in the middle of several voxels.
    blur : Blur, optional
        That is in the model; it must have a plane.

    Returns
    -------
    float
        The strength over F_jj, 1/mm, to three digits, so that another machine finds the same.

    Raises
    ------
    DataError
        If no strength gives that width.

    Warns
    -----
    UserWarning
        If the width behind a blur has far more noise than it would have without.

    References
    ----------
    Fessler & Rogers, IEEE Trans. Image Process. 5 (1996) 1346. Stayman & Fessler, IEEE TMI 19 (2000) 601.
    """
    part = _window(grid)
    A = Projector(_views_of(views, part, blur), part)
    check_upright(A, "resolution")
    unit = replace(prior, strength=1.0, resolution=None)
    circulant = CirculantResponse(unit, A.views, part, blur)
    curvature = unit.surrogate(np.zeros((3, 3, 3), np.float32), Grid((3, 3, 3), part.spacing))[1][1, 1, 1]
    low, high = (math.log(pull / curvature) for pull in (RANGE[0] if blur is None else SOFTEST, RANGE[1]))

    def width_by(response: CirculantResponse, log_strength: float) -> float:
        return _width(response.middle_slice(math.exp(log_strength)), _places(part, 1), part)

    def strength_by(response: CirculantResponse, wanted: float) -> float:
        """Its logarithm."""
        return float(brentq(lambda s: width_by(response, s) - wanted, low, high, xtol=0.05))

    @cache
    def approximate(log_strength: float) -> float:
        return width_by(circulant, log_strength)

    widest = min(WIDEST * SIDE * min(part.spacing[1:]), approximate(high))
    wanted = min(max(resolution, approximate(low)), widest)
    log_strength = strength_by(circulant, wanted)
    correction = _correction(unit, A, circulant, log_strength, blur)
    for _ in range(TRIES if resolution <= widest else 0):
        before, width = log_strength, approximate(log_strength)
        slope = math.log(approximate(log_strength + STEP) / width) / STEP
        towards = math.log(resolution / (width * correction(log_strength))) / max(slope, 0.01)
        log_strength = min(max(log_strength + towards, low), high)
        if abs(log_strength - before) < SETTLED:
            break
    if resolution > widest or log_strength == low:
        least = approximate(low) * correction(low)
        if not (1 - CLOSE) * least < resolution <= widest:
            raise DataError(
                f"prior resolution: {resolution:g} mm; with voxels of {grid.spacing[1]:g} mm in the slice and this geometry "
                f"a point becomes {least:.2g} to {widest:.2g} mm wide; choose a width in between, or other voxels (--spacing)"
            )
    if blur is not None:
        sharp = CirculantResponse(unit, A.views, part)
        alike = strength_by(sharp, max(approximate(log_strength), width_by(sharp, low)))
        _tell_noise(blur, resolution, circulant.noise(math.exp(log_strength)) / sharp.noise(math.exp(alike)))
    return float(f"{math.exp(log_strength):.3g}")


def _tell_noise(blur: Blur, resolution: float, times: float) -> None:
    """Warns of a width that has many times the noise of views without blur."""
    if times > NOISY:
        warnings.warn(
            f"prior resolution: behind a blur of {blur}, {resolution:g} mm has {float(f'{times:.2g}'):g} times the noise "
            "that it would have without blur; choose a larger width unless the dose is high",
            stacklevel=4,
        )


def _correction(
    unit: Prior, A: Projector, circulant: CirculantResponse, log_strength: float, blur: Blur | None
) -> Callable[[float], float]:
    """Gives the width in the window itself over that of the Fourier transforms: both of several points, whose responses
    overlap alike. Solved with the inverse at the strength given here as preconditioner."""
    grid, inverse, places = A.grid, circulant.inverse(math.exp(log_strength)), _places(A.grid, POINTS)
    (middle,) = _places(grid, 1)
    taps = None if blur is None else blur.taps(A.views)

    def blurred_twice(l: Float32) -> Float32:
        """BᵀB, where B is symmetric."""
        once = l if taps is None else _core.statistics.blur_views(taps, l)
        return once if taps is None else _core.statistics.blur_views(taps, once)

    load = A.T(blurred_twice(np.sum([_shadow(A, at) for at in places], axis=0)))
    diagonal = _core.icd.diagonal(A.geometry, np.ones(A.range_shape, np.float32), 1, 1)
    information = float(np.mean([diagonal[grid.shape[0] // 2, y, x] for y, x in places]))

    @cache
    def factor(log_strength: float) -> float:
        beta = np.float32(math.exp(log_strength) * information)
        end = SMALL if blur is None else SMALLER
        l = _solved(lambda f: A.T(blurred_twice(A(f))) + beta * unit.surrogate(f, grid)[0], load, inverse, end)
        alike = circulant.middle_slice(math.exp(log_strength))
        alike = np.sum([np.roll(alike, np.subtract(at, middle), (0, 1)) for at in places], axis=0)
        return _width(l[grid.shape[0] // 2], places, grid) / _width(alike, places, grid)

    return factor


def _solved(
    matrix: Callable[[Float32], Float32], load: Float32, inverse: Callable[[Float32], Float32], end: float
) -> Float32:
    """Preconditioned conjugate gradients from 0, to a relative residual."""
    x, r = np.zeros_like(load), load.copy()
    p = z = inverse(r)
    size = _dot(r, z)
    enough = end**2 * size
    for _ in range(MOST):
        q = matrix(p)
        step = np.float32(size / _dot(p, q))
        x += step * p
        r -= step * q
        z = inverse(r)
        before, size = size, _dot(r, z)
        if size < enough:
            break
        p = z + np.float32(size / before) * p
    return x


def _dot(a: Float32, b: Float32) -> float:
    return float(np.vdot(a.astype(np.float64), b))


def _places(grid: Grid, count: int) -> list[tuple[int, int]]:
    """(y, x) of the middle of a slice, or of `POINTS` voxels on a turned square lattice: no two in one row or column."""
    y, x = (n // 2 for n in grid.shape[1:])
    lattice = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)] if count > 1 else [(0, 0)]
    return [(y + 9 * i - 3 * j, x + 9 * j + 3 * i) for i, j in lattice]


def _shadow(A: Projector, at: tuple[int, int]) -> Float32:
    """Line integrals through a small cube in a voxel. A voxel would not do: where slices are thick its shadow is wide."""
    side = POINT * min(A.grid.spacing)
    cube = Grid((1, 1, 1), (side, side, side), A.grid.points((A.grid.shape[0] // 2, *at))[0])
    return Projector(A.views, cube)(np.ones((1, 1, 1), np.float32))


def _width(plane: AnyArray, places: list[tuple[int, int]], grid: Grid) -> float:
    """mm: the mean full width at half maximum about some voxels of a slice, along the wider axis."""
    lines = [[(plane[:, x], y) for y, x in places], [(plane[y], x) for y, x in places]]
    widths = [np.mean([_half_width(*line) for line in along]) for along in lines]
    return float(max(np.multiply(widths, grid.spacing[1:])))


def _half_width(line: AnyArray, at: int) -> float:
    """Samples between the places where a line falls to half of its value at a sample, on a cubic spline."""
    roots = CubicSpline(np.arange(len(line)), line.astype(np.float64) - line[at] / 2).roots(extrapolate=False)
    before, after = roots[roots < at], roots[roots > at]
    return float(after.min() - before.max()) if before.size and after.size else float(len(line))


def _window(grid: Grid) -> Grid:
    """`SIDE` voxels a side about the middle of the slices, in the frame of the views; at most `DEEP` slices."""
    shape = np.array([min(grid.shape[0], DEEP), SIDE, SIDE])
    first = np.array(grid.shape) // 2 - shape // 2
    return Grid(shape, grid.spacing, np.array(grid.origin) + first[::-1] * np.array(grid.spacing[::-1]))


def _views_of(views: Views, part: Grid, blur: Blur | None) -> Views:
    """The views with panels that hold the shadow of a window, blurred too, of pixels of nearly the same pitch.

    A voxel is m / 27 pixels, m not divisible by 3: so the shadows of the nine points fall at nine places between pixels, a
    ninth apart. Otherwise their mean would depend on the magnification: where voxels are as wide as a pixel, all fall alike.
    """
    low, high = part.bounds
    middle = part.points([[n // 2 for n in part.shape]])
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    moved = views.project(np.concatenate([middle, middle + np.diag(part.spacing[::-1])[:2]]))
    panels, ends = [], []
    for k, panel in enumerate(views.panels):
        pixels = np.abs(moved[k, 1:] - moved[k, :1]).max(axis=0)  # of a voxel, (row, column)
        steps = np.round(27 * pixels)
        steps = np.maximum(np.where(steps % 3 == 0, steps + np.where(27 * pixels < steps, -1, 1), steps), 1)
        pitch = np.array(panel.pitch) * np.clip(27 * pixels / steps, 0.8, 1.25)  # the bounds are for rays along a slice
        at = panel.points(moved[k, 0])[0]
        origin = at - moved[k, 0] @ (pitch[:, None] * np.stack([panel.row_axis, panel.column_axis]))
        panels.append(Panel(panel.shape, pitch, origin, panel.row_axis, panel.column_axis))
        landed = Views(views.source[k : k + 1], panels[k]).project(corners)[0]
        margin = 1 if blur is None else 1 + np.ceil(2 * blur.widths(views)[k] / pitch)
        ends.append((np.floor(landed.min(axis=0)) - margin, np.ceil(landed.max(axis=0)) + margin))
    size = np.max([high - low for low, high in ends], axis=0) + 1
    shifted = [
        Panel(size, p.pitch, p.points(first)[0], p.row_axis, p.column_axis)
        for p, (first, _) in zip(panels, ends, strict=True)
    ]
    return Views(views.source, shifted)
