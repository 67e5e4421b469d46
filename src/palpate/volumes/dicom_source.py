"""The DICOM images from which another object is derived: their grid, and what the object takes over of them."""

import warnings
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydicom import Dataset

from palpate.arrays import Float64
from palpate.bounded_read import existing_path
from palpate.errors import DataError, FileError
from palpate.volumes.dicom_io import has_tag, reading_dicom, tag_name
from palpate.volumes.dicom_items import code, item
from palpate.volumes.dicom_volumes import Slice, read_headers
from palpate.volumes.file_axes import StoredImage, right_handed
from palpate.volumes.grid import Grid

WHAT_TO_GIVE = (
    "a DICOM segmentation refers to the images on which it was drawn: give the folder of their series with like=FOLDER, "
    "or name the labels .nii.gz, .nrrd or .mha"
)
IDENTIFIERS = ("SOPClassUID", "SOPInstanceUID", "SeriesInstanceUID", "StudyInstanceUID", "FrameOfReferenceUID")
SHARED = ("SeriesInstanceUID", "StudyInstanceUID", "FrameOfReferenceUID")
COPIED = (  # Patient, Patient Study, General Study and Frame of Reference (PS3.3 C.7.1.1, C.7.2.2, C.7.2.1, C.7.4.1)
    *("PatientName", "PatientID", "IssuerOfPatientID", "PatientBirthDate", "PatientSex"),
    *("PatientAge", "PatientSize", "PatientWeight", "PatientIdentityRemoved", "DeidentificationMethod"),
    *("StudyInstanceUID", "StudyDate", "StudyTime", "StudyID", "StudyDescription"),
    *("ReferringPhysicianName", "AccessionNumber", "FrameOfReferenceUID", "PositionReferenceIndicator"),
)
ANONYMISED = "DeidentificationMethodCodeSequence"


@dataclass(frozen=True, eq=False)
class SourceImages:
    """slices: in the order of their places, without pixels. affine: (4, 4), indices (i, j, k, 1) to LPS mm. grid: theirs."""

    slices: list[Slice]
    affine: Float64
    grid: Grid


def source_images(path: str | Path | None) -> SourceImages:
    """The slices of the series in a folder, of that to which a file belongs, or of a multi-frame file.

    Raises `DataError`, `FileError` that say what is needed.
    """
    if path is None:
        raise DataError(WHAT_TO_GIVE)
    try:
        with warnings.catch_warnings(record=True):  # reading the volume has told them
            slices, affine = read_headers(existing_path(path))
        shape = (len(slices), *slices[0].values.shape)
        _, grid = right_handed(Path(path), StoredImage(np.broadcast_to(np.uint8(0), shape), affine))
    except (FileError, DataError) as problem:
        raise type(problem)(f"like: {problem}; {WHAT_TO_GIVE}") from None
    first = slices[0].header
    for each in slices:
        for keyword in IDENTIFIERS:
            if not has_tag(each.header, keyword):
                raise FileError(f"like: {each.where}: lacks {tag_name(keyword)}, by which a segmentation refers to it")
            if keyword in SHARED and each.header[keyword].value != first[keyword].value:
                raise FileError(
                    f"like: {each.where}: {tag_name(keyword)} is another one than in {slices[0].where}; keep one series "
                    f"in the folder"
                )
    return SourceImages(slices, affine, grid)


def copy_patient_and_study(source: SourceImages, dataset: Dataset) -> None:
    """Gives `dataset` the patient, study and frame of reference of the images, and says how they were anonymised."""
    header = source.slices[0].header
    with reading_dicom(Path(source.slices[0].where)):
        for keyword in COPIED:
            if keyword in header:
                dataset[keyword] = deepcopy(header[keyword])  # as it stands: a set value would be judged once more
        if codes := header.get(ANONYMISED):
            words = ("CodeValue", "CodingSchemeDesignator", "CodeMeaning")
            setattr(dataset, ANONYMISED, [code(*(str(each.get(word, "")) for word in words)) for each in codes])


def referenced_series(source: SourceImages) -> Dataset:
    """The item of a Referenced Series Sequence with all images of the series, each file once."""
    files = {str(each.header.SOPInstanceUID): each.header for each in source.slices}
    return item(
        SeriesInstanceUID=source.slices[0].header.SeriesInstanceUID,
        ReferencedInstanceSequence=[
            item(ReferencedSOPClassUID=header.SOPClassUID, ReferencedSOPInstanceUID=header.SOPInstanceUID)
            for header in files.values()
        ],
    )


def derivation(source: SourceImages, k: int, derived: Dataset, purpose: Dataset) -> Dataset:
    """The item of a Derivation Image Sequence: from slice k. derived, purpose: codes, how and for what it was used."""
    slice_ = source.slices[k]
    image = item(
        ReferencedSOPClassUID=slice_.header.SOPClassUID,
        ReferencedSOPInstanceUID=slice_.header.SOPInstanceUID,
        SpatialLocationsPreserved="YES",
        PurposeOfReferenceCodeSequence=[purpose],
    )
    if slice_.frame is not None:
        image.ReferencedFrameNumber = slice_.frame
    return item(DerivationCodeSequence=[derived], SourceImageSequence=[image])
