"""Reading DICOM segmentations: one frame for each slice of each segment, or one that holds the labels."""

import math
import re
import warnings
from pathlib import Path

import numpy as np
from pydicom import Dataset

from palpate.arrays import AnyArray, Float64
from palpate.bounded_read import check_claim
from palpate.errors import DataError, FileError
from palpate.volumes.dicom_io import (
    frame_count,
    functional_group,
    has_tag,
    stored_pixels,
    tag_name,
    tag_number,
    tag_numbers,
)
from palpate.volumes.dicom_items import MANUFACTURER
from palpate.volumes.file_axes import StoredImage

SEGMENTATION = "1.2.840.10008.5.1.4.1.1.66.4"
CLASSES = {SEGMENTATION: "Segmentation", "1.2.840.10008.5.1.4.1.1.66.7": "Label Map Segmentation"}
MOST_VOXELS = 2**29
FEWEST_SLICES = 0.02  # of all slices: a file that holds fewer is damaged
UNEQUAL = 0.01  # of a step between slices
VALUE = re.compile(r"label value (\d{1,10})(, no name)?")


def is_segmentation(dataset: Dataset) -> bool:
    """Whether a data set is a segmentation."""
    return str(dataset.get("SOPClassUID", "")) in CLASSES


def label_value_text(value: int, named: bool) -> str:
    """Segment Description of a label in a file that palpate writes: numbers of segments have no gaps, labels may."""
    return f"label value {value}" + ("" if named else ", no name")


def read(path: Path, dataset: Dataset) -> StoredImage:
    """Labels (slices, rows, columns) with the segments' names. Where segments overlap, the later one counts, with a warning.

    A fractional segmentation counts from half on. Palpate's own files say the labels' values, and hold the first and the
    last slice of their grid. Raises `FileError`, `DataError`.
    """
    own = dataset.get("Manufacturer") == MANUFACTURER
    numbers, names = _segments(path, dataset, own)
    frames = _frames(path, dataset)
    positions, axes, spacing = _places(path, dataset, len(frames))
    normal = np.cross(*axes)
    along = positions @ normal
    step = _step(path, dataset, along)
    at = np.round((along - along.min()) / step).astype(int)
    off = np.abs(along - along.min() - at * step).max()
    if off > UNEQUAL * step:
        raise FileError(f"{path}: slices are unequally spaced, up to {off:.3g} mm off {step:.5g} mm; resample it")
    shape = (int(at.max()) + 1, *frames.shape[1:])
    few = not own and len(np.unique(at)) < FEWEST_SLICES * shape[0]
    if math.prod(shape) > MOST_VOXELS or few:
        raise DataError(
            f"{path}: {len(np.unique(at))} slices of a volume of {shape} voxels; its positions are damaged, or crop it"
        )
    affine = np.eye(4)
    affine[:3, 0], affine[:3, 1] = axes[0] * spacing[1], axes[1] * spacing[0]
    affine[:3, 2], affine[:3, 3] = normal * step, positions[np.argmin(along)]
    if str(dataset.get("SegmentationType")) == "LABELMAP":
        values = np.zeros(shape, frames.dtype)
        values[at] = frames
        return StoredImage(values, affine, names={n: name for n, name in names.items() if n})
    values = _labelled(path, dataset, frames, at, shape)
    if own:
        values = np.array([numbers.get(n, n) for n in range(int(values.max()) + 1)], np.int32)[values]
    if not own and values.any(axis=(1, 2)).all():  # a file that leaves out what is empty: a free slice on both sides
        values = np.pad(values, ((1, 1), (0, 0), (0, 0)))
        affine[:3, 3] -= affine[:3, 2]
        warnings.warn(
            f"{path}: has no empty slice, so it cannot tell whether a body is cut off at its first or last one; "
            f"compare it with the images",
            stacklevel=4,
        )
    return StoredImage(values, affine, names=names)


def _segments(path: Path, dataset: Dataset, own: bool) -> tuple[dict[int, int], dict[int, str]]:
    """Number of each segment to the value of its label, and that to its name."""
    values, names = {}, {}
    for each in dataset.get("SegmentSequence") or []:
        number = int(tag_number(str(path), each, "SegmentNumber"))
        told = VALUE.fullmatch(str(each.get("SegmentDescription", ""))) if own else None
        values[number] = int(told[1]) if told else number
        if not (told and told[2]):
            names[values[number]] = str(each.get("SegmentLabel") or "segment")
    return values, names


