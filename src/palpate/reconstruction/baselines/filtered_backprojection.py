"""Filtered backprojection for few views over a limited angle, on flat panels, for any path of the source."""

from typing import Literal, get_args

import numpy as np
from scipy import fft
from scipy.ndimage import distance_transform_edt
from scipy.special import sici

from palpate.arrays import Bool, Float32, Float64
from palpate.errors import DataError
from palpate.reconstruction.baselines.sirt import check_seen
from palpate.reconstruction.models.likelihood import Likelihood
from palpate.reconstruction.projector import Projector, check_upright
from palpate.reconstruction.rectification import rectify
from palpate.scans.views import Panel, Views

Window = Literal["ram-lak", "shepp-logan", "cosine", "hann", "hamming"]
WINDOWS: tuple[Window, ...] = get_args(Window)
DIRECTIONS = 720  # in which the views' spacing is tabulated, over half a turn


def fbp(A: Projector, likelihood: Likelihood, window: Window = "hann", cutoff: float = 1.0) -> Float32:
    """Reconstruct by filtered backprojection.

    Each view is filtered in two dimensions by the width of the band of depth frequencies that it stands for; this is the
    ramp along the source's motion if that is a line. At low frequencies the ramp levels off, so that what does not vary
    along the mean ray comes back as it is. Objects that are short in depth lose contrast. Values below 0 occur.

    Parameters
    ----------
    A : Projector
        The projector.
    likelihood : Likelihood
        It gives the line integrals.
    window : str, optional
        Taper of the ramp, such as "hann".
    cutoff : float, optional
        Where the taper ends, as a share of the panel's Nyquist frequency in (0, 1].

    Returns
    -------
    ndarray, (z, y, x)
        Attenuation, 1/mm; 0 where no view sees the voxel.

    Raises
    ------
    DataError
        If the window or the cut-off is not valid.
    GeometryError
        If no measured ray meets the grid.

    References
    ----------
    Lauritsch & Härer, Proc. SPIE 3338:1127, 1998.

    Examples
    --------
    >>> pp.fbp(pp.Projector(views, grid), pp.Transmission.of(scan)).shape
    (8, 20, 24)
    """
    check_window(window, cutoff)
    check_upright(A, "fbp")
    A, p, measured = rectify(A, likelihood.line_integrals, likelihood.measured)
    views, grid = A.views, A.grid
    heights = _heights(views)
    low, high = grid.bounds[:, 2]
    faces = [heights / (views.source[:, 2] - z) for z in (low, high)]
    depth = float(np.mean((high - low) * faces[0] * faces[1]))  # of the grid where rays are parallel: M = h/(h − z)
    slopes = views.source[:, :2] / heights[:, None]
    bands = _Bands(slopes - slopes.mean(axis=0), depth)
    filtered, even = np.empty(p.shape, np.float32), np.empty(p.shape, np.float32)
    for k, (source, panel) in enumerate(zip(views.source, views.panels, strict=True)):
        cosine, area = _cosine(source, panel), np.prod(panel.pitch) / grid.voxel_volume
        flat = _filled(p[k], measured[k]) * cosine
        axes, response = bands.response(k, panel, window, cutoff)
        weight = cosine * measured[k] * area
        filtered[k] = weight * _convolved(flat, axes, response)
        even[k] = weight * bands.shares[k]
    seen = A.T(even)
    check_seen(seen)
    magnified = (heights / (views.source[:, 2] - grid.axis("z")[:, None])) ** 2 @ bands.shares
    gain = np.where(seen > 0, magnified.astype(np.float32)[:, None, None] / np.where(seen > 0, seen, 1), 0)
    values: Float32 = A.T(filtered) * gain
    return values


def check_window(window: str, cutoff: float) -> None:
    """Raises `DataError` for a window that there is not, or a cut-off that cannot be."""
    if window not in WINDOWS:
        raise DataError(f"window: there is no {window!r}; choose from {', '.join(WINDOWS)}")
    if not 0 < cutoff <= 1:
        raise DataError(f"cutoff: expected a share of the Nyquist frequency, above 0 and at most 1, got {cutoff!r}")


