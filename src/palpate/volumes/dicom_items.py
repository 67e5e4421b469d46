"""What every DICOM file that palpate writes has: patient, study, series, equipment; and how data sets are put together."""

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

import numpy as np
from pydicom import Dataset
from pydicom.dataset import FileDataset, FileMetaDataset
from pydicom.uid import PYDICOM_IMPLEMENTATION_UID, ExplicitVRLittleEndian, generate_uid
from pydicom.valuerep import format_number_as_ds

from palpate.arrays import ArrayLike, Float64
from palpate.version import __version__

MANUFACTURER = "palpate"


def common_items(sop_class: str, modality: str) -> Dataset:
    """Patient and study, both unknown; a series of one instance with UIDs of its own; the equipment, which is palpate."""
    now = datetime.now()
    return fill(
        Dataset(),
        {
            "SOPClassUID": sop_class,
            "SOPInstanceUID": generate_uid(prefix=None),
            "StudyInstanceUID": generate_uid(prefix=None),
            "SeriesInstanceUID": generate_uid(prefix=None),
            "FrameOfReferenceUID": generate_uid(prefix=None),
            "SpecificCharacterSet": "ISO_IR 192",
            "InstanceCreationDate": now.strftime("%Y%m%d"),
            "InstanceCreationTime": now.strftime("%H%M%S"),
            "Modality": modality,
            "Manufacturer": MANUFACTURER,
            "ManufacturerModelName": MANUFACTURER,
            "SoftwareVersions": __version__,
            "SeriesNumber": "1",
            "InstanceNumber": "1",
            "LossyImageCompression": "00",
            **dict.fromkeys(
                ("PatientName", "PatientID", "PatientBirthDate", "PatientSex", "StudyID", "AccessionNumber"), ""
            ),
            **dict.fromkeys(("StudyDate", "StudyTime", "ReferringPhysicianName"), ""),
        },
    )


def multi_frame_items() -> dict[str, object]:
    """What an image of several frames says beside its pixels: its date, and equipment without a serial number."""
    now = datetime.now()
    return {
        "DeviceSerialNumber": "none",
        "PositionReferenceIndicator": "",
        "ContentDate": now.strftime("%Y%m%d"),
        "ContentTime": now.strftime("%H%M%S"),
    }


def dimension_items(dimensions: list[tuple[int, int, str]]) -> dict[str, object]:
    """The dimensions that order the frames: tag, tag of the functional group that holds it, name; the slowest first."""
    organisation = generate_uid(prefix=None)
    return {
        "DimensionOrganizationSequence": [item(DimensionOrganizationUID=organisation)],
        "DimensionIndexSequence": [
            item(
                DimensionOrganizationUID=organisation,
                DimensionIndexPointer=tag,
                FunctionalGroupPointer=group,
                DimensionDescriptionLabel=name,
            )
            for tag, group, name in dimensions
        ],
    }


def geometry_items(spacing: tuple[float, float, float], axes: Float64) -> dict[str, object]:
    """The functional groups of a stack's geometry, which all frames share.

    spacing: mm between slices, rows and columns. axes: (2, 3), direction of a row, then of a column, LPS.
    """
    dz, dy, dx = spacing
    return {
        "PixelMeasuresSequence": [
            item(PixelSpacing=decimals([dy, dx]), SliceThickness=decimal(dz), SpacingBetweenSlices=decimal(dz))
        ],
        "PlaneOrientationSequence": [item(ImageOrientationPatient=decimals(axes))],
    }


def decimals(values: ArrayLike) -> list[str]:
    """The best decimal texts of at most 16 characters, of all values in order."""
    return [decimal(value) for value in np.ravel(np.asarray(values, dtype=np.float64))]


def decimal(value: float) -> str:
    """The best decimal text of at most 16 characters."""
    return str(format_number_as_ds(float(value) + 0.0))


def code(value: str, scheme: str, meaning: str) -> Dataset:
    """The item of a code sequence."""
    return item(CodeValue=value, CodingSchemeDesignator=scheme, CodeMeaning=meaning)


def item(**values: object) -> Dataset:
    """A data set of these keywords and values."""
    return fill(Dataset(), values)


def fill(dataset: Dataset, values: Mapping[str, object]) -> Dataset:
    """`dataset`, with these keywords and values set."""
    for keyword, value in values.items():
        setattr(dataset, keyword, value)
    return dataset


def save(path: Path, dataset: Dataset) -> None:
    """Writes a data set as a DICOM file (PS3.10), uncompressed."""
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = dataset.SOPClassUID, dataset.SOPInstanceUID
    meta.TransferSyntaxUID, meta.ImplementationClassUID = ExplicitVRLittleEndian, PYDICOM_IMPLEMENTATION_UID
    FileDataset(str(path), dataset, file_meta=meta, preamble=b"\0" * 128).save_as(path, enforce_file_format=True)
