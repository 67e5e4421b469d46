"""The beam without object: inverse square law, obliquity, and the heel effect as a smooth function of the ray."""

from dataclasses import dataclass

import numpy as np
from scipy import interpolate

from palpate.arrays import ArrayLike, Bool, Float64, Int64
from palpate.errors import DataError
from palpate.scans.views import Panel, Views

DEGREE = 4  # of the polynomial in the logarithm: a heel of ±30 % is met to 0.1 %
BLOCKS = 32  # along each side of the panel, of which medians are taken
NODES = 65  # along each side, between which a beam is interpolated
ROUNDS = 20  # of reweighting
HUBER = 1.5  # standard deviations


def inverse_square(source: Float64, panel: Panel, rows: ArrayLike, columns: ArrayLike) -> Float64:
    """(rows, columns): fluence of a point source at places of the panel, cos(incidence) / distance², 1/mm²."""
    to_pixel = _rays(source, panel, rows, columns)
    fluence: Float64 = np.abs(to_pixel @ panel.normal) / np.linalg.norm(to_pixel, axis=-1) ** 3
    return fluence


def ray_slopes(source: Float64, panel: Panel, rows: ArrayLike, columns: ArrayLike) -> Float64:
    """(rows, columns, 2): slopes of the rays in the frame of a tube that aims at the panel's middle."""
    to_pixel = _rays(source, panel, rows, columns)
    aim = _middle(panel) - source
    aim = aim / np.linalg.norm(aim)
    across = panel.column_axis - (panel.column_axis @ aim) * aim
    across /= np.linalg.norm(across)
    along = np.cross(aim, across)
    along *= np.sign(along @ panel.row_axis) or 1.0
    ahead = to_pixel @ aim
    return np.stack([to_pixel @ across / ahead, to_pixel @ along / ahead], axis=-1)


@dataclass(frozen=True, eq=False)
class BeamProfile:
    """Fluence without object = `level` · inverse_square · exp(polynomial of the ray's slopes).

    The polynomial is the heel effect, bound to a tube that aims at the panel's middle.
    """

    level: float
    coefficients: Float64
    middle: Float64
    half: Float64

    def on(self, source: Float64, panel: Panel) -> Float64:
        """(rows, columns): the fluence, in the unit of the flat that was fitted. A spline through `NODES` each way."""
        v, u = (np.linspace(0, n - 1, min(n, NODES)) for n in panel.shape)
        scaled = (ray_slopes(source, panel, v, u) - self.middle) / self.half
        scaled = np.clip(scaled, -1, 1)  # held at the rim of the flat: a polynomial runs away beyond it
        values = self.level * inverse_square(source, panel, v, u) * np.exp(_powers(scaled) @ self.coefficients)
        if min(values.shape) < 4:
            return values
        spline = interpolate.RectBivariateSpline(v, u, values)
        return np.asarray(spline(np.arange(panel.shape[0]), np.arange(panel.shape[1])), np.float64)


def fit_beam_profile(signal: Float64, good: Bool, source: Float64, panel: Panel) -> BeamProfile:
    """The smooth part of a flat (rows, columns), fitted to medians of blocks; outliers weigh little.

    Raises `DataError` where too few pixels are good.
    """
    blocks = block_medians(np.where(good & (signal > 0), signal, np.nan))
    centres = [(np.arange(m) + 0.5) * step(n) - 0.5 for n, m in zip(panel.shape, blocks.shape, strict=True)]
    corners = ray_slopes(source, panel, *([0, n - 1] for n in panel.shape)).reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-12)
    where = np.isfinite(blocks)
    powers = _powers((ray_slopes(source, panel, *centres)[where] - middle) / half)
    logs = np.log(blocks[where] / inverse_square(source, panel, *centres)[where])
    if len(logs) < 2 * powers.shape[1]:
        raise DataError(f"flat: only {len(logs)} blocks of the panel hold good pixels, too few to fit the beam")
    weights = np.ones(len(logs))
    level = float(np.median(logs))
    for _ in range(ROUNDS):
        root = np.sqrt(weights)
        coefficients = np.linalg.lstsq(powers * root[:, None], (logs - level) * root, rcond=None)[0]
        left = np.abs(logs - level - powers @ coefficients)
        spread = max(1.4826 * float(np.median(left)), 1e-9)
        weights = np.minimum(1, HUBER * spread / np.maximum(left, 1e-12))
    return BeamProfile(float(np.exp(level)), np.asarray(coefficients, np.float64), middle, half)


def step(pixels: int, least: int = 1) -> int:
    """Side of the blocks along a side of the panel."""
    return min(pixels, max(least, pixels // BLOCKS))


def block_medians(image: Float64, least: int = 1) -> Float64:
    """Medians of about `BLOCKS` x `BLOCKS` blocks of at least `least` pixels' side, NaN where half of a block is NaN."""
    parts = _parts(image, least)
    known = np.isfinite(parts).sum(axis=-1)
    few = known <= 0.5 * parts.shape[-1]
    ordered = np.sort(parts, axis=-1)  # NaN last; numpy's nanmedian goes block by block
    places = [np.clip(i, 0, parts.shape[-1] - 1)[..., None] for i in ((known - 1) // 2, known // 2)]
    middle = [np.take_along_axis(ordered, i, -1)[..., 0] for i in places]
    return np.where(few, np.nan, (middle[0] + middle[1]) / 2)


def block_means(image: Float64, least: int = 1) -> tuple[Float64, Int64]:
    """Means of the same blocks, NaN where half of a block is NaN, and how many values are in each."""
    parts = _parts(image, least)
    known = np.isfinite(parts)
    count = known.sum(axis=-1)
    total = np.where(known, parts, 0.0).sum(axis=-1)
    return np.where(count > 0.5 * parts.shape[-1], total / np.maximum(count, 1), np.nan), count


def _parts(image: Float64, least: int) -> Float64:
    """(blocks down, blocks across, pixels)."""
    side = [step(n, least) for n in image.shape]
    rows, columns = (n - n % s for n, s in zip(image.shape, side, strict=True))
    split = image[:rows, :columns].reshape(rows // side[0], side[0], columns // side[1], side[1])
    return np.moveaxis(split, 2, 1).reshape(rows // side[0], columns // side[1], -1)


def _rays(source: Float64, panel: Panel, rows: ArrayLike, columns: ArrayLike) -> Float64:
    """Vectors from the source to places of the panel, (rows, columns, 3)."""
    r, c = (np.asarray(a, np.float64) for a in (rows, columns))
    down, right = panel.pitch[0] * np.asarray(panel.row_axis), panel.pitch[1] * np.asarray(panel.column_axis)
    to_pixel: Float64 = panel.origin - source + r[:, None, None] * down + c[None, :, None] * right
    return to_pixel


def _middle(panel: Panel) -> Float64:
    middle: Float64 = panel.points([((panel.shape[0] - 1) / 2, (panel.shape[1] - 1) / 2)])[0]
    return middle


def _powers(places: Float64) -> Float64:
    """Products of Legendre polynomials up to `DEGREE` in all, (..., terms)."""
    one = np.polynomial.legendre.legvander(places, DEGREE)
    pairs = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
    return np.stack([one[..., 0, i] * one[..., 1, j] for i, j in pairs], axis=-1)


def most_level_view(views: Views) -> int:
    """The view whose rays meet the panel's middle most nearly at right angles."""
    slant = []
    for source, panel in zip(views.source, views.panels, strict=True):
        ray = source - _middle(panel)
        slant.append(abs(ray @ panel.normal) / np.linalg.norm(ray))
    return int(np.argmax(slant))
