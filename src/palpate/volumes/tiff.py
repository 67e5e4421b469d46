"""TIFF stacks with a voxel size: ImageJ (.tif) and OME-TIFF (.ome.tif)."""

import lzma
import math
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import tifffile

from palpate.arrays import AnyArray, Float64
from palpate.bounded_read import check_claim
from palpate.errors import FileError
from palpate.volumes.file_axes import StoredImage, voxel_size
from palpate.volumes.grid_metadata import metadata_text, read_metadata_text, read_notes
from palpate.volumes.suppress_output import suppress_output

TO_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "µm": 0.001, "um": 0.001, "\\u00B5m": 0.001, "micron": 0.001, "nm": 1e-6}
SIZES = ("SizeX", "SizeY", "SizeZ", "SizeC", "SizeT")
ELEMENTS = 500_000  # of OME's XML; each plane may take some
LZMA_MEMORY = 2**28  # bytes, more than xz -9 asks for
# By TIFF's number of a compression: what unpacks it. tifffile's own decoders of these unpack whatever comes out.
UNPACK: dict[int, Callable[[], Any]] = {
    8: zlib.decompressobj,
    32946: zlib.decompressobj,
    34925: lambda: lzma.LZMADecompressor(memlimit=LZMA_MEMORY),
}


def read(path: Path) -> StoredImage:
    """Raises `FileError` when the file is not TIFF, ends early, or says no voxel size."""
    with whole_series(path) as (tif, series):
        spacing, origin, text = _ome(tif.ome_metadata) if tif.is_ome else _imagej(tif)
        values: AnyArray = series.asarray()
    if spacing is None or not np.isfinite(spacing).all() or (spacing <= 0).any():
        raise FileError(
            f"{path}: says no voxel size in a unit of length; set it in ImageJ (Image, Properties) or as OME"
        )
    affine, unit = read_metadata_text(text, spacing, origin)
    return StoredImage(values, affine, unit, notes=read_notes(text))


@contextmanager
def whole_series(path: Path) -> Iterator[tuple[Any, Any]]:
    """The open file and its first series, once it is sure that its pixels are all there; any exception is a `FileError`."""
    try:
        _check_pages(path)
        with suppress_output(), tifffile.TiffFile(path) as tif:
            if str(getattr(tif.pages[0], "description", "")).count("<") > ELEMENTS:
                raise ValueError(f"its description has more than {ELEMENTS} elements of XML")
            if tif.is_ome:
                sizes = [int(n) for key, n in _pixels(tif.ome_metadata)[0].items() if key in SIZES]
                check_claim(path, f"OME sizes {sizes}", math.prod(sizes), path.stat().st_size)
            series = tif.series[0]
            size = path.stat().st_size
            check_claim(path, f"{series.shape} pixels", math.prod(map(int, series.shape)) * series.dtype.itemsize, size)
            if _end(series) > size:
                raise FileError(f"{path}: truncated: pixels to byte {_end(series)} of {size}; copy it again")
            _check_compressed(path, series)
            yield tif, series
    except (FileError, MemoryError):
        raise
    except Exception as problem:  # tifffile raises almost anything on a damaged file
        raise FileError(f"{path}: not a whole TIFF file ({problem}); copy or export it again") from None


def write(path: Path, stored: StoredImage) -> None:
    """Uncompressed. ImageJ's resolution is a rounded fraction; the exact place is in a text beside it."""
    dx, dy, dz = voxel_size(stored.affine)
    if path.name.lower().endswith((".ome.tif", ".ome.tiff")):
        sizes = {f"PhysicalSize{a}": float(d) for a, d in zip("XYZ", (dx, dy, dz), strict=True)}
        units = {f"PhysicalSize{a}Unit": "mm" for a in "XYZ"}
        metadata: dict[str, Any] = {"axes": "ZYX", **sizes, **units, "Description": metadata_text(stored)}
        tifffile.imwrite(path, stored.values, ome=True, photometric="minisblack", metadata=metadata)
        return
    values = stored.values if stored.values.dtype != np.int32 else stored.values.astype(np.float32)
    metadata = {"axes": "ZYX", "spacing": float(dz), "unit": "mm", "Info": metadata_text(stored)}
    tifffile.imwrite(path, values, imagej=True, resolution=(1 / dx, 1 / dy), metadata=metadata)


