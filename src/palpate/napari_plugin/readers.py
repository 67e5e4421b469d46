"""Readers of napari: volumes, labels, scans, meshes and tissues. Nothing here imports napari."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from palpate.errors import FileError
from palpate.meshes.io import read_mesh
from palpate.napari_plugin.layers import (
    LayerTuple,
    image_layer,
    labels_layer,
    name_of,
    projections_layer,
    surface_layer,
)
from palpate.scans.importers import import_scan
from palpate.scans.io import read_scan
from palpate.volumes.io import read_labels, read_volume
from palpate.volumes.volume import Volume

IMAGES = (".nii", ".nii.gz", ".nrrd", ".nhdr", ".mha", ".mhd", ".dcm")
MOST_LABELS = 64  # different whole numbers, from 0 on: beyond, it is an image


def get_reader(path: str | Sequence[str]) -> Callable[[object], list[LayerTuple]] | None:
    """What reads a path, or None if nothing here does."""
    one = Path(path if isinstance(path, str) else path[0])
    name = one.name.lower()
    if one.is_dir():
        return partial(read_image, one) if any(one.glob("*.dcm")) else None
    if name.endswith(IMAGES):
        return partial(read_image, one)
    if name.endswith(".vtu"):
        return partial(read_surface, one)
    return partial(read_hdf5, one) if name.endswith(".h5") else None


def read_image(path: Path, _: object = None) -> list[LayerTuple]:
    """A volume, or labels if it holds few whole numbers."""
    volume = read_volume(path)
    if not path.is_dir() and not path.name.lower().endswith(".dcm") and holds_labels(volume):
        return [labels_layer(read_labels(path), name_of(path))]
    return [image_layer(volume, name_of(path))]


def read_hdf5(path: Path, _: object = None) -> list[LayerTuple]:
    """The projections of a scan, or a volume."""
    try:
        with h5py.File(path) as file:
            is_scan = file.attrs.get("format") == "palpate scan"
    except OSError as problem:
        raise FileError(f"{path}: no HDF5 file that can be read ({problem})") from None
    return [projections_layer(read_scan(path), name_of(path))] if is_scan else read_image(path)


def read_surface(path: Path, _: object = None) -> list[LayerTuple]:
    """The surface of a mesh or a tissue."""
    return [surface_layer(read_mesh(path), name_of(path))]


def holds_labels(volume: Volume) -> bool:
    """Whether values look like labels."""
    some = np.unique(volume.values.ravel()[:: max(1, volume.values.size // 100_000)])
    if some.min() < 0 or len(some) > MOST_LABELS or (some != np.round(some)).any():
        return False
    every = np.unique(volume.values)
    return bool(every.min() >= 0 and 1 < len(every) <= MOST_LABELS and (every == np.round(every)).all())


def breast_projections() -> list[LayerTuple]:
    """The sample scan of a breast phantom."""
    return [projections_layer(import_scan("breast"), "breast")]
