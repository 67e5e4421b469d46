"""Writing labels as a DICOM segmentation (PS3.3 A.51): one bit a voxel, one frame for each slice of each segment."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydicom import Dataset

from palpate.arrays import Int32
from palpate.atomic_write import replacing, writable
from palpate.errors import DataError, GeometryError
from palpate.volumes.dicom_items import (
    code,
    common_items,
    decimals,
    dimension_items,
    fill,
    geometry_items,
    item,
    multi_frame_items,
    save,
)
from palpate.volumes.dicom_segmentation import SEGMENTATION, label_value_text
from palpate.volumes.dicom_source import (
    SourceImages,
    copy_patient_and_study,
    derivation,
    referenced_series,
    source_images,
)
from palpate.volumes.grid import Grid
from palpate.volumes.patient_axes import reordered_grid, reordered_view
from palpate.volumes.volume import Labels

MOST_SEGMENTS = 2**16 - 1  # Segment Number has 16 bits
MOST_BYTES = 2**32 - 2  # the length of Pixel Data has 32 bits, and is even
LONGEST = 64  # characters of Segment Label
TURNED = 1e-4  # between the cosines of two grids' axes; nearer ones are taken for equal, as by Grid
OTHERWISE = "or name the file .nii.gz, .nrrd or .mha"


@dataclass(frozen=True)
class Segment:
    """A label as a segment. named: whether `name` is the label's own."""

    value: int
    name: str
    named: bool


def write(path: Path, labels: Labels, like: str | Path | None) -> None:
    """Writes labels that lie on the grid of the images `like`, whole or not at all.

    Empty frames are left out, except where the first or the last slice has no label: by these a reader knows the whole
    grid, and that no body is cut off there.

    Raises `DataError` for labels that a segmentation cannot hold, `GeometryError` for another grid, `FileError`.
    """
    writable(path)
    source = source_images(like)
    values = _on_grid(labels, source.grid)
    present = [np.unique(plane[plane != 0]).tolist() for plane in values]
    segments = _segments(present, labels.names)
    frames = _frames(present, segments)
    size = (len(frames) * values[0].size + 7) // 8
    if size > MOST_BYTES:
        raise DataError(
            f"{path}: {len(frames)} frames are {size / 1e9:.1f} GB, a DICOM file holds 4.2 GB of pixels; write fewer labels "
            f"to a file, {OTHERWISE}"
        )
    dataset = _header(source)
    dataset.SegmentSequence = [_segment(i + 1, segment) for i, segment in enumerate(segments)]
    dataset.NumberOfFrames = len(frames)
    dataset.PerFrameFunctionalGroupsSequence = _frame_groups(source, frames)
    dataset.PixelData = packed_bits(values, [(segments[i].value, k) for i, k in frames])
    dataset["PixelData"].VR = "OB"
    with replacing(path) as temporary:
        save(temporary, dataset)


def packed_bits(values: Int32, frames: list[tuple[int, int]]) -> bytes:
    """Of each (label, slice) the voxels with that label, one bit each, one frame after the other (PS3.5 8.1.1, D.1).

    values: labels (z, y, x).
    """
    # Eight frames fill whole bytes, whatever the size of one.
    groups = [
        np.packbits(np.stack([values[k] == value for value, k in frames[i : i + 8]]), bitorder="little").tobytes()
        for i in range(0, len(frames), 8)
    ]
    return b"".join(groups)


def _on_grid(labels: Labels, grid: Grid) -> Int32:
    """Values (z, y, x) on the grid of the images. Axes may be swapped and reversed: other formats store them so."""
    ours = reordered_grid(labels.grid, grid.direction)
    if ours == grid:
        view: Int32 = reordered_view(labels.values, labels.grid, grid.direction)
        return view
    if np.abs(ours.direction - grid.direction).max() > TURNED:
        cosine = (np.trace(ours.direction.T @ grid.direction) - 1) / 2
        what = f"are oblique: turned by {np.degrees(np.arccos(np.clip(cosine, -1, 1))):.3g}° against the images"
    else:
        told = [
            f"have {name} {a} (z, y, x), the images {b}"
            for name, a, b in (("shape", ours.shape, grid.shape), ("spacing", ours.spacing, grid.spacing))
            if not np.allclose(a, b, rtol=1e-5)
        ]
        what = "; they ".join(told) or f"begin at {ours.origin} mm, the images at {grid.origin} mm"
    raise GeometryError(
        f"like: the labels {what}; a DICOM segmentation has the grid of its images: segment these, resample the labels, "
        f"{OTHERWISE}"
    )