def _end(series: Any) -> int:
    """Where the last voxel ends in the file."""
    whole = 0 if series.dataoffset is None else int(series.dataoffset + series.nbytes)
    pages = [page for page in series.pages if page is not None]
    ends = [int(a) + int(n) for p in pages for a, n in zip(p.dataoffsets, p.databytecounts, strict=True)]
    return max([whole, *ends])


def _check_pages(path: Path) -> None:
    """Raises `ValueError` if a page points back to one before it: tifffile would go round and round."""
    with path.open("rb") as file:
        head = file.read(16)
        order = "<" if head[:2] == b"II" else ">"
        count, entry, place = ("Q", 20, "Q") if 43 in head[2:4] else ("H", 12, "I")
        width = struct.calcsize(place)
        at = struct.unpack_from(order + place, head, width)[0] if len(head) == 16 else 0
        seen: set[int] = set()
        while at:
            if at in seen:
                raise ValueError(f"its page at byte {at} follows itself")
            seen.add(at)
            file.seek(at)
            head = file.read(struct.calcsize(count))
            if len(head) == struct.calcsize(count):
                file.seek(struct.unpack(order + count, head)[0] * entry, 1)
                head = file.read(width)
            at = struct.unpack(order + place, head)[0] if len(head) == width else 0  # a file that is cut ends here


def _check_compressed(path: Path, series: Any) -> None:
    """Raises `ValueError` if a compressed piece of a page holds more than the page's shape says."""
    pages = [page for page in series.pages if page is not None and page.compression in UNPACK]
    for page in pages:
        most = math.prod(page.chunks) * page.dtype.itemsize
        with path.open("rb") as file:
            for at, count in zip(page.dataoffsets, page.databytecounts, strict=True):
                file.seek(at)
                packed, left = file.read(count), most + 1
                while packed and left > 0:  # LZMA's streams may follow each other
                    stream = UNPACK[page.compression]()
                    left -= len(stream.decompress(packed, left))
                    packed = stream.unused_data if stream.eof else b""
                if left <= 0:
                    raise ValueError(f"compressed pixels go on after the {most} bytes that are said to be in them")


def _ome(text: str | None) -> tuple[Float64 | None, Float64 | None, str]:
    """Spacing (x, y, z) mm, origin, and our own text."""
    said, words = _pixels(text)
    if any(f"PhysicalSize{a}" not in said for a in "XYZ"):
        return None, None, words
    scale = [TO_MM.get(said.get(f"PhysicalSize{a}Unit", "µm"), np.nan) for a in "XYZ"]
    return np.array([float(said[f"PhysicalSize{a}"]) for a in "XYZ"]) * scale, None, words


def _pixels(text: str | None) -> tuple[dict[str, str], str]:
    """What OME's text says of the first image's pixels, and its description."""
    root = ElementTree.fromstring(text or "")
    space = root.tag.partition("}")[0] + "}" if root.tag.startswith("{") else ""
    found = root.find(f"{space}Image/{space}Pixels")
    return {} if found is None else found.attrib, root.findtext(f"{space}Image/{space}Description") or ""


def _imagej(tif: Any) -> tuple[Float64 | None, Float64 | None, str]:
    said = tif.imagej_metadata or {}
    tags = tif.pages[0].tags
    scale = TO_MM.get(str(said.get("unit", "")))
    if scale is None or "spacing" not in said or "XResolution" not in tags or "YResolution" not in tags:
        return None, None, ""
    across = [float(b) / float(a) for a, b in (tags["XResolution"].value, tags["YResolution"].value)]
    return np.array([*across, abs(float(said["spacing"]))]) * scale, None, str(said.get("Info", ""))
