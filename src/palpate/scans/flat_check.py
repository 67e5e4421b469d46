"""Refuses dark and flat that cannot be those of the views, before anything is done with them."""

from collections.abc import Callable

import numpy as np
from scipy import ndimage

from palpate.arrays import AnyArray, ArrayLike, Bool, Float32, Float64, UInt8
from palpate.errors import DataError
from palpate.scans.bad_pixels import GIVEN, GOOD, LINE
from palpate.scans.beam_profile import block_means, block_medians, step

FULL = 0.001  # share of the pixels that read the largest value of all: the read-out was clipped
EXPOSED, NOTHING = (
    2.0,
    3.0,
)  # least signal of a flat, in its standard deviations over the panel, and of the dark in time
UNEVEN, LEVELS = 0.03, 0.2  # of frames that repeat each other: in shape, and in level
OBJECT = 0.05  # of a block of the flat: deviation from beam and lines
UNLIKE, SURE = 4.0, 6.0  # the same in standard deviations: of all blocks, and of what independent pixels give
SCALES = (1, 2, 4)  # of the blocks in which an object is looked for
CLUSTER = 1e-4  # of the panel: a larger patch without response is an object, not bad pixels
BRIGHTER = 1.5  # times the flat's dose: nothing is brighter than air
PRESENT, EXPECTED, FAINT = 6.0, 12.0, 0.25  # of the correlation of two pixel patterns
TILT, AIR, LEVEL = 0.05, 0.15, (0.7, 1.4)  # of the beam in air: slope across, share of blocks, and level
PIXELS = 400  # along a side, of which medians of blocks are taken
TURNS: dict[str, Callable[[Float64], Float64]] = {
    "turned by 180°": lambda a: a[::-1, ::-1],
    "upside down (rows reversed)": lambda a: a[::-1],
    "mirrored (columns reversed)": lambda a: a[:, ::-1],
    "transposed (rows and columns exchanged)": lambda a: a.T,
    "turned by 90°": lambda a: np.rot90(a),
    "turned by 270°": lambda a: np.rot90(a, 3),
}


def checked_frames(name: str, values: ArrayLike, shape: tuple[int, int]) -> AnyArray:
    """Frames (n, rows, columns) of the panel, finite and not negative. Raises `DataError` that names them."""
    frames = np.asarray(values)
    if frames.dtype.kind not in "fiu":
        raise DataError(f"{name}: expected real numbers, got dtype {frames.dtype}")
    if frames.ndim == 0:
        frames = np.broadcast_to(frames.astype(np.float32), (1, *shape))
    frames = frames[None] if frames.ndim == 2 else frames
    if frames.ndim != 3 or len(frames) == 0:
        raise DataError(f"{name}: expected (rows, columns) or (frames, rows, columns), got {np.shape(values)}")
    if frames.shape[1:] != shape:
        way = "take it with the panel's own field and binning"
        if frames.shape[1:] == shape[::-1]:
            way = "rows and columns are exchanged: transpose it"
        raise DataError(f"{name}: frames of {frames.shape[1:]} pixels, but the panel has {shape}; {way}")
    _refuse_at(name, frames, ~np.isfinite(frames), "not finite", "mark bad pixels with bad_pixels, and write 0 there")
    _refuse_at(
        name, frames, frames < 0, "negative", "give what the panel read: no offset subtracted, stored as unsigned"
    )
    return frames


def clipped(frames: AnyArray) -> Bool | None:
    """Where frames read the largest value, if so many do that the read-out must have been clipped there; else None."""
    top = frames.max()
    at_top = frames == top
    many = np.count_nonzero(at_top)
    if many < max(20, FULL * frames.size):
        return None
    if many > 0.5 * frames.size:  # all one value: clipped if it is the end of a converter's range
        return at_top if top >= 255 and float(np.log2(float(top) + 1)).is_integer() else None
    below = frames[~at_top]
    width = 0.01 * (float(top) - float(np.median(below)))
    return at_top if many > 5 * np.count_nonzero(below >= float(top) - width) else None


def check_exposure(dark: AnyArray, flat: AnyArray, raw: AnyArray) -> None:
    """Whether flat is brighter than dark, the views too, and the flat not clipped. Raises `DataError`."""
    if dark.shape == flat.shape and np.array_equal(dark, flat):
        raise DataError("flat: it is the dark, number for number; give frames with the beam on and no object")
    darks, flats, views = (float(np.median(a)) for a in (dark, flat, raw))
    if darks > flats:
        words = f"dark: brighter than the flat (medians {darks:.5g} and {flats:.5g})"
        raise DataError(f"{words}; were dark and flat exchanged?")
    signal = flat.mean(axis=0, dtype=np.float64) - dark.mean(axis=0, dtype=np.float64)
    spread = 1.4826 * float(np.median(np.abs(signal - np.median(signal))))
    read = float(np.median(dark.std(axis=0, ddof=1))) if len(dark) > 1 else 0.0
    if np.median(signal) <= max(EXPOSED * spread, NOTHING * read):
        raise DataError(
            f"flat: no brighter than the dark (by {np.median(signal):.4g}, and {spread:.4g} from pixel to pixel); give "
            f"frames with the beam on and no object"
        )
    if views <= darks:
        raise DataError(
            f"dark: brighter than the views (medians {darks:.5g} and {views:.5g}); give frames without beam, with the same "
            f"integration time"
        )
    full = clipped(flat)
    if full is not None:
        lasting = full.all(axis=0) & (dark.mean(axis=0) < 0.9 * float(flat.max()))
        if lasting.mean() > FULL or (full.any(axis=0) & ~full.all(axis=0)).mean() > FULL:
            frame, row, column = (int(i) for i in np.argwhere(full & (dark.mean(axis=0) < 0.9 * float(flat.max())))[0])
            raise DataError(
                f"flat: saturated: {full.mean():.2%} of its pixels read {float(flat.max()):g}, the first at frame {frame}, "
                f"row {row}, column {column}; take it with less exposure"
            )