def _labelled(path: Path, dataset: Dataset, frames: AnyArray, at: AnyArray, shape: tuple[int, ...]) -> AnyArray:
    """Labels of frames that each belong to one segment."""
    numbers = [
        int(
            tag_number(
                f"{path}, frame {i + 1}",
                functional_group(dataset, i, "SegmentIdentificationSequence"),
                "ReferencedSegmentNumber",
            )
        )
        for i in range(len(frames))
    ]
    if min(numbers) < 1 or max(numbers) > np.iinfo(np.uint16).max:
        raise FileError(f"{path}: {tag_name('ReferencedSegmentNumber')} is {min(numbers)} to {max(numbers)}")
    values, twice = np.zeros(shape, np.uint8 if max(numbers) < 256 else np.uint16), 0
    for i in np.argsort(numbers, kind="stable"):
        inside = frames[i] > 0
        there = values[at[i]]
        twice += int(np.count_nonzero(inside & (there != 0) & (there != numbers[i])))
        there[inside] = numbers[i]
    if twice:
        warnings.warn(f"{path}: segments overlap in {twice:,} voxels; the later segment counts there", stacklevel=4)
    return values


def _frames(path: Path, dataset: Dataset) -> AnyArray:
    """(frames, rows, columns); 0 and 1, or labels."""
    if str(dataset.get("SegmentationType")) == "FRACTIONAL":
        most = tag_number(str(path), dataset, "MaximumFractionalValue")
        return (2.0 * stored_pixels(path, dataset) >= max(most, 1.0)).astype(np.uint8)
    bits = int(tag_number(str(path), dataset, "BitsAllocated"))
    if bits != 1:
        return stored_pixels(path, dataset)
    shape = (frame_count(str(path), dataset), *(int(tag_number(str(path), dataset, k)) for k in ("Rows", "Columns")))
    if min(shape) < 1 or not has_tag(dataset, "PixelData"):
        raise FileError(f"{path}: its header says {shape} frames, rows, columns, or it has no pixels; copy it again")
    if dataset.file_meta.TransferSyntaxUID.is_compressed and not dataset.file_meta.TransferSyntaxUID.is_deflated:
        check_claim(path, f"{shape} pixels", math.prod(shape), len(dataset.PixelData))
        return np.asarray(dataset.pixel_array).reshape(shape)
    packed = np.frombuffer(dataset.PixelData, np.uint8)
    if 8 * len(packed) < math.prod(shape):
        raise FileError(
            f"{path}: truncated: {len(packed)} bytes of pixels, {math.prod(shape) // 8} expected; copy it again"
        )
    return np.unpackbits(packed, count=math.prod(shape), bitorder="little").reshape(shape)


def _places(path: Path, dataset: Dataset, count: int) -> tuple[Float64, Float64, Float64]:
    """Positions (frames, 3) mm, the axes of rows and columns (2, 3), mm between rows and columns."""
    positions = []
    for i in range(count):
        where = f"{path}, frame {i + 1}"
        group = functional_group(dataset, i, "PlanePositionSequence")
        positions.append(tag_numbers(where, group, "ImagePositionPatient", 3))
        axes = tag_numbers(
            where, functional_group(dataset, i, "PlaneOrientationSequence"), "ImageOrientationPatient", 6
        ).reshape(2, 3)
        spacing = tag_numbers(where, functional_group(dataset, i, "PixelMeasuresSequence"), "PixelSpacing", 2)
    return np.array(positions), axes, spacing


def _step(path: Path, dataset: Dataset, along: Float64) -> float:
    """Between slices, mm. Slices without any segment may be left out of the file."""
    measures = functional_group(dataset, 0, "PixelMeasuresSequence")
    told = next((k for k in ("SpacingBetweenSlices", "SliceThickness") if has_tag(measures, k)), None)
    places = np.unique(np.round(along, 4))
    least = float(np.diff(places).min()) if len(places) > 1 else math.inf
    between = abs(tag_number(str(path), measures, told)) if told else least
    if told == "SliceThickness" and least < math.inf:
        between = least
    if not (math.isfinite(between) and between > 0):
        raise FileError(
            f"{path}: one slice without {tag_name('SpacingBetweenSlices')}: its thickness is not known; export it again"
        )
    return between
