"""TIFF stacks with a voxel size: ImageJ's (.tif), or OME-TIFF (.ome.tif)."""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import tifffile

from palpate.arrays import AnyArray, Float64
from palpate.errors import FileError
from palpate.volumes.placed import place_text, placed
from palpate.volumes.quiet import quiet
from palpate.volumes.stored import Stored, lengths

TO_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "µm": 0.001, "um": 0.001, "\\u00B5m": 0.001, "micron": 0.001, "nm": 1e-6}
MOST = 2000  # times the file's size: no compression of images does more


def read(path: Path) -> Stored:
    """Raises `FileError` when the file is not TIFF, ends early, or says no voxel size."""
    try:
        with quiet(), tifffile.TiffFile(path) as tif:
            series = tif.series[0]
            claimed = int(np.prod([int(n) for n in series.shape], dtype=object)) * series.dtype.itemsize
            if claimed > MOST * path.stat().st_size:
                raise FileError(f"{path}: says {series.shape} voxels in {path.stat().st_size} bytes; copy it again")
            if _end(series) > path.stat().st_size:
                raise FileError(
                    f"{path}: truncated: voxels to byte {_end(series)} of {path.stat().st_size}; copy it again"
                )
            spacing, origin, text = _ome(tif.ome_metadata) if tif.is_ome else _imagej(tif)
            values: AnyArray = series.asarray()
    except FileError:
        raise
    except Exception as problem:  # tifffile raises almost anything on a damaged file
        raise FileError(f"{path}: not a whole TIFF file ({problem}); copy or export it again") from None
    if spacing is None or not np.isfinite(spacing).all() or (spacing <= 0).any():
        raise FileError(
            f"{path}: says no voxel size in a unit of length; set it in ImageJ (Image, Properties) or as OME"
        )
    affine, unit = placed(text, spacing, origin)
    return Stored(values, affine, unit)


def write(path: Path, stored: Stored) -> None:
    """Uncompressed. ImageJ's resolution is a rounded fraction; the exact place is in a text beside it."""
    dx, dy, dz = lengths(stored.affine)
    if path.name.lower().endswith((".ome.tif", ".ome.tiff")):
        sizes = {f"PhysicalSize{a}": float(d) for a, d in zip("XYZ", (dx, dy, dz), strict=True)}
        units = {f"PhysicalSize{a}Unit": "mm" for a in "XYZ"}
        metadata: dict[str, Any] = {"axes": "ZYX", **sizes, **units, "Description": place_text(stored)}
        tifffile.imwrite(path, stored.values, ome=True, photometric="minisblack", metadata=metadata)
        return
    values = stored.values if stored.values.dtype != np.int32 else stored.values.astype(np.float32)
    metadata = {"axes": "ZYX", "spacing": float(dz), "unit": "mm", "Info": place_text(stored)}
    tifffile.imwrite(path, values, imagej=True, resolution=(1 / dx, 1 / dy), metadata=metadata)


def _end(series: Any) -> int:
    """Where the last voxel ends in the file."""
    if series.dataoffset is not None:
        return int(series.dataoffset + series.nbytes)
    pages = [page for page in series.pages if page is not None]
    return max(
        (int(a) + int(n) for p in pages for a, n in zip(p.dataoffsets, p.databytecounts, strict=True)), default=0
    )


def _ome(text: str | None) -> tuple[Float64 | None, Float64 | None, str]:
    """Spacing (x, y, z) mm, origin, and our own text."""
    root = ElementTree.fromstring(text or "")
    space = root.tag.partition("}")[0] + "}" if root.tag.startswith("{") else ""
    found = root.find(f"{space}Image/{space}Pixels")
    words = root.findtext(f"{space}Image/{space}Description") or ""
    if found is None or any(f"PhysicalSize{a}" not in found.attrib for a in "XYZ"):
        return None, None, words
    scale = [TO_MM.get(found.get(f"PhysicalSize{a}Unit", "µm"), np.nan) for a in "XYZ"]
    return np.array([float(found.attrib[f"PhysicalSize{a}"]) for a in "XYZ"]) * scale, None, words


def _imagej(tif: Any) -> tuple[Float64 | None, Float64 | None, str]:
    said = tif.imagej_metadata or {}
    tags = tif.pages[0].tags
    scale = TO_MM.get(str(said.get("unit", "")))
    if scale is None or "spacing" not in said or "XResolution" not in tags or "YResolution" not in tags:
        return None, None, ""
    across = [float(b) / float(a) for a, b in (tags["XResolution"].value, tags["YResolution"].value)]
    return np.array([*across, abs(float(said["spacing"]))]) * scale, None, str(said.get("Info", ""))