def check_repeats(name: str, frames: AnyArray, dark: AnyArray) -> None:
    """Whether frames that are to be averaged show the same beam. Raises `DataError`."""
    if len(frames) < 2:
        return
    thin = tuple(slice(None, None, max(1, n // PIXELS)) for n in frames.shape[1:])
    frames, dark = frames[:, *thin], dark[:, *thin]
    offset = dark.mean(axis=0, dtype=np.float64)
    mean = frames.mean(axis=0, dtype=np.float64) - offset
    levels = np.array([np.median(f - offset) for f in frames]) / np.median(mean)
    if np.ptp(levels) > LEVELS:
        raise DataError(
            f"{name}: frame {int(np.argmax(np.abs(levels - np.median(levels))))} has {levels.min():.2f} to "
            f"{levels.max():.2f} of the mean level; leave out frames without full exposure, or say that each belongs to a "
            f"view with {name}_by_view=True"
        )
    for k, frame in enumerate(frames):
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = (frame - offset) / mean / levels[k]
        blocks = block_medians(np.where(np.isfinite(ratio), ratio, np.nan), 8)
        blocks = blocks[np.isfinite(blocks)]
        middle = np.median(blocks)
        spread = 1.4826 * np.median(np.abs(blocks - middle))
        worst = float(np.abs(blocks - middle).max())
        if worst > max(UNEVEN, SURE * spread):
            raise DataError(
                f"{name}: frame {k} differs by {worst:.0%} from the mean of all in a part of the panel, so they are no "
                f"repeats; leave it out, or say that each belongs to a view with {name}_by_view=True"
            )


def check_no_object(pattern: Float64, kinds: UInt8) -> None:
    """Whether a flat shows beam and panel alone. pattern: flat over smooth beam. Raises `DataError`."""
    silent = (kinds != GOOD) & (kinds != GIVEN) & (kinds != LINE)
    labels, patches = ndimage.label(silent, np.ones((3, 3)))
    sizes = np.bincount(labels.ravel())[1:] if patches else np.zeros(1)
    if sizes.max() > max(30, CLUSTER * silent.size):
        row, column = (int(i) for i in np.argwhere(labels == 1 + int(sizes.argmax()))[0])
        raise DataError(
            f"flat: {int(sizes.max())} pixels side by side do not respond as their neighbourhood does, from row {row}, "
            f"column {column}: an object or a collimator's edge in it? Take it without; mask a collimator with bad_pixels"
        )
    logs = np.where(kinds == GOOD, np.log(np.maximum(pattern, 1e-6)), np.nan)
    pixel = float(np.std(logs[kinds == GOOD]))
    for scale in SCALES:
        side = max(4, scale * max(step(n) for n in logs.shape))
        blocks, count = block_means(logs, side)
        for axis in (0, 1):  # amplifiers and gate lines have gains of their own
            blocks = blocks - _median(blocks, axis)
        spread = 1.4826 * float(np.median(np.abs(blocks[np.isfinite(blocks)])))
        limit = np.maximum(max(OBJECT, UNLIKE * spread), SURE * pixel / np.sqrt(np.maximum(count, 1)))
        excess = np.abs(np.nan_to_num(blocks)) - limit
        if excess.max() > 0:
            i, j = np.unravel_index(int(excess.argmax()), excess.shape)
            row, column = (int((n + 0.5) * s / m) for n, s, m in zip((i, j), logs.shape, excess.shape, strict=True))
            raise DataError(
                f"flat: {np.expm1(blocks[i, j]):+.0%} near row {row}, column {column}, which neither a beam nor a panel's "
                f"lines explain: an object in it? Take it with nothing between tube and panel"
            )


def check_same_panel(pattern: Float64, photons: Float32, kinds: UInt8, noise: float) -> None:
    """Whether the views bear the pixel pattern of the flat, and the same way round. Raises `DataError`.

    noise: of the flat, standard deviation relative to the signal. Both patterns are taken against the four neighbours.
    """
    good = ndimage.minimum_filter(kinds == GOOD, size=3, mode="constant")
    ours = _against_neighbours(np.log(np.maximum(pattern, 1e-6)))
    some = photons[:: max(1, len(photons) // 3)]
    theirs: Float64 = np.mean([_against_neighbours(np.log(np.maximum(view, 0.5))) for view in some], axis=0)
    ours, theirs = _limited(ours, good), _limited(theirs, good)
    here, chance = _correlation(ours, theirs), 1.5 / float(np.sqrt(1.0 + good.sum()))
    if here > PRESENT * chance:
        return
    for words, turned in TURNS.items():
        other = turned(ours)
        if other.shape == theirs.shape and _correlation(other, theirs) > PRESENT * chance:
            raise DataError(
                f"flat: its pixel pattern is that of the views, but {words}; store it as the views are stored"
            )
    lasting = float(np.var(ours[good])) - 1.25 * noise**2
    wanted = min(1.0, float(np.sqrt(max(lasting, 0.0) / max(float(np.var(theirs[good])), 1e-30))))
    if wanted > EXPECTED * chance and here < FAINT * wanted:
        raise DataError(
            f"flat: its pixel pattern is not in the views (correlation {here:.3f}): is it from another panel or binning, or "
            f"are the views flat-fielded already? Those need no correction: palpate scan import"
        )


def check_beam_side(ratio: Float32, kinds: UInt8) -> None:
    """Whether air in the views has the flat's beam. ratio: views over flat, doses divided out. Raises `DataError`.

    Bright blocks that lie on one plane, across the panel and near the level of air, are air; the plane must be level.
    """
    thin = tuple(slice(None, None, max(1, n // PIXELS)) for n in kinds.shape)
    good, ratio = (kinds == GOOD)[thin], ratio[:, *thin]
    views = np.stack([block_medians(np.where(good & (view > 0), view, np.nan), 4) for view in ratio])
    for k in (range(len(views)), [0], [len(views) - 1]):  # flats in the reverse order cancel in the mean of all
        known = np.isfinite(views[k]).all(axis=0)
        _check_level(np.where(known, np.median(np.log(np.where(known, views[k], 1)), axis=0), np.nan))


def _check_level(blocks: Float64) -> None:
    """Raises `DataError` where the bright blocks of a logarithm of views over flat lie on a plane that is not level."""
    i, j = np.nonzero(np.isfinite(blocks))
    values = blocks[i, j]
    places = np.stack(
        [np.ones(len(i)), 2 * i / max(blocks.shape[0] - 1, 1) - 1, 2 * j / max(blocks.shape[1] - 1, 1) - 1], 1
    )
    if len(values) < 30:
        return
    weights = np.ones(len(values))
    for _ in range(30):  # the upper envelope: expectile regression (Newey and Powell, Econometrica 55:819, 1987)
        root = np.sqrt(weights)
        plane = np.linalg.lstsq(places * root[:, None], values * root, rcond=None)[0]
        left = values - places @ plane
        weights = np.where(left > 0, 0.98, 0.02) / (1 + (left / 0.03) ** 2)
    near = np.abs(values - places @ plane) < 0.015
    slope = float(np.hypot(plane[1], plane[2]))
    if near.mean() < AIR or not LEVEL[0] < np.exp(np.median(values[near])) < LEVEL[1] or 2 * slope < TILT:
        return
    along = places[near][:, 1:] @ plane[1:] / slope
    if np.ptp(along) < 1.2:
        return
    axis = "rows" if abs(plane[1]) > abs(plane[2]) else "columns"
    raise DataError(
        f"flat: air in the views changes by {np.expm1(2 * slope):.0%} across the {axis} against the flat: was it taken with "
        f"the tube elsewhere or turned (the heel effect is on the other side)? Take it as the views were taken, or say with "
        f"flat_view= which view has the tube in its place"
    )


def _median(blocks: Float64, axis: int) -> Float64:
    """Median along an axis of what is finite, 0 where nothing is."""
    known = np.isfinite(blocks).sum(axis=axis, keepdims=True)
    middle = np.take_along_axis(np.sort(blocks, axis=axis), np.maximum(known - 1, 0) // 2, axis)  # NaN last
    return np.where(known > 0, middle, 0.0)


def _against_neighbours(image: Float64) -> Float64:
    padded = np.pad(image, 1, mode="edge")
    return image - (padded[2:, 1:-1] + padded[:-2, 1:-1] + padded[1:-1, 2:] + padded[1:-1, :-2]) / 4


def _limited(image: Float64, good: Bool) -> Float64:
    """Good pixels cut at three robust standard deviations: an edge in the object counts as little as any pixel."""
    spread = 1.4826 * float(np.median(np.abs(image[good]))) if good.any() else 0.0
    return np.where(good, np.clip(image, -3 * spread, 3 * spread), 0.0)


def _correlation(a: Float64, b: Float64) -> float:
    return float(np.vdot(a, b) / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-30))


def _refuse_at(name: str, frames: AnyArray, bad: Bool, what: str, remedy: str) -> None:
    if bad.any():
        frame, row, column = (int(i) for i in np.argwhere(bad)[0])
        raise DataError(
            f"{name}: {np.count_nonzero(bad)} values are {what} (first at frame {frame}, row {row}, column {column}: "
            f"{frames[frame, row, column]:g}); {remedy}"
        )