class _Bands:
    """Which depth frequencies each view stands for, by the direction of an in-plane frequency.

    slopes: (views, 2), lateral position over height of each source, about their mean. In direction e the view has slope
    η = slope·e and stands for those half-way to its neighbours' on either side; the outermost reach out as far as in.
    """

    def __init__(self, slopes: Float64, depth: float) -> None:
        self.slopes, self.depth = slopes, depth
        angles = np.arange(DIRECTIONS + 1) * np.pi / DIRECTIONS
        along = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ slopes.T  # (directions, views)
        order = np.argsort(along, axis=1)
        sorted_ = np.take_along_axis(along, order, axis=1)
        gaps = np.diff(sorted_, axis=1) / 2
        reach = np.concatenate([gaps[:, :1], gaps, gaps[:, -1:]], axis=1) if len(slopes) > 1 else 0 * along[:, [0, 0]]
        self.low, self.high = sorted_[:, 0] - reach[:, 0], sorted_[:, -1] + reach[:, -1]
        self.widths = np.empty_like(along)
        np.put_along_axis(self.widths, order, reach[:, :-1] + reach[:, 1:], axis=1)
        self.span = self.high - self.low
        total = self.span[:-1].sum()
        self.shares = self.widths[:-1].sum(axis=0) / total if total > 0 else np.full(len(slopes), 1 / len(slopes))

    def response(self, view: int, panel: Panel, window: Window, cutoff: float) -> tuple[list[int], Float64]:
        """The axes along which a view is filtered, and the filter's response (1/mm) over their frequencies."""
        lateral = np.stack([panel.row_axis[:2], panel.column_axis[:2]])
        moves = np.ptp(self.slopes @ lateral.T, axis=0)
        axes = [axis for axis in (0, 1) if moves[axis] > 1e-6 * max(moves.max(), 1e-6)]
        if not axes:
            return axes, np.full((1, 1), self.shares[view] / self.depth)
        sizes = [_padded(n) if axis in axes else 1 for axis, n in enumerate(panel.shape)]
        last = axes[-1]
        rows, columns = (
            (fft.rfftfreq if axis == last else fft.fftfreq)(sizes[axis], panel.pitch[axis]) for axis in (0, 1)
        )
        x, y = (rows[:, None] * lateral[0, i] + columns * lateral[1, i] for i in (0, 1))
        k = np.hypot(x, y)
        angle = np.mod(np.arctan2(y, x), np.pi) * (DIRECTIONS / np.pi)

        def towards(table: Float64) -> Float64:
            return np.asarray(np.interp(angle, np.arange(DIRECTIONS + 1), table), np.float64)

        low, high = (np.pi * self.depth * k * towards(edge) for edge in (self.low, self.high))
        known = (
            sici(high)[0] - sici(low)[0]
        ) / np.pi  # what all bands hold of a function flat over the depth, 0 outside
        width = k * towards(self.widths[:, view])
        usable = known > 1e-9
        level = np.where(usable, width / np.where(usable, known, 1), self.shares[view] / self.depth)
        nyquist = 0.5 / panel.pitch[int(np.argmax(moves))]
        taper = k * towards(self.span) / self.span.max() / (cutoff * nyquist)
        return axes, level * _window(window, taper)


def _window(window: Window, x: Float64) -> Float64:
    """x: frequency over the cut-off."""
    if window == "ram-lak":
        shape = np.ones_like(x)
    elif window == "shepp-logan":
        shape = np.sinc(x / 2)
    elif window == "cosine":
        shape = np.cos(np.pi / 2 * x)
    else:
        share = 0.5 if window == "hann" else 0.54
        shape = share + (1 - share) * np.cos(np.pi * x)
    return np.where(x <= 1 + 1e-9, shape, 0)


def _convolved(p: Float32, axes: list[int], response: Float64) -> Float32:
    """One view (rows, columns), filtered along `axes`; beyond the panel one edge's values pass into the other's."""
    if not axes:
        return p * np.float32(response[0, 0])
    padded = p
    for axis in axes:
        n = p.shape[axis]
        first, last = padded.take([0], axis), padded.take([-1], axis)
        shape = [1, 1]
        shape[axis] = -1
        across = (np.arange(1, _padded(n) - n + 1, dtype=np.float32) / (_padded(n) - n + 1)).reshape(shape)
        padded = np.concatenate([padded, last + (first - last) * across], axis)
    spectrum = fft.rfftn(padded, axes=axes)
    back = fft.irfftn(spectrum * response.astype(np.float32), [padded.shape[a] for a in axes], axes=axes)
    filtered: Float32 = np.ascontiguousarray(back[: p.shape[0], : p.shape[1]], np.float32)
    return filtered


def _padded(n: int) -> int:
    return int(fft.next_fast_len(2 * n, real=True))


def _filled(p: Float32, measured: Bool) -> Float32:
    """Unmeasured pixels take the value of the nearest measured one."""
    if measured.all() or not measured.any():
        return p
    rows, columns = distance_transform_edt(~measured, return_distances=False, return_indices=True)
    return np.asarray(p[rows, columns], np.float32)


def _cosine(source: Float64, panel: Panel) -> Float32:
    """(rows, columns): of the angle between each ray and the panel's normal."""
    foot = panel.origin - source
    v = foot @ panel.row_axis + panel.pitch[0] * np.arange(panel.shape[0])
    u = foot @ panel.column_axis + panel.pitch[1] * np.arange(panel.shape[1])
    h = foot @ panel.normal
    cosine: Float32 = (abs(h) / np.sqrt(h * h + v[:, None] ** 2 + u**2)).astype(np.float32)
    return cosine


def _heights(views: Views) -> Float64:
    """(views,) of the sources above their panels, mm."""
    return np.array([s[2] - p.origin[2] for s, p in zip(views.source, views.panels, strict=True)])
