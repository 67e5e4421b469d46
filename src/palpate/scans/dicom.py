"""Scans from DICOM projections: one multi-frame file, or a file a view."""

from pathlib import Path

import numpy as np
from pydicom import Dataset

from palpate.arrays import AnyArray, Bool, Float32
from palpate.errors import DataError, FileError, GeometryError
from palpate.scans.correct import open_beam
from palpate.scans.dicom_geometry import WAY, Shot, isocentric_views, pivoted_views
from palpate.scans.scan import Scan
from palpate.volumes.dicom_files import (
    careful,
    dicom_paths,
    frames_of,
    has,
    is_dicom,
    named,
    number,
    opened,
    pixels,
    series_in,
)

BREAST = "1.2.840.10008.5.1.4.1.1.13.1.5"
CLASSES = {
    BREAST: "Breast Projection X-Ray Image, For Processing",
    "1.2.840.10008.5.1.4.1.1.1.2.1": "Digital Mammography X-Ray Image, For Processing",
    "1.2.840.10008.5.1.4.1.1.1.1.1": "Digital X-Ray Image, For Processing",
}
SHOWN = {  # the same, prepared for the eye
    "1.2.840.10008.5.1.4.1.1.13.1.4",
    "1.2.840.10008.5.1.4.1.1.1.2",
    "1.2.840.10008.5.1.4.1.1.1.1",
}
MEANING = (
    "DICOM tells no photon counts: the values are taken as proportional to the dose, dark signal subtracted, and the open "
    "beam as the brightest level that many pixels of a view share"
)


def is_dicom_stack(path: Path) -> bool:
    """Whether `path` is a DICOM file, or a folder in which one lies."""
    if path.is_dir():
        return any(p.is_file() and is_dicom(p) for p in path.iterdir())
    return path.is_file() and is_dicom(path)


def holds_projections(path: Path) -> bool:
    """Whether `path` is a DICOM stack whose first file is of a kind that `dicom_projections` reads.

    Raises `FileError` when that file is damaged.
    """
    if not is_dicom_stack(path):
        return False
    first = dicom_paths(path)[0] if path.is_dir() else path
    return str(opened(first, pixels=False).get("SOPClassUID", "")) in CLASSES


def dicom_projections(path: Path) -> tuple[Float32, Bool, list[Shot]]:
    """Intensities (views, rows, columns), what was measured of them, and each view's header.

    Several files follow each other by their instance number. Raises `FileError`, `DataError`.
    """
    with careful(path):
        if path.is_dir():
            paths = series_in(path, None)
        else:
            header = opened(path, pixels=False)
            many = frames_of(str(path), header) > 1
            paths = [path] if many else series_in(path.parent, str(header.get("SeriesInstanceUID", "")))
    images: list[Float32] = []
    masks: list[Bool] = []
    shots: list[tuple[int, Shot]] = []
    for file in paths:
        with careful(file):
            dataset = opened(file)
            _refuse_other_kinds(file, dataset)
            stack = pixels(file, dataset)
            del dataset.PixelData  # headers are kept, numbers are not kept twice
            at = int(number(str(file), dataset, "InstanceNumber")) if has(dataset, "InstanceNumber") else 0
            for frame, values in enumerate(stack):
                where = f"{file}, frame {frame + 1}" if len(stack) > 1 else str(file)
                shot = Shot(where, dataset, frame, values.shape)
                if shots and shot.shape != shots[0][1].shape:
                    raise DataError(f"{where}: {shot.shape} pixels, {shots[0][1].shape} in {shots[0][1].where}")
                intensity, mask = _intensity(shot, values)
                images.append(intensity)
                masks.append(mask)
                shots.append((at, shot))
    if not shots:
        raise FileError(f"{path}: no projections there, only overviews (localizers) of a CT; name the projections")
    order = sorted(range(len(shots)), key=lambda k: shots[k][0])
    return np.stack([images[k] for k in order]), np.stack([masks[k] for k in order]), [shots[k][1] for k in order]


def dicom_scan(path: Path) -> Scan:
    """The scan in DICOM projections, its geometry from their tags, its open beam from the images.

    Raises `FileError` that names the tag which is missing, `DataError`, `GeometryError`.
    """
    counts, mask, shots = dicom_projections(path)
    try:
        with careful(path):
            multi = str(shots[0].dataset.SOPClassUID) == BREAST
            views = isocentric_views(shots) if multi else pivoted_views(shots)
        return Scan(counts, open_beam(counts, mask, photons=False), views, 0, mask)
    except (DataError, GeometryError) as problem:
        raise type(problem)(f"{path}: {problem}") from None


def _refuse_other_kinds(path: Path, dataset: Dataset) -> None:
    uid = str(dataset.get("SOPClassUID", ""))
    if uid in CLASSES:
        return
    kind = getattr(dataset.get("SOPClassUID"), "name", "none") or "none"
    if uid in SHOWN:
        raise DataError(
            f"{path}: {kind}: grey values for the eye, not what the detector read; export the For Processing images"
        )
    raise DataError(
        f"{path}: {named('SOPClassUID')} is {kind}, modality {dataset.get('Modality', 'none')}: no projections that are "
        f"read (these are: {'; '.join(CLASSES.values())})"
    )


def _intensity(shot: Shot, values: AnyArray) -> tuple[Float32, Bool]:
    """Numbers proportional to the dose, and which of them are no padding. Raises `FileError`, `DataError`."""
    home = shot.home("FramePixelDataPropertiesSequence", "PixelIntensityRelationship")
    for keyword in ("PixelIntensityRelationship", "PixelIntensityRelationshipSign"):
        if not has(home, keyword) and home.get(keyword) is None:
            raise FileError(f"{shot.where}: lacks {named(keyword)}, so what a number means is unknown; {WAY}")
    kind = str(home.PixelIntensityRelationship)
    if kind != "LIN":
        raise DataError(
            f"{shot.where}: {named('PixelIntensityRelationship')} is {kind}, whose scale no tag tells; expected LIN: "
            f"export linear (raw) images"
        )
    if int(number(shot.where, home, "PixelIntensityRelationshipSign")) != 1:
        raise DataError(
            f"{shot.where}: {named('PixelIntensityRelationshipSign')} says that more radiation gives lower numbers, and "
            f"no tag tells where they end; export raw images"
        )
    mask = np.ones(values.shape, dtype=bool)
    if has(shot.dataset, "PixelPaddingValue") or shot.dataset.get("PixelPaddingValue") is not None:
        low = number(shot.where, shot.dataset, "PixelPaddingValue")
        limit = shot.dataset.get("PixelPaddingRangeLimit")
        high = low if limit is None else number(shot.where, shot.dataset, "PixelPaddingRangeLimit")
        mask = (values < min(low, high)) | (values > max(low, high))
    scale, shift = (
        number(shot.where, shot.dataset, k) if has(shot.dataset, k) else default
        for k, default in (("RescaleSlope", 1.0), ("RescaleIntercept", 0.0))
    )
    return (values * scale + shift).astype(np.float32), mask
