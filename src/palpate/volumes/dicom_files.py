"""DICOM files: opening them, naming the tags that they lack, and the numbers in their pixels."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pydicom import Dataset, config, dcmread
from pydicom.datadict import dictionary_description, tag_for_keyword
from pydicom.pixels.decoders.base import get_decoder
from pydicom.uid import RLELossless

from palpate.arrays import AnyArray, Float64
from palpate.errors import DataError, FileError, PalpateError
from palpate.volumes.quiet import quiet

INFLATION = 2000  # no lossless image is so much smaller compressed: a header that claims more is damaged
# What decodes a compression that palpate does not bring a decoder for; permissively licensed, all of them.
PLUGINS = {"1.2.840.10008.1.2.4.80": "pyjpegls", "1.2.840.10008.1.2.4.81": "pyjpegls"}
OTHER_PLUGIN = "python-gdcm"
OVERVIEW = "LOCALIZER"  # a CT's overview often lies in the series of its slices
GROUPS = ("PerFrameFunctionalGroupsSequence", "SharedFunctionalGroupsSequence")


class Bounded(io.BufferedReader):
    """A file that never reserves memory for more bytes than it has, whatever length a damaged header asks for."""

    def __init__(self, path: Path) -> None:
        self.size = path.stat().st_size
        super().__init__(io.FileIO(path))

    def read(self, size: int | None = -1, /) -> bytes:
        """At most `size` bytes, at most to the end."""
        return super().read(size if size is None or size < 0 else min(size, max(self.size - self.tell(), 0)))


def is_dicom(path: Path) -> bool:
    """Whether the file at `path` says of itself that it is DICOM (Part 10: 128 bytes, then DICM)."""
    try:
        with path.open("rb") as file:
            return file.read(132)[128:] == b"DICM"
    except OSError:
        return False


def dicom_paths(folder: Path) -> list[Path]:
    """The DICOM files in a folder, by name; other files are passed over. Raises `FileError` when there is none."""
    found = sorted(p for p in folder.iterdir() if p.is_file() and p.name != "DICOMDIR" and is_dicom(p))
    if not found:
        raise FileError(f"{folder}: no DICOM file in this folder; name the folder in which they lie, or a file")
    return found


def series_in(folder: Path, wanted: str | None) -> list[Path]:
    """The files of the one series in a folder, or of that with the UID `wanted`; overviews of a CT are passed over.

    Raises `FileError`, which names a file of each, when there are several.
    """
    members: dict[str, list[Path]] = {}
    for path in dicom_paths(folder):
        with careful(path):
            header = opened(path, pixels=False)
            if OVERVIEW not in (header.get("ImageType") or []):
                if not has(header, "SeriesInstanceUID"):
                    raise FileError(f"{path}: lacks {named('SeriesInstanceUID')}; copy it again, or move it elsewhere")
                members.setdefault(str(header.SeriesInstanceUID), []).append(path)
    if wanted is not None:
        return members.get(wanted, [])
    if len(members) > 1:
        examples = [f"{paths[0].name} ({len(paths)} files)" for paths in list(members.values())[:6]]
        raise FileError(
            f"{folder}: holds {len(members)} series; name one file of the series that you want: {', '.join(examples)}"
        )
    return [path for paths in members.values() for path in paths]


@contextmanager
def careful(path: Path) -> Iterator[None]:
    """What pydicom makes of a damaged file, almost any exception, becomes a `FileError`; its warnings stay unheard."""
    before = config.settings.reading_validation_mode
    config.settings.reading_validation_mode = config.IGNORE
    try:
        with quiet():
            yield
    except (PalpateError, MemoryError):
        raise
    except Exception as problem:
        words = " ".join(str(problem).split())[:200] or type(problem).__name__
        raise FileError(f"{path}: damaged DICOM file ({words}); copy or export it again") from None
    finally:
        config.settings.reading_validation_mode = before


def opened(path: Path, pixels: bool = True) -> Dataset:
    """The data set in a file, without its pixels if they are not wanted. Raises `FileError`."""
    if not is_dicom(path):
        raise FileError(f"{path}: not a DICOM file (no DICM after 128 bytes); check the name")
    with careful(path):
        with Bounded(path) as file:
            dataset = dcmread(file, stop_before_pixels=not pixels)
        if "TransferSyntaxUID" not in dataset.file_meta:
            raise FileError(f"{path}: lacks {named('TransferSyntaxUID')}; export it again")
        return dataset


def named(keyword: str) -> str:
    """A tag as people look it up: "Pixel Spacing (0028,0030)"."""
    number = tag_for_keyword(keyword)
    assert number is not None, keyword
    return f"{dictionary_description(number)} ({number >> 16:04X},{number & 0xFFFF:04X})"


def has(dataset: Dataset, keyword: str) -> bool:
    """Whether a tag is there and not empty."""
    value = dataset.get(keyword)
    return value is not None and (not hasattr(value, "__len__") or len(value) > 0)


def numbers(where: str, dataset: Dataset, keyword: str, count: int, remedy: str = "export it again") -> Float64:
    """The `count` finite numbers of a tag. Raises a `FileError` that names the tag."""
    if not has(dataset, keyword):
        raise FileError(f"{where}: lacks {named(keyword)}; {remedy}")
    value = dataset[keyword].value
    try:
        array = np.array([float(v) for v in np.atleast_1d(np.asarray(value, dtype=object))])
    except (TypeError, ValueError):
        array = np.full(count, np.nan)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise FileError(
            f"{where}: {named(keyword)} is {str(value)[:60]!r}, expected {count} finite number(s); {remedy}"
        )
    return array


def number(where: str, dataset: Dataset, keyword: str, remedy: str = "export it again") -> float:
    """The one finite number of a tag. Raises a `FileError` that names the tag."""
    return float(numbers(where, dataset, keyword, 1, remedy)[0])


def group(dataset: Dataset, frame: int, macro: str) -> Dataset:
    """The functional group of one frame, or the one that all frames share; empty when there is neither."""
    for keyword, at in zip(GROUPS, (frame, 0), strict=True):
        items = dataset.get(keyword) or []
        if at < len(items) and has(items[at], macro):
            item: Dataset = items[at][macro].value[0]
            return item
    return Dataset()


def frames_of(where: str, dataset: Dataset) -> int:
    """How many images a file says that it holds."""
    return int(number(where, dataset, "NumberOfFrames")) if has(dataset, "NumberOfFrames") else 1


def pixels(path: Path, dataset: Dataset) -> AnyArray:
    """(frames, rows, columns) of the numbers as stored. Raises `FileError`, and `DataError` for colour."""
    where = str(path)
    rows, columns, allocated, stored, high, signed, samples = (
        int(number(where, dataset, k))
        for k in ("Rows", "Columns", "BitsAllocated", "BitsStored", "HighBit", "PixelRepresentation", "SamplesPerPixel")
    )
    frames = frames_of(where, dataset)
    if samples != 1:
        raise DataError(f"{path}: {samples} numbers a pixel, expected one (grey); it is no attenuation image")
    if min(rows, columns, frames) < 1 or allocated not in (8, 16, 32) or not 0 < stored <= high + 1 <= allocated:
        raise FileError(
            f"{path}: its header says {frames} frames of {rows} x {columns} pixels, bits {stored} of {allocated} up to "
            f"{high}: that cannot be; copy or export it again"
        )
    if not has(dataset, "PixelData"):
        raise FileError(f"{path}: lacks {named('PixelData')}: cut short, or no image; copy or export it again")
    shape = (frames, rows, columns)
    if dataset.file_meta.TransferSyntaxUID.is_compressed and not dataset.file_meta.TransferSyntaxUID.is_deflated:
        return _decoded(path, dataset, shape, allocated // 8)
    body, wanted = dataset.PixelData, frames * rows * columns * allocated // 8
    if len(body) < wanted:
        raise FileError(f"{path}: truncated: {len(body)} bytes of pixels, {wanted} expected; copy it again")
    order = "<" if dataset.file_meta.TransferSyntaxUID.is_little_endian else ">"
    kind = np.dtype(f"{order}{'i' if signed else 'u'}{allocated // 8}")
    values = np.frombuffer(body, kind, frames * rows * columns).reshape(shape)
    if stored == allocated:
        return values
    return (values << (allocated - 1 - high)) >> (allocated - stored)  # other bits may hold an overlay


def _decoded(path: Path, dataset: Dataset, shape: tuple[int, int, int], width: int) -> AnyArray:
    syntax = dataset.file_meta.TransferSyntaxUID
    try:
        available = get_decoder(syntax).is_available
    except NotImplementedError:
        raise FileError(f"{path}: transfer syntax {syntax.name} is no compression of images; export it again") from None
    if not available:
        raise FileError(
            f"{path}: compressed as {syntax.name}, and nothing here decodes that; pip install "
            f"{PLUGINS.get(str(syntax), OTHER_PLUGIN)}, or export it uncompressed"
        )
    wanted, there = int(np.prod(shape)) * width, len(dataset.PixelData)
    if wanted > INFLATION * there + 65536:
        raise FileError(f"{path}: says {shape} pixels, {wanted} bytes, in {there} compressed ones; copy it again")
    own = syntax == RLELossless  # pydicom's is in Python; another that may be installed panics on damaged files
    dataset.pixel_array_options(decoding_plugin="pydicom" if own else "")
    values: AnyArray = dataset.pixel_array
    if values.size != np.prod(shape):
        raise FileError(f"{path}: holds {values.shape} pixels, its header says {shape}; copy or export it again")
    return values.reshape(shape)
