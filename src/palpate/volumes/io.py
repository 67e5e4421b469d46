"""Reads and writes volumes and labels: NIfTI, NRRD, MetaImage, DICOM, OME-Zarr, TIFF."""

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import numpy as np

from palpate.atomic_write import new_folder, replacing, replacing_folder, writable
from palpate.bounded_read import existing_file, existing_path
from palpate.errors import DataError, FileError, GeometryError
from palpate.plugins import read_by_plugin
from palpate.volumes import dicom_segmentation_write, dicom_volumes, dicom_write, metaimage, nifti, nrrd, ome_zarr, tiff
from palpate.volumes.dicom_io import is_dicom
from palpate.volumes.dicom_source import source_images
from palpate.volumes.file_axes import StoredImage, affine_of, right_handed
from palpate.volumes.suppress_output import suppress_output
from palpate.volumes.volume import Labels, Volume
from palpate.volumes.zarr_folder import is_zarr

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
    """Read a volume from a file or a folder.

    The format is NIfTI (.nii, .nii.gz), NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), TIFF with a voxel size (.tif),
    OME-Zarr (.zarr) or DICOM. For DICOM, give a multi-frame file, a folder with one CT series, or one slice of it.

    Parameters
    ----------
    path : str or Path
        The file or folder.
    unit : str, optional
        Unit of the values. By default it is taken from the file; without one it is "HU" if a value lies below -100,
        else "1/mm".

    Returns
    -------
    Volume
        Its grid is in patient space (LPS, mm), whatever the convention of the file.

    Raises
    ------
    FileError
        If the file is missing or cannot be read.
    DataError
        If the values are not finite numbers.
    GeometryError
        If the file's lengths or axes are not valid.

    Examples
    --------
    >>> pp.write_volume("volume.nii.gz", volume)
    >>> pp.read_volume("volume.nii.gz").grid.shape
    (8, 20, 24)
    """
    if (read := read_by_plugin(Path(path), Volume)) is not None:
        return read if unit is None else Volume(read.values, read.grid, unit)
    path, stored = _read(path)
    try:
        values, grid = right_handed(path, stored)
        volume = Volume(values, grid)
    except (DataError, GeometryError) as problem:
        raise type(problem)(f"{path}: {problem}") from None
    guess = "HU" if volume.values.min() < -100 else "1/mm"
    return Volume(volume.values, grid, unit or stored.unit or guess, stored.notes)


def write_volume(path: str | Path, volume: Volume, tags: Mapping[str, str] | None = None) -> None:
    """Write a volume; the format follows the name.

    The values are written as float32 without loss, except to DICOM, where they take 16 bits and a slope.

    Parameters
    ----------
    path : str or Path
        The file. A name in .dcm is a Breast Tomosynthesis Image; a name without suffix is a folder with a CT series.
    volume : Volume
        Values, grid and unit.
    tags : mapping of str to str, optional
        DICOM keywords and values that palpate cannot know, such as {"PatientID": "7", "ViewPosition": "CC"}.

    Raises
    ------
    FileError
        If the file cannot be written or the format is unknown.
    DataError
        If `tags` are given for a format other than DICOM.

    Examples
    --------
    >>> pp.write_volume("volume.mha", volume)
    """
    path = Path(path)
    if tags and not _is_dicom_name(path):
        raise DataError(f"{path}: tags are DICOM's; name a .dcm file or a folder, or leave them out")
    if _is_dicom_name(path):
        dicom_write.write(path, volume, tags or {})
        return
    path, form = _form(path, writing=True)
    with replacing_folder(path) if form is ome_zarr else replacing(path) as temporary:
        form.write(temporary, StoredImage(volume.values, affine_of(volume.grid), volume.unit, notes=volume.notes))


