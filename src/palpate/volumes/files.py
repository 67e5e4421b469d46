"""Volumes and labels as files that others open: NIfTI, NRRD, MetaImage, DICOM, OME-Zarr, TIFF."""

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import numpy as np

from palpate.atomic import new_folder, replacing, replacing_folder, writable
from palpate.errors import DataError, FileError, GeometryError
from palpate.volumes import dicom, dicom_write, metaimage, nifti, nrrd, ome_zarr, tiff
from palpate.volumes.dicom_files import is_dicom
from palpate.volumes.stored import Stored, affine_of, upright
from palpate.volumes.volume import Labels, Volume

FORMATS: dict[str, ModuleType] = {
    ".nii": nifti,
    ".nii.gz": nifti,
    ".nrrd": nrrd,
    ".nhdr": nrrd,
    ".mha": metaimage,
    ".mhd": metaimage,
    ".zarr": ome_zarr,
    ".tif": tiff,
    ".tiff": tiff,
}
DICOM = (".dcm", ".dicom", ".ima")
HEADER_ONLY = (".nhdr", ".mhd")  # the voxels lie in a second file: read, never written


def read_volume(path: str | Path, unit: str | None = None) -> Volume:
    """The volume in a file or folder.

    NIfTI (.nii, .nii.gz), NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), TIFF with a voxel size (.tif), OME-Zarr (.zarr),
    or DICOM: a multi-frame file, a folder with one CT series, or one slice of the series that is meant. The grid's
    direction and origin are in patient space (LPS, mm), whatever the file's convention. unit: of the values; None takes
    the file's own word, or "HU" if values below -100 rule out attenuation, or "1/mm". Raises `FileError`, and with the
    file's name `DataError` (NaN, not numbers) and `GeometryError` (lengths).
    """
    path, stored = _read(path)
    try:
        values, grid = upright(path, stored)
        volume = Volume(values, grid)
    except (DataError, GeometryError) as problem:
        raise type(problem)(f"{path}: {problem}") from None
    guess = "HU" if volume.values.min() < -100 else "1/mm"
    return Volume(volume.values, grid, unit or stored.unit or guess)


def write_volume(path: str | Path, volume: Volume, tags: Mapping[str, str] | None = None) -> None:
    """Writes values, their grid (LPS) and their unit; the format follows the name.

    Float32, bit by bit, except in DICOM: there 16 bits with a slope (`dicom_write.quantised`). `.dcm` is a Breast
    Tomosynthesis Image, a name without suffix a folder with a CT series. tags: DICOM keywords and values that palpate
    cannot know, {"PatientID": "7", "FrameLaterality": "L", "ViewPosition": "CC"}. Raises `FileError`, `DataError`.
    """
    path = Path(path)
    if tags and not _is_dicom_name(path):
        raise DataError(f"{path}: tags are DICOM's; name a .dcm file or a folder, or leave them out")
    if _is_dicom_name(path):
        dicom_write.write(path, volume, tags or {})
        return
    path, form = _form(path, writing=True)
    with replacing_folder(path) if form is ome_zarr else replacing(path) as temporary:
        form.write(temporary, Stored(volume.values, affine_of(volume.grid), unit=volume.unit))


def read_labels(path: str | Path, names: Mapping[int, str] | None = None) -> Labels:
    """The labels in a file that `read_volume` could read.

    names: label value to name; None takes those that the file itself carries (written by `write_labels`, by 3D Slicer,
    or as a table in a NIfTI header extension). Raises as `read_volume` does.
    """
    path, stored = _read(path)
    try:
        values, grid = upright(path, stored)
        return Labels(values, grid, dict(stored.names if names is None else names))
    except (DataError, GeometryError) as problem:
        raise type(problem)(f"{path}: {problem}") from None


def write_labels(path: str | Path, labels: Labels) -> None:
    """Writes the smallest integer type that holds the labels, their grid (LPS) and their names. Raises `FileError`."""
    path, form = _form(path, writing=True)
    if form in (ome_zarr, tiff):
        raise FileError(f"{path}: labels are not written in this format; name it .nii.gz, .nrrd or .mha")
    low, high = int(labels.values.min()), int(labels.values.max())
    kinds = (np.uint8, np.int16, np.int32)
    kind = next(k for k in kinds if np.iinfo(k).min <= low and high <= np.iinfo(k).max)
    with replacing(path) as temporary:
        form.write(temporary, Stored(labels.values.astype(kind), affine_of(labels.grid), names=labels.names))


def writable_volume(path: str | Path) -> Path:
    """`path`, once its name says a format and a file can be made there. Call before long work. Raises `FileError`."""
    path = Path(path)
    if path.suffix.lower() in DICOM:
        return writable(path)
    if _is_dicom_name(path) or _form(path, writing=True)[1] is ome_zarr:
        return new_folder(path)
    return writable(path)


def readable(path: str | Path) -> Path:
    """`path`, once it is sure that a file is there. Raises `FileError`."""
    path = Path(path)
    if path.is_dir():
        raise FileError(f"{path}: is a folder; name a file")
    return there(path)


def there(path: str | Path) -> Path:
    """`path`, once it is sure that a file or a folder is there. Raises `FileError`."""
    path = Path(path)
    if not path.exists():
        raise FileError(f"{path}: no such file; check the name (looked from {Path.cwd()})")
    return path


def _read(path: str | Path) -> tuple[Path, Stored]:
    path = Path(path)
    if (path.is_dir() and not path.name.lower().endswith(".zarr")) or is_dicom(path):
        form: ModuleType = ome_zarr if ome_zarr.is_zarr(path) else dicom
    elif path.suffix.lower() in DICOM:
        form = dicom
    else:
        form = _form(path)[1]
    stored: Stored = form.read(there(path) if form in (dicom, ome_zarr) else readable(path))
    if stored.values.dtype.kind not in "fiub":
        raise DataError(f"{path}: expected one number a voxel, got dtype {stored.values.dtype}; split the channels")
    return path, stored


def _is_dicom_name(path: Path) -> bool:
    """Whether what is written to `path` is DICOM: a .dcm file, or a folder."""
    return path.suffix.lower() in DICOM or path.suffix == "" or (path.is_dir() and not path.name.endswith(".zarr"))


def _form(path: str | Path, writing: bool = False) -> tuple[Path, ModuleType]:
    path = Path(path)
    for suffix, form in FORMATS.items():
        if path.name.lower().endswith(suffix) and not (writing and suffix in HEADER_ONLY):
            return path, form
    known = ", ".join(s for s in FORMATS if not (writing and s in HEADER_ONLY))
    raise FileError(
        f"{path}: cannot tell the format from its name; name it with one of {known}, .dcm, or a folder for a CT series"
    )
