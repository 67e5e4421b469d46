"""Reads what `palpate scan correct` is given."""

from pathlib import Path
from typing import Any

import palpate as pp
from palpate.arrays import AnyArray
from palpate.errors import DataError
from palpate.scans.raw_correction import AIR
from palpate.scans.raw_frames import number, number_or_frames, parse_lag, read_by_view, read_frames, read_mask, read_raw


def raw_inputs(
    raw: Path,
    geometry: Path | None,
    dark: str | None,
    flat: str | None,
    gain: str | None,
    lag: str | None,
    dose: str | None,
    offset: str | None,
    bad_pixels: Path | None,
) -> tuple[AnyArray, "pp.Views", dict[str, Any]]:
    """Read-outs, geometry, and the keywords of `correct_scan` that come from files. Raises `FileError`, `DataError`."""
    if flat is None:
        raise DataError(
            "flat: missing; give frames with the beam and no object (--flat flat.tif). If the views are flat-fielded "
            "already: palpate scan import"
        )
    if dark is None:
        raise DataError(
            "dark: missing; give frames without beam (--dark dark.tif), or --dark 0 if the panel subtracts it"
        )
    values, measured, views, g = read_raw(raw, geometry)
    shape = values.shape[1:]
    given: dict[str, Any] = {"mask": measured, "blur": None if g is None else g.blur}
    given["dark"], given["flat"] = (number_or_frames(name, w, g) for name, w in (("dark", dark), ("flat", flat)))
    if gain is not None:
        image = number_or_frames("gain", gain, g)
        given["gain"] = image if isinstance(image, float) else image.mean(axis=0)
    if lag is not None:
        given["lag"] = parse_lag(lag)
        if given["lag"] is None:
            exposed, offsets = (a if isinstance(a, float) else a.mean(axis=0) for a in (given["flat"], given["dark"]))
            given["lag"] = pp.lag_from_afterglow(read_frames("lag", Path(lag), g), exposed, offsets)
    if dose is not None:
        given["dose"] = dose if dose == AIR else read_by_view("dose", Path(dose), len(views), flat=True)
    if offset is not None:
        still = number(offset)
        given["offset"] = read_by_view("offset", Path(offset), len(views)) if still is None else still
    known = None if bad_pixels is None else read_mask(bad_pixels, g, shape)
    if g is not None and g.dead is not None:
        listed = read_mask(g.dead, g, shape)
        known = listed if known is None else known | listed
    return values, views, {**given, "bad_pixels": known}
