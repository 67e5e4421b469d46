"""OME-Zarr folders through zarr: writes NGFF 0.4, reads 0.4 and 0.5. Needs `pip install palpate[zarr]`."""

from pathlib import Path

import numpy as np

from palpate.arrays import AnyArray
from palpate.errors import FileError
from palpate.volumes.file_axes import StoredImage, voxel_size
from palpate.volumes.grid_metadata import metadata_text, read_metadata_text, read_notes
from palpate.volumes.zarr_folder import check_array, is_zarr, stored_bytes, zarr_package

TO_MM = {"meter": 1000.0, "centimeter": 10.0, "millimeter": 1.0, "micrometer": 0.001, "nanometer": 1e-6}
CHUNK = 64
NOTE = "palpate"  # attribute with the exact place: OME-Zarr 0.4 knows scale and shift, no rotation


def read(path: Path) -> StoredImage:
    """The finest level of the first image. Raises `FileError`."""
    zarr = zarr_package()
    if not is_zarr(path):
        raise FileError(f"{path}: not an OME-Zarr folder (neither .zgroup nor zarr.json in it); check the name")
    size = stored_bytes(path)
    try:
        group = zarr.open_group(path, mode="r")
        attributes = dict(group.attrs)
        image = attributes.get("ome", attributes)["multiscales"][0]
        axes, level = image["axes"], image["datasets"][0]
        array = group[level["path"]]
        check_array(path, array, "voxels", size)
        spatial = [i for i, axis in enumerate(axes) if axis.get("type", "space") == "space"]
        if len(spatial) != 3 or any(n != 1 for i, n in enumerate(array.shape) if i not in spatial):
            raise FileError(
                f"{path}: expected 3 axes of space and one channel, got shape {array.shape}; export one volume"
            )
        length = np.array([TO_MM[axes[i]["unit"]] for i in spatial])
        steps = {
            t["type"]: np.array(t[t["type"]], dtype=np.float64)[spatial] for t in level["coordinateTransformations"]
        }
        values: AnyArray = np.asarray(array[...]).reshape([array.shape[i] for i in spatial])
    except (FileError, MemoryError):
        raise
    except Exception as problem:  # a missing key, a missing or damaged chunk
        words = f"{type(problem).__name__}: {problem}"
        raise FileError(f"{path}: not a whole OME-Zarr image ({words}); export it again") from None
    spacing, origin = steps["scale"] * length, steps.get("translation", np.zeros(3)) * length
    text = str(attributes.get(NOTE, ""))
    affine, unit = read_metadata_text(text, spacing[::-1], origin[::-1])
    return StoredImage(values, affine, unit, notes=read_notes(text))


def write(path: Path, stored: StoredImage) -> None:
    """One level, chunks of 64 voxels a side. Raises `FileError` without zarr."""
    zarr = zarr_package()
    spacing = voxel_size(stored.affine)[::-1]
    group = zarr.open_group(path, mode="w", zarr_format=2)
    chunks = tuple(min(CHUNK, n) for n in stored.values.shape)
    array = group.create_array("0", shape=stored.values.shape, dtype=stored.values.dtype, chunks=chunks)
    array[...] = stored.values
    scale = {"type": "scale", "scale": spacing.tolist()}
    shift = {"type": "translation", "translation": stored.affine[:3, 3][::-1].tolist()}
    group.attrs["multiscales"] = [
        {
            "version": "0.4",
            "name": "volume",
            "axes": [{"name": n, "type": "space", "unit": "millimeter"} for n in "zyx"],
            "datasets": [{"path": "0", "coordinateTransformations": [scale, shift]}],
        }
    ]
    group.attrs[NOTE] = metadata_text(stored)
