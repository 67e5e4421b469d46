"""Writing DICOM volumes: a Breast Tomosynthesis Image (one file), or a CT series (one file for each slice)."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from pydicom import Dataset
from pydicom.datadict import tag_for_keyword
from pydicom.uid import generate_uid
from pydicom.valuerep import format_number_as_ds

from palpate.arrays import AnyArray, Float32, Float64
from palpate.atomic_write import replacing, replacing_folder
from palpate.errors import DataError
from palpate.volumes.dicom_items import (
    code,
    common_items,
    decimal,
    decimals,
    dimension_items,
    fill,
    geometry_items,
    item,
    multi_frame_items,
    save,
)
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

CT, TOMOSYNTHESIS = "1.2.840.10008.5.1.4.1.1.2", "1.2.840.10008.5.1.4.1.1.13.1.3"
LEVELS = 65_000  # of 65,536: rounding at either end has room
VIEWS = {  # view position: code and meaning, SNOMED CT (PS3.16 CID 4014)
    "CC": ("399162004", "cranio-caudal"),
    "MLO": ("399368009", "medio-lateral oblique"),
    "ML": ("399260004", "medial-lateral"),
    "LM": ("399352003", "latero-medial"),
}
UCUM = {"HU": ("[hnsf'U]", "Hounsfield unit"), "1/mm": ("/mm", "per millimeter")}
HOW = "Volume reconstructed from X-ray projections, or resampled, by palpate"


def quantized(values: Float32) -> tuple[AnyArray, float, float]:
    """uint16 numbers q, slope a and intercept b: values = a · q + b, to half of a.

    Whole numbers that span less than 65,536 keep a = 1 and are exact. Otherwise a is 1, 2 or 5 times a power of ten, as
    small as the range allows, so that a decimal text holds it exactly.
    """
    low, high = float(values.min()), float(values.max())
    if high - low < 65536 and abs(low) < 1e9 and (values == np.rint(values)).all():
        slope, intercept = 1.0, low
    elif high == low:
        slope, intercept = 1.0, float(format_number_as_ds(low))
    else:
        least = (high - low) / LEVELS
        power = int(np.floor(np.log10(least)))
        slope = next(s for s in (float(f"{m}e{p}") for p in (power, power + 1) for m in (1, 2, 5)) if s >= least)
        intercept = float(format_number_as_ds(np.floor(low / slope) * slope))
    q = np.rint((values.astype(np.float64) - intercept) / slope)
    return np.clip(q, 0, 65535).astype(np.uint16), slope, intercept


def write(path: Path, volume: Volume, tags: Mapping[str, str]) -> None:
    """A file (a name with a suffix) or a folder, whole or not at all. Raises `FileError`, `DataError`."""
    if path.suffix and not path.is_dir():
        with replacing(path) as temporary:
            write_tomosynthesis(temporary, volume, tags)
    else:
        with replacing_folder(path) as temporary:
            write_ct(temporary, volume, tags)


def write_tomosynthesis(path: Path, volume: Volume, tags: Mapping[str, str]) -> None:
    """One Breast Tomosynthesis Image; its real-world mapping says what the numbers mean. Raises `DataError`."""
    q, slope, intercept = quantized(volume.values)
    dataset = _common(TOMOSYNTHESIS, "MG", volume, tags)
    fill(dataset, _three_dimensional(len(q)))
    dataset.ViewCodeSequence = [_view(tags.get("ViewPosition", "CC"))]
    fill(dataset, dimension_items([(0x00209057, 0x00209111, "In-Stack Position Number")]))
    dataset.SharedFunctionalGroupsSequence = [_shared(volume, q, slope, intercept, tags)]
    dataset.PerFrameFunctionalGroupsSequence = [_frame(volume.grid, k) for k in range(len(q))]
    _image(dataset, q)
    save(path, dataset)


def write_ct(folder: Path, volume: Volume, tags: Mapping[str, str]) -> None:
    """A CT series, one file a slice of constant z, in `folder`, which is there."""
    q, slope, intercept = quantized(volume.values)
    same = _common(CT, "CT", volume, tags)
    dz, dy, dx = volume.grid.spacing
    fill(
        same,
        {
            "DerivationDescription": HOW,
            "AcquisitionNumber": "1",
            "KVP": None,
            "Laterality": "",
            "PatientPosition": "",
            "PositionReferenceIndicator": None,
            "SpacingBetweenSlices": decimal(dz),
            "SliceThickness": decimal(dz),
            "PixelSpacing": decimals([dy, dx]),
            "ImageOrientationPatient": decimals(_axes(volume.grid)),
            "RescaleSlope": decimal(slope),
            "RescaleIntercept": decimal(intercept),
            "RescaleType": volume.unit,
            "WindowCenter": decimal((float(volume.values.min()) + float(volume.values.max())) / 2),
            "WindowWidth": decimal(max(float(np.ptp(volume.values)), slope)),
            "VOILUTFunction": "LINEAR_EXACT",  # the plain one needs a width of at least 1
        },
    )
    digits = max(4, len(str(len(q))))
    for k, plane in enumerate(q):
        dataset = Dataset()
        dataset.update(same)
        dataset.SOPInstanceUID = generate_uid(prefix=None)
        dataset.InstanceNumber = k + 1
        dataset.ImagePositionPatient = decimals(volume.grid.points([k, 0, 0]))
        _image(dataset, plane)
        save(folder / f"{k + 1:0{digits}d}.dcm", dataset)


def _common(sop_class: str, modality: str, volume: Volume, tags: Mapping[str, str]) -> Dataset:
    """Patient, study, series and equipment; only `tags` says anything of the patient."""
    dataset = common_items(sop_class, modality)
    dataset.ImageType, dataset.BurnedInAnnotation = ["DERIVED", "PRIMARY", "AXIAL"], "NO"
    if volume.notes:
        dataset.ImageComments = "; ".join(f"{key}: {value}" for key, value in volume.notes.items())[:10_000]
    for keyword, value in tags.items():
        if keyword in ("FrameLaterality", "ViewPosition"):
            continue  # they have places of their own
        try:
            if tag_for_keyword(keyword) is None:
                raise ValueError("no such keyword")
            setattr(dataset, keyword, value)
        except (ValueError, TypeError) as problem:
            raise DataError(f"tags: {keyword!r} = {value!r} is no DICOM keyword and value ({problem})") from None
    return dataset


def _three_dimensional(frames: int) -> dict[str, object]:
    """What a breast tomosynthesis image says of itself beside the pixels."""
    return {
        "ImageType": ["DERIVED", "PRIMARY", "TOMOSYNTHESIS", "NONE"],
        **multi_frame_items(),
        "ContentQualification": "RESEARCH",
        "NumberOfFrames": frames,
        "PixelPresentation": "MONOCHROME",
        "VolumetricProperties": "VOLUME",
        "VolumeBasedCalculationTechnique": "NONE",
        "PresentationLUTShape": "IDENTITY",
        "BreastImplantPresent": "NO",
        "AcquisitionContextSequence": [],
    }


def _shared(volume: Volume, q: AnyArray, slope: float, intercept: float, tags: Mapping[str, str]) -> Dataset:
    """The functional groups that all frames share."""
    symbol, meaning = UCUM.get(volume.unit, ("1", "no units"))
    real = item(
        RealWorldValueFirstValueMapped=0,
        RealWorldValueLastValueMapped=65535,
        RealWorldValueSlope=slope,
        RealWorldValueIntercept=intercept,
        LUTLabel=volume.unit[:16],
        LUTExplanation="stored values to " + volume.unit,
        MeasurementUnitsCodeSequence=[code(symbol, "UCUM", meaning)],
    )
    low, high = int(q.min()), int(q.max())
    return item(
        **geometry_items(volume.grid.spacing, _axes(volume.grid)),
        FrameAnatomySequence=[
            item(
                FrameLaterality=tags.get("FrameLaterality", "B"),
                AnatomicRegionSequence=[code("76752008", "SCT", "Breast")],
            )
        ],
        PixelValueTransformationSequence=[item(RescaleIntercept="0", RescaleSlope="1", RescaleType="US")],
        DerivationImageSequence=[
            item(
                DerivationDescription=HOW,
                DerivationCodeSequence=[code("113085", "DCM", "Spatial resampling")],
                SourceImageSequence=[],
            )
        ],
        FrameVOILUTSequence=[item(WindowCenter=decimal((low + high + 1) / 2), WindowWidth=decimal(max(high - low, 1)))],
        RealWorldValueMappingSequence=[real],
    )


def _frame(grid: Grid, k: int) -> Dataset:
    """What is one frame's own: its place."""
    content = item(StackID="1", InStackPositionNumber=k + 1, DimensionIndexValues=[k + 1], FrameAcquisitionNumber=1)
    return item(
        FrameContentSequence=[content],
        PlanePositionSequence=[item(ImagePositionPatient=decimals(grid.points([k, 0, 0])))],
        XRay3DFrameTypeSequence=[
            item(
                FrameType=["DERIVED", "PRIMARY", "TOMOSYNTHESIS", "NONE"],
                PixelPresentation="MONOCHROME",
                VolumetricProperties="VOLUME",
                VolumeBasedCalculationTechnique="NONE",
            )
        ],
    )


def _axes(grid: Grid) -> Float64:
    """(2, 3): the direction of a row, along which x grows, then that of a column."""
    return grid.direction[:, :2].T


def _view(name: str) -> Dataset:
    if name not in VIEWS:
        raise DataError(f"tags: ViewPosition is one of {', '.join(VIEWS)}, got {name!r}")
    view = code(VIEWS[name][0], "SCT", VIEWS[name][1])
    view.ViewModifierCodeSequence = []
    return view


def _image(dataset: Dataset, q: AnyArray) -> None:
    rows, columns = q.shape[-2:]
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
    dataset.Rows, dataset.Columns = rows, columns
    dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit, dataset.PixelRepresentation = 16, 16, 15, 0
    body = q.astype("<u2").tobytes()
    dataset.PixelData = body
    dataset["PixelData"].VR = "OW"