def read_labels(path: str | Path, names: Mapping[int, str] | None = None) -> Labels:
    """Read labels from a file, in any format of `read_volume`.

    Parameters
    ----------
    path : str or Path
        The file.
    names : mapping of int to str, optional
        Name of each label. By default they come from the file (written by `write_labels`, by 3D Slicer, or as a table
        in a NIfTI header extension).

    Returns
    -------
    Labels
        The labels, with their grid in patient space.

    Raises
    ------
    FileError, DataError, GeometryError
        As `read_volume`.

    Examples
    --------
    >>> pp.write_labels("labels.nii.gz", labels)
    >>> pp.read_labels("labels.nii.gz").names
    {1: 'organ', 2: 'lump'}
    """
    if (read := read_by_plugin(Path(path), Labels)) is not None:
        return read if names is None else Labels(read.values, read.grid, names)
    path, stored = _read(path)
    try:
        values, grid = right_handed(path, stored)
        return Labels(values, grid, dict(stored.names if names is None else names))
    except (DataError, GeometryError) as problem:
        raise type(problem)(f"{path}: {problem}") from None


def write_labels(path: str | Path, labels: Labels, like: str | Path | None = None) -> None:
    """Write labels, their grid and their names, as the smallest integer type that holds them, or as a DICOM segmentation.

    Parameters
    ----------
    path : str or Path
        A file in .nii, .nii.gz, .nrrd, .mha or .dcm.
    labels : Labels
        What to write.
    like : str or Path, optional
        Needed for .dcm alone: the folder of the DICOM series on whose grid the labels lie, one file of it, or a
        multi-frame file. The segmentation has its patient, study and frame of reference, and refers to its images. Axes
        of the labels may be swapped or reversed against it.

    Raises
    ------
    FileError
        If the file cannot be written, the format holds no labels, or `like` cannot be read or lacks an identifier.
    DataError
        If `like` is missing, is given for another format or is no volume, or if DICOM cannot hold the labels: none,
        negative ones, more than 65,535, names of more than 64 characters.
    GeometryError
        If the labels do not lie on the grid of `like`.

    Examples
    --------
    >>> pp.write_labels("labels.nrrd", labels)
    >>> pp.write_volume("ct", volume)
    >>> pp.write_labels("labels.dcm", labels, like="ct")
    >>> pp.read_labels("labels.dcm").names
    {1: 'organ', 2: 'lump'}
    """
    path, form = _labels_form(path, like)
    if form is None:
        dicom_segmentation_write.write(path, labels, like)
        return
    low, high = int(labels.values.min()), int(labels.values.max())
    kinds = (np.uint8, np.int16, np.int32)
    kind = next(k for k in kinds if np.iinfo(k).min <= low and high <= np.iinfo(k).max)
    with replacing(path) as temporary:
        form.write(temporary, StoredImage(labels.values.astype(kind), affine_of(labels.grid), names=labels.names))


def writable_labels(path: str | Path, like: str | Path | None = None) -> None:
    """Returns if labels can be written to `path`, like those images. Call before long work.

    Raises `FileError`, `DataError`.
    """
    path, form = _labels_form(path, like)
    writable(path)
    if form is None:
        source_images(like)


def _labels_form(path: str | Path, like: str | Path | None) -> tuple[Path, ModuleType | None]:
    """The format in which labels are written; None for a DICOM segmentation."""
    path = Path(path)
    if path.suffix.lower() in DICOM:
        return path, None
    if like is not None:
        raise DataError(f"{path}: like is for DICOM segmentations; name a .dcm file, or leave it out")
    path, form = _form(path, writing=True)
    if form in (ome_zarr, tiff):
        raise FileError(f"{path}: labels are not written in this format; name it .nii.gz, .nrrd, .mha or .dcm")
    return path, form


def writable_volume(path: str | Path) -> Path:
    """`path`, once its name says a format and a file can be made there. Call before long work. Raises `FileError`."""
    path = Path(path)
    if path.suffix.lower() in DICOM:
        return writable(path)
    if _is_dicom_name(path) or _form(path, writing=True)[1] is ome_zarr:
        return new_folder(path)
    return writable(path)


def _read(path: str | Path) -> tuple[Path, StoredImage]:
    path = Path(path)
    if (path.is_dir() and not path.name.lower().endswith(".zarr")) or is_dicom(path):
        form: ModuleType = ome_zarr if is_zarr(path) else dicom_volumes
    elif path.suffix.lower() in DICOM:
        form = dicom_volumes
    else:
        form = _form(path)[1]
    there = existing_path(path) if form in (dicom_volumes, ome_zarr) else existing_file(path)
    with suppress_output():
        stored: StoredImage = form.read(there)
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
