"""Finds the pixels of a panel that do not measure, by dark, flat and views."""

import numpy as np
from scipy import ndimage

from palpate.arrays import AnyArray, ArrayLike, Bool, Float32, Float64, UInt8, float32
from palpate.errors import DataError
from palpate.scans.beam_profile import block_medians, step

KINDS = ("good", "given", "dead", "under-responding", "over-responding", "hot", "noisy", "in a line", "changed")
GOOD, GIVEN, DEAD, UNDER, OVER, HOT, NOISY, LINE, CHANGED = range(len(KINDS))
# ASTM E2597: response against the median of the 21 x 21 pixels around, and noise against the panel's median noise
NEIGHBOURHOOD, LOW, HIGH, RESTLESS = 21, 0.6, 1.3, 6.0
NONE = 0.1  # of the response around: no response at all
HOTTEST = 8.0  # standard deviations of the dark's pattern
FEWEST = 5  # frames that tell a pixel's noise
SHARE = 0.5  # of the pixels of a line that are bad: then it is a bad line
SURE, MUCH = 6.0, 0.1  # of a pixel's lasting deviation in the views: standard deviations, and in line integral
VIEWS = 5  # to look at
RING = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]])  # the eight neighbours


def find_bad_pixels(dark: ArrayLike, flat: ArrayLike, given: ArrayLike | None = None) -> UInt8:
    """Find bad pixels and bad lines from dark and flat.

    A pixel is dead, under- or over-responding if it responds with less than 0.1, less than 0.6 or more than 1.3 times the
    median around it. It is noisy if it varies from frame to frame 6 times as much as the median of the panel. It is hot if
    its dark deviates by 8 standard deviations of the dark's pattern. A row or column of which half is bad is a bad line.

    Parameters
    ----------
    dark : array_like, (rows, columns) or (frames, rows, columns)
        Frames without beam. Noise is judged from five frames on.
    flat : array_like, (rows, columns) or (frames, rows, columns)
        Frames without object.
    given : array_like of bool, (rows, columns), optional
        Pixels that are known to be bad.

    Returns
    -------
    ndarray of uint8, (rows, columns)
        0 for good, else the position in `scans.bad_pixels.KINDS`.

    Raises
    ------
    DataError
        If the shapes differ.

    References
    ----------
    ASTM E2597/E2597M, Standard Practice for Manufacturing Characterization of Digital Detector Arrays.

    Examples
    --------
    >>> flat = np.full((40, 48), 1000.0)
    >>> flat[7, 9] = 0
    >>> np.argwhere(pp.find_bad_pixels(np.zeros((40, 48)), flat)).tolist()
    [[7, 9]]
    """
    darks, flats = (_stack(name, a) for name, a in (("dark", dark), ("flat", flat)))
    if darks.shape[1:] != flats.shape[1:]:
        raise DataError(f"dark: {darks.shape[1:]} pixels, the flat has {flats.shape[1:]}; take both with one panel")
    offset = darks.mean(axis=0, dtype=np.float64)
    signal = flats.mean(axis=0, dtype=np.float64) - offset
    kinds = np.zeros(offset.shape, np.uint8)
    known = np.zeros(kinds.shape, bool) if given is None else np.asarray(given)
    if known.dtype != bool or known.shape != kinds.shape:
        raise DataError(f"bad_pixels: expected bool of shape {kinds.shape}, got {known.dtype} {known.shape}")
    response = signal / np.maximum(around(signal, known), 1e-12)
    pattern = offset - around(offset, known)
    kinds[np.abs(pattern) > HOTTEST * _spread(pattern)] = HOT
    for frames in (darks, flats):
        kinds[_noisy(frames)] = NOISY
    kinds[response > HIGH] = OVER
    kinds[response < LOW] = UNDER
    kinds[response < NONE] = DEAD
    kinds[known] = GIVEN
    return with_lines(kinds)


