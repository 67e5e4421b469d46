"""DICOM files: reading data sets, tags and pixels, with clear errors."""

import io
import math
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pydicom import Dataset, FileDataset, config, dcmread
from pydicom.datadict import dictionary_description, tag_for_keyword
from pydicom.dataset import FileMetaDataset
from pydicom.encaps import generate_frames
from pydicom.filereader import read_dataset as read_elements
from pydicom.filereader import read_file_meta_info, read_preamble
from pydicom.pixels.decoders.base import get_decoder
from pydicom.tag import BaseTag
from pydicom.uid import (
    DeflatedExplicitVRLittleEndian,
    ExplicitVRBigEndian,
    ExplicitVRLittleEndian,
    ImplicitVRLittleEndian,
    RLELossless,
)

from palpate.arrays import AnyArray, Float64
from palpate.bounded_read import SLACK, check_claim
from palpate.errors import DataError, FileError, PalpateError
from palpate.volumes.suppress_output import suppress_output

READS = 250_000  # each element takes two or three; two thousand frames take half of it
HEADER = 64 * 2**20  # bytes, of a deflated data set without its pixels
PIXELS = 0x7FE00010
# What decodes a compression that palpate does not bring a decoder for; permissively licensed, all of them.
PLUGINS = {"1.2.840.10008.1.2.4.80": "pyjpegls", "1.2.840.10008.1.2.4.81": "pyjpegls"}
OTHER_PLUGIN = "python-gdcm"
KINDS = (b"UI", b"UL", b"OB", b"CS", b"DA", b"TM", b"LO", b"SH", b"DT")  # of values with which a data set begins
GROUPS = ("PerFrameFunctionalGroupsSequence", "SharedFunctionalGroupsSequence")


class BoundedFile(io.BufferedReader):
    """A file that reads no more bytes than it has, whatever length a damaged header gives, and not for ever."""

    def __init__(self, path: Path) -> None:
        self.size = path.stat().st_size
        self.reads = 0
        super().__init__(io.FileIO(path))

    def read(self, size: int | None = -1, /) -> bytes:
        """At most `size` bytes, at most to the end."""
        self.reads += 1
        if self.reads > READS:
            raise ValueError(f"more than {READS // 2} elements")
        if size is not None and size > self.size:
            raise ValueError(f"says a value of {size} bytes in a file of {self.size}")
        return super().read(size if size is None or size < 0 else min(size, max(self.size - self.tell(), 0)))


def is_dicom(path: Path) -> bool:
    """Whether the file at `path` is DICOM (Part 10: 128 bytes, then DICM), or begins with a bare data set."""
    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            head = file.read(132)
    except OSError:
        return False
    return head[128:] == b"DICM" or _begins_data_set(head)


def _begins_data_set(head: bytes) -> bool:
    """Whether a file begins with the elements of a data set, as some anonymisers leave it: group 2 or 8, length as told."""
    if len(head) < 132:
        return False
    group, element, kind, short = struct.unpack("<2H2sH", head[:8])
    (length,) = struct.unpack("<I", head[4:8])
    return group in (2, 8) and element <= 0x100 and bool((kind in KINDS and short <= 64) or length <= 64)


def dicom_paths(folder: Path) -> list[Path]:
    """The DICOM files in a folder, by name; other files are passed over. Raises `FileError` when there is none."""
    found = sorted(p for p in folder.iterdir() if p.is_file() and p.name != "DICOMDIR" and is_dicom(p))
    if not found:
        raise FileError(f"{folder}: no DICOM file in this folder; name the folder in which they lie, or a file")
    return found


@contextmanager
def reading_dicom(path: Path) -> Iterator[None]:
    """Turns any exception of pydicom on a damaged file into a `FileError`, and suppresses its warnings."""
    before = config.settings.reading_validation_mode
    config.settings.reading_validation_mode = config.IGNORE
    try:
        with suppress_output():
            yield
    except (PalpateError, MemoryError):
        raise
    except Exception as problem:
        words = " ".join(str(problem).split())[:200] or type(problem).__name__
        raise FileError(f"{path}: damaged DICOM file ({words}); copy or export it again") from None
    finally:
        config.settings.reading_validation_mode = before


def read_dataset(path: Path, pixels: bool = True) -> Dataset:
    """The data set in a file, without its pixels if they are not wanted. Raises `FileError`."""
    if not is_dicom(path):
        raise FileError(f"{path}: not a DICOM file (no DICM after 128 bytes, no data set at its start); check the name")
    with reading_dicom(path):
        with BoundedFile(path) as file:
            head = file.read(min(4096, file.size))
            whole = head[128:132] == b"DICM"
            file.seek(0)
            meta = (
                read_file_meta_info(path)
                if whole and DeflatedExplicitVRLittleEndian.encode() in head
                else FileMetaDataset()
            )
            if meta.get("TransferSyntaxUID") == DeflatedExplicitVRLittleEndian:
                dataset = _deflated(path, file, meta, pixels)
            else:
                dataset = dcmread(file, stop_before_pixels=not pixels, force=True)
        if "TransferSyntaxUID" not in dataset.file_meta:
            packed = "PixelData" in dataset and dataset["PixelData"].is_undefined_length
            if whole or packed:
                raise FileError(f"{path}: lacks {tag_name('TransferSyntaxUID')}; export it again")
            implicit, little = dataset.original_encoding
            plain = ExplicitVRLittleEndian if little else ExplicitVRBigEndian
            dataset.file_meta.TransferSyntaxUID = ImplicitVRLittleEndian if implicit else plain
        return dataset


