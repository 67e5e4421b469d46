"""DICOM files as other makers write them, put together tag by tag."""

import os
import shutil
import subprocess

import numpy as np
import pydicom
import pytest
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian, generate_uid

CT = "1.2.840.10008.5.1.4.1.1.2"
ENHANCED_CT = "1.2.840.10008.5.1.4.1.1.2.1"
BREAST_PROJECTION = "1.2.840.10008.5.1.4.1.1.13.1.5"
MAMMOGRAM = "1.2.840.10008.5.1.4.1.1.1.2.1"
RADIOGRAPH = "1.2.840.10008.5.1.4.1.1.1.1.1"
MR = "1.2.840.10008.5.1.4.1.1.4"


def item(**tags):
    dataset = Dataset()
    for keyword, value in tags.items():
        if value is not None:
            setattr(dataset, keyword, value)
    return dataset


def save(path, sop_class, pixels, syntax=ExplicitVRLittleEndian, **tags):
    """uint16 or int16 pixels, (rows, columns) or (frames, rows, columns); a tag that is None is left out."""
    pixels = np.asarray(pixels)
    dataset = FileDataset(str(path), {}, file_meta=FileMetaDataset(), preamble=b"\0" * 128)
    dataset.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    dataset.SOPClassUID, dataset.SOPInstanceUID = sop_class, generate_uid(entropy_srcs=[str(path)])
    dataset.SamplesPerPixel, dataset.PhotometricInterpretation = 1, "MONOCHROME2"
    dataset.Rows, dataset.Columns = pixels.shape[-2:]
    dataset.BitsAllocated, dataset.BitsStored, dataset.HighBit = 16, 16, 15
    dataset.PixelRepresentation = int(pixels.dtype.kind == "i")
    dataset.PixelData = pixels.tobytes()
    if pixels.ndim == 3:
        dataset.NumberOfFrames = len(pixels)
    for keyword, value in tags.items():
        if value is not None:
            setattr(dataset, keyword, value)
    if syntax != ExplicitVRLittleEndian:
        dataset.compress(syntax, generate_instance_uid=False)
    dataset.save_as(path, enforce_file_format=True)
    return path


def ct_slice(path, pixels, position=(0, 0, 0), axes=(1, 0, 0, 0, 1, 0), series="1.2.3", **tags):
    given = {
        "Modality": "CT",
        "SeriesInstanceUID": series,
        "ImagePositionPatient": list(position),
        "ImageOrientationPatient": list(axes),
        "PixelSpacing": [0.7, 0.4],
        "SliceThickness": 5,
        "RescaleSlope": 1,
        "RescaleIntercept": -1024,
    }
    return save(path, CT, pixels, **{**given, **tags})


def view(path, pixels, sop_class=MAMMOGRAM, **tags):
    """One view with a file of its own."""
    given = {
        "Modality": "MG" if sop_class == MAMMOGRAM else "DX",
        "SeriesInstanceUID": "1.2.4",
        "PixelIntensityRelationship": "LIN",
        "PixelIntensityRelationshipSign": 1,
        "ImagerPixelSpacing": [0.5, 0.4],
        "DistanceSourceToDetector": 700,
        "DistanceSourceToIsocenter": 660,
        "PatientOrientation": ["A", "R"],
        "ViewPosition": "CC",
        "PositionerPrimaryAngle": 0,
        "InstanceNumber": 1,
    }
    return save(path, sop_class, pixels, **{**given, **tags})


def breast_projection(path, pixels, source_angles, iso=None, geometry=None, pitch=(0.5, 0.4), **tags):
    """Frames at X-ray source angles (degrees, toward gantry right); the detector lies 40 mm below the isocentre."""
    rows = np.shape(pixels)[1]
    frames = [
        item(
            IsocenterReferenceSystemSequence=[
                item(
                    **{
                        "XRaySourceIsocenterPrimaryAngle": float(angle),
                        "XRaySourceIsocenterSecondaryAngle": 0.0,
                        "DetectorIsocenterPrimaryAngle": 0.0,
                        "DetectorIsocenterSecondaryAngle": 0.0,
                        "DetectorXPositionToIsocenter": 0.0,
                        "DetectorYPositionToIsocenter": 0.0,
                        "DetectorZPositionToIsocenter": -40.0,
                        # rows run along gantry rear (anterior), columns along gantry right (patient's right)
                        "DetectorActiveAreaTLHCPosition": [-(rows - 1) / 2 * 0.5, 0.2, 0.0],
                        "DetectorActiveAreaOrientation": [0.0, 1.0, 0.0, 1.0, 0.0, 0.0],
                        **(iso or {}),
                    }
                )
            ],
            XRayGeometrySequence=[
                item(**{"DistanceSourceToDetector": 700, "DistanceSourceToIsocenter": 660, **(geometry or {})})
            ],
        )
        for angle in source_angles
    ]
    shared = item(
        FramePixelDataPropertiesSequence=[
            item(ImagerPixelSpacing=list(pitch), PixelIntensityRelationship="LIN", PixelIntensityRelationshipSign=1)
        ]
    )
    given = {
        "Modality": "MG",
        "SeriesInstanceUID": "1.2.5",
        "SharedFunctionalGroupsSequence": [shared],
        "PerFrameFunctionalGroupsSequence": frames,
    }
    return save(path, BREAST_PROJECTION, pixels, **{**given, **tags})


def changed(path, **tags):
    """The file with some tags changed, or left out where the value is None."""
    dataset = pydicom.dcmread(path)
    for keyword, value in tags.items():
        if value is None:
            delattr(dataset, keyword)
        else:
            setattr(dataset, keyword, value)
    dataset.save_as(path)
    return path


def complaints(path):
    """The errors that dciodvfy finds in a file; skips where it is not installed, unless the gate asks for it."""
    if shutil.which("dciodvfy") is None:
        missing = "no dciodvfy on the PATH: apt-get install dicom3tools"
        (pytest.fail if os.environ.get("PALPATE_REQUIRE_DCIODVFY") == "1" else pytest.skip)(missing)
    told = subprocess.run(["dciodvfy", str(path)], capture_output=True, text=True, check=False)
    lines = (told.stdout + told.stderr).splitlines()
    # It says which object it took the file for.
    assert any("Image" in line or line == "Segmentation" for line in lines), lines
    return [line for line in lines if line.startswith(("Error", "Abort")) or "rror -" in line]