def _segments(present: list[list[int]], names: Mapping[int, str]) -> list[Segment]:
    """Of the labels that are present, and of those that have only a name, by value. Raises `DataError`."""
    values = sorted({0}.union(names, *present) - {0})
    if not values:
        raise DataError("labels: there is none, and a DICOM segmentation needs one; segment the volume again")
    if values[0] < 0:
        raise DataError(f"labels: {values[0]} is negative; a DICOM segmentation takes labels from 1 on")
    if len(values) > MOST_SEGMENTS:
        raise DataError(
            f"labels: {len(values)} of them, a DICOM segmentation holds {MOST_SEGMENTS}; merge some, {OTHERWISE}"
        )
    for value in values:
        name = names.get(value, "unnamed")
        if not 0 < len(name) <= LONGEST or name != name.strip() or "\\" in name or not name.isprintable():
            raise DataError(
                f"labels: the name of label {value} is {name[:80]!r}; DICOM takes 1 to {LONGEST} characters without "
                f"backslash, line breaks, and spaces at the ends: rename it"
            )
    return [Segment(value, names.get(value, f"label {value}"), value in names) for value in values]


def _frames(present: list[list[int]], segments: list[Segment]) -> list[tuple[int, int]]:
    """(segment from 0, slice) of each frame, by segment, then by slice."""
    number = {segment.value: i for i, segment in enumerate(segments)}
    filled = [(number[value], k) for k, values in enumerate(present) for value in values]
    ends = [(0, k) for k in {0, len(present) - 1} if not present[k]]
    return sorted(filled + ends)


def _header(source: SourceImages) -> Dataset:
    """All but the segments and the frames."""
    dataset = common_items(SEGMENTATION, "SEG")
    fill(dataset, multi_frame_items())
    copy_patient_and_study(source, dataset)
    first = source.slices[0]
    step = np.linalg.norm(source.affine[:3, 2]) / np.linalg.norm(np.cross(*first.axes))
    spacing = (float(f"{step:.12g}"), float(first.spacing[0]), float(first.spacing[1]))
    return fill(
        dataset,
        {
            "SeriesDescription": "Segmentation",
            "ImageType": ["DERIVED", "PRIMARY"],
            "ContentLabel": "SEGMENTATION",
            "ContentDescription": "Label map",
            "ContentCreatorName": "",
            "SegmentationType": "BINARY",
            "SegmentsOverlap": "NO",
            "SamplesPerPixel": 1,
            "PhotometricInterpretation": "MONOCHROME2",
            "PixelRepresentation": 0,
            "Rows": first.values.shape[0],
            "Columns": first.values.shape[1],
            "BitsAllocated": 1,
            "BitsStored": 1,
            "HighBit": 0,
            "ReferencedSeriesSequence": [referenced_series(source)],
            "SharedFunctionalGroupsSequence": [item(**geometry_items(spacing, first.axes))],
            **dimension_items(
                [
                    (0x0062000B, 0x0062000A, "Referenced Segment Number"),
                    (0x00200032, 0x00209113, "Image Position (Patient)"),
                ]
            ),
        },
    )


def _segment(number: int, segment: Segment) -> Dataset:
    """The item of a segment. A label says no more of what it is than that it is tissue, and not how it was made."""
    return item(
        SegmentNumber=number,
        SegmentLabel=segment.name,
        SegmentDescription=label_value_text(segment.value, segment.named),
        SegmentAlgorithmType="SEMIAUTOMATIC",
        SegmentAlgorithmName="not recorded; label map written by palpate",
        SegmentedPropertyCategoryCodeSequence=[code("85756007", "SCT", "Tissue")],
        SegmentedPropertyTypeCodeSequence=[code("85756007", "SCT", "Tissue")],
    )


def _frame_groups(source: SourceImages, frames: list[tuple[int, int]]) -> list[Dataset]:
    """The functional groups of each frame: its segment, its place, and the image from which it comes."""
    slices = sorted({k for _, k in frames})
    rank = {k: i + 1 for i, k in enumerate(slices)}  # an index of a dimension has no gaps
    places = {k: decimals(source.affine[:3, 3] + k * source.affine[:3, 2]) for k in slices}
    derived = code("113076", "DCM", "Segmentation")
    purpose = code("121322", "DCM", "Source image for image processing operation")
    return [
        item(
            FrameContentSequence=[item(DimensionIndexValues=[i + 1, rank[k]])],
            PlanePositionSequence=[item(ImagePositionPatient=places[k])],
            DerivationImageSequence=[derivation(source, k, derived, purpose)],
            SegmentIdentificationSequence=[item(ReferencedSegmentNumber=i + 1)],
        )
        for i, k in frames
    ]
