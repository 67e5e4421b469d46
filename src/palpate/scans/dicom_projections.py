"""Scans from DICOM projections: one multi-frame file, or one file for each view."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pydicom import Dataset

from palpate.arrays import AnyArray, Bool, Float32
from palpate.errors import DataError, FileError, GeometryError
from palpate.scans.dicom_geometry import WAY, ProjectionHeader, as_detected, isocentric_views, pivoted_views
from palpate.scans.intensity_correction import open_beam
from palpate.scans.scan import Scan
from palpate.scans.views import Views
from palpate.volumes.dicom_io import (
    dicom_paths,
    frame_count,
    has_tag,
    is_dicom,
    read_dataset,
    reading_dicom,
    stored_pixels,
    tag_name,
    tag_number,
)
from palpate.volumes.dicom_series import series_paths
from palpate.volumes.dicom_volumes import CLASSES as VOLUMES

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
BRIGHT = 65535.0  # of what was a logarithm
RELATIONSHIP = "PixelIntensityRelationship"
DYNAMIC = 25.0  # natural logarithm of the largest ratio of doses that an image can hold
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
    """Whether `path` is a DICOM stack of a kind that `dicom_projections` reads, by the first file that tells.

    Raises `FileError` when a file is damaged.
    """
    if not is_dicom_stack(path):
        return False
    for file in dicom_paths(path) if path.is_dir() else [path]:
        kind = str(read_dataset(file, pixels=False).get("SOPClassUID", ""))
        if kind in CLASSES or kind in VOLUMES:
            return kind in CLASSES
    return False


def dicom_projections(path: Path) -> tuple[Float32, Bool, list[ProjectionHeader]]:
    """Intensities (views, rows, columns), what was measured of them, and each view's header.

    Several files follow each other by their instance number. Raises `FileError`, `DataError`.
    """
    with reading_dicom(path):
        if path.is_dir():
            paths = series_paths(path, CLASSES)
        else:
            header = read_dataset(path, pixels=False)
            many = frame_count(str(path), header) > 1
            paths = [path] if many else series_paths(path.parent, CLASSES, path)
    images: list[Float32] = []
    masks: list[Bool] = []
    logarithms: list[bool] = []
    shots: list[tuple[int, ProjectionHeader]] = []
    for file in paths:
        with reading_dicom(file):
            dataset = read_dataset(file)
            _refuse_other_kinds(file, dataset)
            stack = stored_pixels(file, dataset)
            del dataset.PixelData  # headers are kept, numbers are not kept twice
            at = int(tag_number(str(file), dataset, "InstanceNumber")) if has_tag(dataset, "InstanceNumber") else 0
            for frame, values in enumerate(stack):
                where = f"{file}, frame {frame + 1}" if len(stack) > 1 else str(file)
                shot = ProjectionHeader(where, dataset, frame, values.shape)
                if shots and shot.shape != shots[0][1].shape:
                    raise DataError(f"{where}: {shot.shape} pixels, {shots[0][1].shape} in {shots[0][1].where}")
                intensity, mask, logarithm = _intensity(shot, values)
                images.append(intensity)
                logarithms.append(logarithm)
                masks.append(mask)
                shots.append((at, shot))
    if not shots:
        raise FileError(f"{path}: no projections there, only overviews (localizers) of a CT; name the projections")
    order = sorted(range(len(shots)), key=lambda k: shots[k][0])
    counts, mask = np.stack([images[k] for k in order]), np.stack([masks[k] for k in order])
    if any(logarithms):
        counts = _exponential(shots[logarithms.index(True)][1].where, counts, mask, all(logarithms))
    return counts, mask, [shots[k][1] for k in order]


def _exponential(where: str, logs: Float32, mask: Bool, alike: bool) -> Float32:
    """Intensities from their natural logarithms, the brightest `BRIGHT`. Raises `DataError`."""
    low, high = (float(end) for end in (logs[mask].min(initial=np.inf), logs[mask].max(initial=-np.inf)))
    if not alike or not high - low < DYNAMIC:
        raise DataError(
            f"{where}: {tag_name('PixelIntensityRelationship')} is LOG, and its values after {tag_name('RescaleSlope')} go "
            f"from {low:g} to {high:g}: no natural logarithm, and no tag tells another scale; export linear (raw) images"
        )
    warnings.warn(
        f"{where}: values are taken as natural logarithms of the dose, after {tag_name('RescaleSlope')}; attenuation is "
        f"right only if they are",
        stacklevel=2,
    )
    return np.asarray(BRIGHT * np.exp(logs - high), dtype=np.float32)


def dicom_scan(path: Path) -> Scan:
    """The scan in DICOM projections, its geometry from their tags, its open beam from the images.

    Raises `FileError` that names the tag which is missing, `DataError`, `GeometryError`.
    """
    counts, mask, views = dicom_frames(path)
    try:
        return Scan(counts, open_beam(counts, mask, photons=False), views(), 0, mask)
    except (DataError, GeometryError) as problem:
        raise type(problem)(f"{path}: {problem}") from None


def dicom_frames(path: Path, linear: bool = False) -> tuple[AnyArray, AnyArray, Callable[[], Views]]:
    """Intensities as the panel lies, what was measured of them, and a function that gives the geometry of the tags.

    linear: refuse logarithms. Raises `FileError`, `DataError`, `GeometryError`.
    """
    counts, mask, shots = dicom_projections(path)
    kinds = [str(shot.home("FramePixelDataPropertiesSequence", RELATIONSHIP).get(RELATIONSHIP)) for shot in shots]
    if linear and "LOG" in kinds:
        raise DataError(
            f"{path}: {tag_name(RELATIONSHIP)} is LOG, from which no dark can be subtracted; export what the panel read "
            f"(LIN), or import logarithms that are flat-fielded already: palpate scan import"
        )
    multi = str(shots[0].dataset.SOPClassUID) == BREAST
    if multi:  # the other kind tells how its image lies by the patient
        with reading_dicom(path):
            counts, mask = (np.stack([*map(as_detected, shots, images)]) for images in (counts, mask))

    def views() -> Views:
        with reading_dicom(path):
            return isocentric_views(shots) if multi else pivoted_views(shots)

    return counts, mask, views


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
        f"{path}: {tag_name('SOPClassUID')} is {kind}, modality {dataset.get('Modality', 'none')}: no projections that are "
        f"read (these are: {'; '.join(CLASSES.values())})"
    )


def _intensity(shot: ProjectionHeader, values: AnyArray) -> tuple[Float32, Bool, bool]:
    """Numbers proportional to the dose, or its logarithm; which are no padding; whether it is the logarithm.

    Raises `FileError`, `DataError`.
    """
    home = shot.home("FramePixelDataPropertiesSequence", "PixelIntensityRelationship")
    for keyword in ("PixelIntensityRelationship", "PixelIntensityRelationshipSign"):
        if not has_tag(home, keyword) and home.get(keyword) is None:
            raise FileError(f"{shot.where}: lacks {tag_name(keyword)}, so what a number means is unknown; {WAY}")
    kind = str(home.PixelIntensityRelationship)
    if kind not in ("LIN", "LOG"):
        raise DataError(
            f"{shot.where}: {tag_name('PixelIntensityRelationship')} is {kind}, whose scale no tag tells; expected LIN or "
            f"LOG: export linear (raw) images"
        )
    real = shot.home("PixelValueTransformationSequence", "RescaleSlope")
    scale, shift = (
        tag_number(shot.where, real, k) if has_tag(real, k) else default
        for k, default in (("RescaleSlope", 1.0), ("RescaleIntercept", 0.0))
    )
    sign = int(tag_number(shot.where, home, "PixelIntensityRelationshipSign")) * int(np.sign(scale))
    if kind == "LIN" and sign != 1:
        raise DataError(
            f"{shot.where}: {tag_name('PixelIntensityRelationshipSign')} and {tag_name('RescaleSlope')} say that more "
            f"radiation gives lower numbers, and no tag tells where they end; export raw images"
        )
    mask = np.ones(values.shape, dtype=bool)
    if has_tag(shot.dataset, "PixelPaddingValue") or shot.dataset.get("PixelPaddingValue") is not None:
        low = tag_number(shot.where, shot.dataset, "PixelPaddingValue")
        limit = shot.dataset.get("PixelPaddingRangeLimit")
        high = low if limit is None else tag_number(shot.where, shot.dataset, "PixelPaddingRangeLimit")
        mask = (values < min(low, high)) | (values > max(low, high))
    return (values * scale + shift).astype(np.float32) * (sign if kind == "LOG" else 1), mask, kind == "LOG"
