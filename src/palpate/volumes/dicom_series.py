"""Which DICOM files of a folder belong together, also where an anonymiser left no number of the series."""

import warnings
from collections.abc import Collection
from pathlib import Path

import numpy as np
from pydicom import Dataset

from palpate.errors import FileError
from palpate.volumes.dicom_io import dicom_paths, has_tag, read_dataset, reading_dicom, tag_name

OVERVIEW = "LOCALIZER"  # a CT's overview often lies in the series of its slices
ALIKE = ("Modality", "Rows", "Columns", "PixelSpacing", "ImagerPixelSpacing", "ImageOrientationPatient")


def series_paths(folder: Path, kinds: Collection[str], like: Path | None = None) -> list[Path]:
    """The files of the one series in a folder, or of that to which the file `like` belongs.

    kinds: SOP classes that are wanted. Overviews of a CT are passed over. So are, with a warning, files of other kinds,
    and single files whose images differ in size, spacing or orientation from those of a series. Files without a Series
    Instance UID are taken together by these, with a warning.

    Raises `FileError`, which names a file of each, when there are several series.
    """
    members: dict[str, list[Path]] = {}
    headers: dict[str, Dataset] = {}
    wanted = None
    for path in dicom_paths(folder):
        with reading_dicom(path):
            header = read_dataset(path, pixels=False)
            if OVERVIEW not in (header.get("ImageType") or []):
                if not (has_tag(header, "SeriesInstanceUID") or has_tag(header, "Rows")) and _kind(header) in {
                    "",
                    *kinds,
                }:
                    raise FileError(
                        f"{path}: lacks {tag_name('SeriesInstanceUID')} and {tag_name('Rows')}: cut short; copy it again, or "
                        f"move it elsewhere"
                    )
                key = _series(header)
                members.setdefault(key, []).append(path)
                headers.setdefault(key, header)
                wanted = key if like is not None and path.name == like.name else wanted
    if like is not None:
        return members.get(wanted or "", [])
    foreign = [key for key in members if _kind(headers[key]) not in kinds]
    if len(foreign) == len(members):
        return [path for paths in members.values() for path in paths]  # and the reader says of which kind they are
    most = max((key for key in members if key not in foreign), key=lambda key: len(members[key]))
    for key, paths in members.items():
        if (
            key not in foreign
            and len(paths) == 1 < len(members[most])
            and _images(headers[key]) != _images(headers[most])
        ):
            foreign.append(key)
    series = {key: paths for key, paths in members.items() if key not in foreign}
    if len(series) > 1:
        examples = [f"{paths[0].name} ({len(paths)} files)" for paths in list(series.values())[:6]]
        raise FileError(
            f"{folder}: holds {len(series)} series; name one file of the series that you want: {', '.join(examples)}"
        )
    if foreign:
        names = [path.name for key in foreign for path in members[key]]
        warnings.warn(
            f"{folder}: passed over {len(names)} files of another kind: {', '.join(names[:6])}"
            f"{', ...' if len(names) > 6 else ''}",
            stacklevel=2,
        )
    if not has_tag(headers[most], "SeriesInstanceUID"):
        warnings.warn(
            f"{folder}: {len(members[most])} files without Series Instance UID: taken together by the size, spacing and "
            f"orientation of their images",
            stacklevel=2,
        )
    return members[most]


def _series(header: Dataset) -> str:
    """What the files of one series have in common."""
    if has_tag(header, "SeriesInstanceUID"):
        return str(header.SeriesInstanceUID)
    return f"{_kind(header)} {_images(header)}"


def _kind(header: Dataset) -> str:
    return str(header.get("SOPClassUID") or "")


def _images(header: Dataset) -> str:
    """Size, spacing and orientation of the images, rounded as their texts may be."""
    values = []
    for keyword in ALIKE:
        value = header.get(keyword)
        try:
            values.append(np.round(np.asarray(value, dtype=np.float64), 3).tolist())
        except (TypeError, ValueError):
            values.append(str(value))
    return str(values)