def _deflated(path: Path, file: BoundedFile, meta: FileMetaDataset, pixels: bool) -> Dataset:
    """A data set that is deflated, as long as its header says."""
    preamble = read_preamble(file, force=True)
    file.seek(132 + 12 + meta.FileMetaInformationGroupLength)
    stream, packed = zlib.decompressobj(-zlib.MAX_WBITS), file.read()
    whole = stream.decompress(packed, HEADER)

    def parsed(stop: Callable[[BaseTag, str | None, int], bool] | None) -> Dataset:
        found = read_elements(io.BytesIO(whole), False, True, stop_when=stop)
        return FileDataset(path, found, preamble, meta, False, True)

    header = parsed(lambda tag, vr, length: tag == PIXELS)
    if not pixels:
        return header
    frames, rows, columns, width = (
        int(header.get(k) or 1) for k in ("NumberOfFrames", "Rows", "Columns", "BitsAllocated")
    )
    size = max(frames * rows * columns * width // 8, 0)
    check_claim(path, f"{frames} frames of {rows} x {columns} pixels", size, len(packed))
    whole += stream.decompress(stream.unconsumed_tail, size + SLACK) if stream.unconsumed_tail else b""
    if not stream.eof:
        raise FileError(
            f"{path}: its data set is cut short, or goes on after {len(whole)} bytes; copy or export it again"
        )
    return parsed(None)


def tag_name(keyword: str) -> str:
    """A tag by name and number: "Pixel Spacing (0028,0030)"."""
    number = tag_for_keyword(keyword)
    assert number is not None, keyword
    return f"{dictionary_description(number)} ({number >> 16:04X},{number & 0xFFFF:04X})"


def has_tag(dataset: Dataset, keyword: str) -> bool:
    """Whether a tag is there and not empty."""
    value = dataset.get(keyword)
    return value is not None and (not hasattr(value, "__len__") or len(value) > 0)


def tag_numbers(where: str, dataset: Dataset, keyword: str, count: int, remedy: str = "export it again") -> Float64:
    """The `count` finite numbers of a tag. Raises a `FileError` that names the tag."""
    if not has_tag(dataset, keyword):
        raise FileError(f"{where}: lacks {tag_name(keyword)}; {remedy}")
    value = dataset[keyword].value
    try:
        array = np.array([float(v) for v in np.atleast_1d(np.asarray(value, dtype=object))])
    except (TypeError, ValueError):
        array = np.full(count, np.nan)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise FileError(
            f"{where}: {tag_name(keyword)} is {str(value)[:60]!r}, expected {count} finite number(s); {remedy}"
        )
    return array


def tag_number(where: str, dataset: Dataset, keyword: str, remedy: str = "export it again") -> float:
    """The one finite number of a tag. Raises a `FileError` that names the tag."""
    return float(tag_numbers(where, dataset, keyword, 1, remedy)[0])


def functional_group(dataset: Dataset, frame: int, macro: str) -> Dataset:
    """The functional group of one frame, or the one that all frames share; empty when there is neither."""
    for keyword, at in zip(GROUPS, (frame, 0), strict=True):
        items = dataset.get(keyword) or []
        if at < len(items) and has_tag(items[at], macro):
            item: Dataset = items[at][macro].value[0]
            return item
    return Dataset()


def frame_count(where: str, dataset: Dataset) -> int:
    """Number of images in a file, by its header."""
    return int(tag_number(where, dataset, "NumberOfFrames")) if has_tag(dataset, "NumberOfFrames") else 1


def stored_pixels(path: Path, dataset: Dataset) -> AnyArray:
    """(frames, rows, columns) of the numbers as stored. Raises `FileError`, and `DataError` for colour."""
    where = str(path)
    rows, columns, allocated, stored, high, signed, samples = (
        int(tag_number(where, dataset, k))
        for k in ("Rows", "Columns", "BitsAllocated", "BitsStored", "HighBit", "PixelRepresentation", "SamplesPerPixel")
    )
    frames = frame_count(where, dataset)
    if samples != 1:
        raise DataError(f"{path}: {samples} numbers a pixel, expected one (grey); it is no attenuation image")
    if min(rows, columns, frames) < 1 or allocated not in (8, 16, 32) or not 0 < stored <= high + 1 <= allocated:
        raise FileError(
            f"{path}: its header says {frames} frames of {rows} x {columns} pixels, bits {stored} of {allocated} up to "
            f"{high}: that cannot be; copy or export it again"
        )
    if not has_tag(dataset, "PixelData"):
        raise FileError(f"{path}: lacks {tag_name('PixelData')}: cut short, or no image; copy or export it again")
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
    check_claim(path, f"{shape} pixels", math.prod(shape) * width, len(dataset.PixelData))
    _check_jpeg_2000(dataset.PixelData, shape)
    own = syntax == RLELossless  # pydicom's is in Python; another that may be installed panics on damaged files
    dataset.pixel_array_options(decoding_plugin="pydicom" if own else "")
    values: AnyArray = dataset.pixel_array
    if values.size != math.prod(shape):
        raise FileError(f"{path}: holds {values.shape} pixels, its header says {shape}; copy or export it again")
    return values.reshape(shape)


def _check_jpeg_2000(pixels: bytes, shape: tuple[int, int, int]) -> None:
    """Raises `ValueError` if a JPEG 2000 stream says another size than the header: its decoder makes room for that."""
    for frame in generate_frames(pixels, number_of_frames=shape[0]):
        start = frame[:1000].find(b"\xff\x4f\xff\x51")
        if start >= 0:
            width, height, left, top = struct.unpack_from(">4I", frame, start + 8)
            if (height - top, width - left) != shape[1:]:
                raise ValueError(f"an image of {height - top} x {width - left} pixels, its header says {shape[1:]}")
