"""The display window: the two values that are shown black and white."""

from collections.abc import Iterable

import numpy as np
from skimage.filters import threshold_otsu

from palpate.arrays import AnyArray, Float32

SAMPLE = 500_000  # values that percentiles are taken of: they are then right to about 0.1 of a percentile
# Window widths and levels as reading rooms use them, as lowest and highest HU.
HOUNSFIELD = {
    "Soft tissue": (-160.0, 240.0),
    "Breast": (-200.0, 200.0),
    "Bone": (-500.0, 1300.0),
    "Lung": (-1350.0, 150.0),
}


def sample(values: AnyArray) -> Float32:
    """At most some `SAMPLE` finite values, evenly spread over the array."""
    step = values.size // SAMPLE | 1  # odd: an even one could meet the same columns of every row
    some = np.asarray(values.reshape(-1)[::step], dtype=np.float32)
    return some[np.isfinite(some)]


def default_window(values: AnyArray) -> tuple[float, float]:
    """The 0.5th to the 99.8th percentile: few voxels, such as metal or noise at the rim, do not set the contrast."""
    some = sample(values)
    low, high = np.percentile(some, [0.5, 99.8]) if some.size else (0.0, 1.0)
    return _with_width(float(low), float(high))


def window_presets(values: AnyArray, unit: str, water: float | None = None) -> dict[str, tuple[float, float, str]]:
    """Presets by name, the one to begin with first: low, high, and what they rest on.

    HU, or 1/mm with the attenuation of water (1/mm) known: the fixed windows of reading rooms. Otherwise percentiles of
    the object: the values above Otsu's threshold (of photons: below), which parts it from air.
    """
    data = {"Data": (*default_window(values), "0.5th to 99.8th percentile of all")}
    fixed: dict[str, tuple[float, float, str]] = {}
    for name, (low, high) in HOUNSFIELD.items():
        if unit == "HU":
            fixed[name] = (low, high, f"{low:g} to {high:g} HU")
        elif unit == "1/mm" and water:
            fixed[name] = (water * (1 + low / 1000), water * (1 + high / 1000), f"{low:g} to {high:g} HU")
    if unit == "HU":
        found = {**fixed, **data}
    elif unit == "photons":
        found = {**_of_object(-sample(values), -1), **data}  # the object is what stops them
    else:
        found = {**data, **(fixed or _of_object(sample(values)))}
    found["Full"] = (*_with_width(float(np.nanmin(values)), float(np.nanmax(values))), "lowest to highest value")
    return found


def _of_object(some: Float32, sign: int = 1) -> dict[str, tuple[float, float, str]]:
    """Percentiles of what lies above the threshold; sign: -1 if the values were given negated."""
    if not some.size or some.min() == some.max():
        return {}
    inside = sign * some[some > threshold_otsu(some)]
    marks: Iterable[tuple[str, float, float, str]] = (
        ("Breast", 1, 99.7, "1st to 99.7th percentile"),
        ("Soft tissue", 10, 90, "10th to 90th percentile"),
        ("Bone", 50, 99.99, "median to 99.99th percentile") if sign > 0 else ("Bone", 0.01, 50, "lowest to median"),
    )
    return {
        name: (*_with_width(*map(float, np.percentile(inside, [low, high]))), f"{what} of the object")
        for name, low, high, what in marks
    }


def _with_width(low: float, high: float) -> tuple[float, float]:
    """Widens a window whose two values are equal."""
    return (low, high) if high > low else (low, low + max(1e-6, 1e-3 * abs(low)))