def with_lines(kinds: UInt8) -> UInt8:
    """The kinds with whole rows and columns of which half is bad, and pixels whose eight neighbours are bad."""
    found = kinds.copy()
    bad = kinds != GOOD
    for axis in (0, 1):
        lines = bad.mean(axis=axis) > SHARE
        found[(slice(None), lines) if axis == 0 else (lines, slice(None))] = LINE
    found[kinds == GIVEN] = GIVEN
    around_bad = ndimage.minimum_filter(found != GOOD, footprint=RING, mode="nearest")
    found[around_bad & (found == GOOD)] = UNDER
    return found


def changed_in_views(photons: AnyArray, beam: AnyArray, kinds: UInt8) -> Bool:
    """(rows, columns): pixels and lines that differ from those around in most views, though dark and flat do not say so.

    photons, beam: (views, rows, columns). In units of the noise of photons, since a shadow's noise varies.
    """
    some = np.unique(np.linspace(0, len(photons) - 1, min(VIEWS, len(photons))).astype(int))
    nearest = ndimage.distance_transform_edt(kinds != GOOD, return_distances=False, return_indices=True)
    deviations, sizes, beyond = [], [], []
    for k in some:
        y = photons[k][tuple(nearest)]  # of the nearest good pixel
        l = np.log(np.maximum(y, 0.5) / np.maximum(beam[k][tuple(nearest)], 0.5))
        left = l - ndimage.median_filter(l, size=5, mode="nearest")
        sizes.append(left)
        deviations.append(left * np.sqrt(np.maximum(ndimage.median_filter(y, size=3, mode="nearest"), 1)))
        highest, lowest = (
            f(l, footprint=RING, mode="nearest") for f in (ndimage.maximum_filter, ndimage.minimum_filter)
        )
        beyond.append((l > highest) | (l < lowest))
    lasting = (np.abs(np.median(deviations, axis=0)) > SURE) & (np.abs(np.median(sizes, axis=0)) > MUCH)
    found = lasting & (np.mean(beyond, axis=0) > SHARE)  # beyond all neighbours: no edge of the object is
    rows, columns = (lasting.mean(axis=axis) > SHARE for axis in (1, 0))
    return np.asarray((found | rows[:, None] | columns) & (kinds == GOOD))


def around(image: Float64, without: Bool) -> Float64:
    """Median of the 21 x 21 pixels (or more) around each, of those that are not left out; between blocks interpolated."""
    medians = block_medians(np.where(without, np.nan, image), NEIGHBOURHOOD)
    known = np.isfinite(medians)
    medians = np.where(known, medians, np.median(medians[known]) if known.any() else np.median(image))
    places = [
        (np.arange(n) + 0.5) / step(n, NEIGHBOURHOOD) - 0.5 for n in image.shape
    ]  # in blocks, from the first's middle
    smooth: Float64 = ndimage.map_coordinates(medians, np.meshgrid(*places, indexing="ij"), order=1, mode="nearest")
    return smooth


def _stack(name: str, values: ArrayLike) -> Float32:
    array = np.asarray(values)
    return float32(name, array[None] if array.ndim == 2 else array, (None, None, None))


def _spread(values: Float64) -> float:
    return float(
        max(1.4826 * np.median(np.abs(values - np.median(values))), 1e-9 * max(np.abs(values).max(), 1), 1e-12)
    )


def _noisy(frames: Float32) -> Bool:
    if len(frames) < FEWEST:
        return np.zeros(frames.shape[1:], bool)
    levels = np.median(frames, axis=(1, 2))
    level = levels.mean()
    scaled = frames * (level / levels)[:, None, None] if (levels > 0.5 * level).all() and level > 0 else frames
    deviation = scaled.std(axis=0, ddof=1)
    usual = max(float(np.median(deviation)), 0.3 if (frames == np.round(frames)).all() else 0.0)  # rounding has 0.29
    return np.asarray(deviation > RESTLESS * usual) if usual > 0 else np.zeros(frames.shape[1:], bool)
