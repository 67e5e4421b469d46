"""Reading DICOM volumes: CT series (one file for each slice), enhanced multi-frame CT, breast tomosynthesis."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from pydicom import Dataset

from palpate.arrays import AnyArray, Float64
from palpate.errors import DataError, FileError
from palpate.volumes import dicom_segmentation
from palpate.volumes.dicom_io import (
    frame_count,
    functional_group,
    has_tag,
    read_dataset,
    reading_dicom,
    stored_pixels,
    tag_name,
    tag_number,
    tag_numbers,
)
from palpate.volumes.dicom_series import series_paths
from palpate.volumes.file_axes import StoredImage

CLASSES = {  # storage SOP classes that hold volumes
    "1.2.840.10008.5.1.4.1.1.2": "CT Image",
    "1.2.840.10008.5.1.4.1.1.2.1": "Enhanced CT Image",
    "1.2.840.10008.5.1.4.1.1.2.2": "Legacy Converted Enhanced CT Image",
    "1.2.840.10008.5.1.4.1.1.13.1.1": "X-Ray 3D Angiographic Image",
    "1.2.840.10008.5.1.4.1.1.13.1.2": "X-Ray 3D Craniofacial Image",
    "1.2.840.10008.5.1.4.1.1.13.1.3": "Breast Tomosynthesis Image",
}
UNITS = {"[hnsf'U]": "HU", "/mm": "1/mm", "mm-1": "1/mm"}  # UCUM codes
UNEQUAL = 0.01  # steps between slices may differ by this share: positions are rounded decimal texts
ALIKE = 1e-4  # cosines and mm


@dataclass(frozen=True, eq=False)
class Slice:
    """One image of a stack. axes: (2, 3), directions of a row and of a column; spacing: mm between rows, columns.

    values: (rows, columns) as stored; what they mean is slope · value + intercept, in `unit`. header: of its file, without
    the pixels; frame: its number in that file from 1, None where the file has one image.
    """

    where: str
    values: AnyArray
    position: Float64
    axes: Float64
    spacing: Float64
    slope: float
    intercept: float
    unit: str | None
    between: float | None
    header: Dataset
    frame: int | None


def read(path: Path) -> StoredImage:
    """The volume in a multi-frame file, in a folder of slices, or the series of a slice in its folder.

    Raises `FileError`, `DataError`.
    """
    with reading_dicom(path):
        if path.is_dir():
            return _stacked(path, _series(path, None))
        dataset = read_dataset(path)
        if dicom_segmentation.is_segmentation(dataset):
            return dicom_segmentation.read(path, dataset)
        return _stacked(path, _of_file(path, dataset))


def read_headers(path: Path) -> tuple[list[Slice], Float64]:
    """The slices of what `read` reads, in the order of their places, without pixels (all are 0); and their affine (4, 4).

    Raises `FileError`, `DataError`.
    """
    with reading_dicom(path):
        if path.is_dir():
            return _ordered(path, _series(path, None, pixels=False))
        return _ordered(path, _of_file(path, read_dataset(path, pixels=False), pixels=False))


def _of_file(path: Path, dataset: Dataset, pixels: bool = True) -> list[Slice]:
    """The slices of a multi-frame file, or of the series to which a file of one slice belongs."""
    _refuse_other_kinds(path, dataset)
    if frame_count(str(path), dataset) > 1 or has_tag(dataset, "PerFrameFunctionalGroupsSequence"):
        return list(_frames(path, dataset, pixels))
    return _series(path.parent, path, pixels)


def _series(folder: Path, like: Path | None, pixels: bool = True) -> list[Slice]:
    """The slices of the one series in a folder, or of the series to which the file `like` belongs."""
    slices = []
    for path in series_paths(folder, CLASSES, like):
        with reading_dicom(path):
            dataset = read_dataset(path, pixels)
            _refuse_other_kinds(path, dataset)
            slices += list(_frames(path, dataset, pixels))
    return slices


def _refuse_other_kinds(path: Path, dataset: Dataset) -> None:
    uid = str(dataset.get("SOPClassUID", ""))
    if uid in CLASSES:
        return
    kind = getattr(dataset.get("SOPClassUID"), "name", "none") or "none"
    hint = "; these are projections: palpate scan import" if "Projection" in kind or "X-Ray" in kind else ""
    raise DataError(
        f"{path}: {tag_name('SOPClassUID')} is {kind}, modality {dataset.get('Modality', 'none')}: no volume that is "
        f"read (these are: {', '.join(CLASSES.values())}){hint}"
    )


def _frames(path: Path, dataset: Dataset, pixels: bool) -> Iterator[Slice]:
    """Each frame of a file, wherever its tags lie: in its functional groups, in the shared ones, or at the top."""
    values = stored_pixels(path, dataset) if pixels else _no_pixels(path, dataset)
    dataset.pop("PixelData", None)  # the slices have what they need of it
    many = len(values) > 1
    for frame, image in enumerate(values):
        where = f"{path}, frame {frame + 1}" if many else str(path)

        def home(macro: str, keyword: str, frame: int = frame) -> Dataset:
            found = functional_group(dataset, frame, macro)
            return found if has_tag(found, keyword) else dataset

        measures = home("PixelMeasuresSequence", "PixelSpacing")
        spacing = tag_numbers(where, measures, "PixelSpacing", 2)
        if (spacing <= 0).any():
            raise FileError(
                f"{where}: {tag_name('PixelSpacing')} is {spacing.tolist()}, expected lengths; export it again"
            )
        step = next((k for k in ("SpacingBetweenSlices", "SliceThickness") if has_tag(measures, k)), None)
        yield Slice(
            where,
            image,
            tag_numbers(where, home("PlanePositionSequence", "ImagePositionPatient"), "ImagePositionPatient", 3),
            tag_numbers(
                where, home("PlaneOrientationSequence", "ImageOrientationPatient"), "ImageOrientationPatient", 6
            ).reshape(2, 3),
            spacing,
            *_meaning(where, dataset, frame),
            abs(tag_number(where, measures, step)) if step else None,
            dataset,
            frame + 1 if many or has_tag(dataset, "NumberOfFrames") else None,
        )


def _no_pixels(path: Path, dataset: Dataset) -> AnyArray:
    """(frames, rows, columns) of zeros that take no memory."""
    shape = (frame_count(str(path), dataset), *(int(tag_number(str(path), dataset, k)) for k in ("Rows", "Columns")))
    if min(shape) < 1:
        raise FileError(f"{path}: its header says {shape} frames, rows, columns; copy or export it again")
    return np.broadcast_to(np.uint8(0), shape)


def _meaning(where: str, dataset: Dataset, frame: int) -> tuple[float, float, str | None]:
    """Slope, intercept and unit: of the real-world mapping if there is one, else of the rescaling."""
    real = functional_group(dataset, frame, "RealWorldValueMappingSequence")
    real = real if real else (dataset.get("RealWorldValueMappingSequence") or [Dataset()])[0]
    if has_tag(real, "RealWorldValueSlope"):
        codes = real.get("MeasurementUnitsCodeSequence") or [Dataset()]
        code = str(codes[0].get("CodeValue", ""))
        slope, intercept = (tag_number(where, real, k) for k in ("RealWorldValueSlope", "RealWorldValueIntercept"))
        return slope, intercept, UNITS.get(code, code or None)
    scale = functional_group(dataset, frame, "PixelValueTransformationSequence")
    scale = scale if has_tag(scale, "RescaleSlope") else dataset
    if not has_tag(scale, "RescaleSlope"):
        return 1.0, 0.0, "stored values"
    slope, intercept = (tag_number(where, scale, k) for k in ("RescaleSlope", "RescaleIntercept"))
    kind = str(scale.get("RescaleType") or ("HU" if dataset.get("Modality") == "CT" else "US"))
    return slope, intercept, "stored values" if kind == "US" else kind


def _stacked(path: Path, slices: list[Slice]) -> StoredImage:
    """The volume of slices that are of one kind and equally far apart."""
    slices, affine = _ordered(path, slices)
    values = np.stack([np.float32(s.values * np.float64(s.slope) + s.intercept) for s in slices])
    return StoredImage(values, affine, slices[0].unit)


def _ordered(path: Path, slices: list[Slice]) -> tuple[list[Slice], Float64]:
    """Slices in the order of their places, once they are of one kind and equally far apart, and their affine (4, 4)."""
    if not slices:
        raise FileError(f"{path}: no slices there, only overviews (localizers); name the folder of the slices")
    first = slices[0]
    for other in slices[1:]:
        for what, a, b in (
            ("pixels", first.values.shape, other.values.shape),
            ("mm between pixels", first.spacing, other.spacing),
            ("orientation", first.axes, other.axes),
        ):
            if np.shape(a) != np.shape(b) or np.abs(np.asarray(a) - np.asarray(b)).max() > ALIKE:
                raise FileError(
                    f"{other.where}: {what} {np.asarray(b).ravel().tolist()}, but {np.asarray(a).ravel().tolist()} in "
                    f"{first.where}; a volume needs them alike: keep one series in the folder"
                )
        if first.unit != other.unit:
            raise FileError(f"{other.where}: values in {other.unit}, but in {first.unit} in {first.where}")
    normal = np.cross(*first.axes)
    slices = sorted(slices, key=lambda s: float(s.position @ normal))
    affine = np.eye(4)
    affine[:3, 0] = first.axes[0] * first.spacing[1]
    affine[:3, 1] = first.axes[1] * first.spacing[0]
    affine[:3, 2] = _step(path, slices, normal)
    affine[:3, 3] = slices[0].position
    return slices, affine


def _step(path: Path, slices: list[Slice], normal: Float64) -> Float64:
    """From a slice to the next, mm; refuses two at one place, and gaps."""
    between = slices[0].between
    if len(slices) == 1:
        if not between:
            raise FileError(
                f"{slices[0].where}: one slice without {tag_name('SpacingBetweenSlices')} or {tag_name('SliceThickness')}; "
                f"name the folder of all slices"
            )
        return normal * between
    steps = np.diff([float(s.position @ normal) for s in slices])
    usual = float(np.sort(steps)[(len(steps) - 1) // 2])
    for step, (a, b) in zip(steps, pairwise(slices), strict=True):
        if step < ALIKE:
            raise FileError(f"{b.where}: lies where {a.where} does; keep one phase or series of the volume")
        if abs(step - usual) > UNEQUAL * usual:
            raise FileError(
                f"{path}: {step:.5g} mm from {a.where} to {b.where}, {usual:.5g} mm between other slices: slices are "
                f"missing, or unequally spaced; copy all of the series, or resample it"
            )
    whole = (slices[-1].position - slices[0].position) / (len(slices) - 1)
    if between and np.linalg.norm(whole - normal * between) < ALIKE * between:
        return normal * between  # as written, not as it is left of rounded positions
    return np.asarray(whole)
