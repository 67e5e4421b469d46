"""An image as a file stores it, and the conversion of its axes to a right-handed `Grid`."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from palpate.arrays import AnyArray, Float64
from palpate.errors import FileError
from palpate.volumes.grid import Grid

SKEW = 1e-3  # cosine between two axes; headers in float32 stay far below, a tilted CT gantry far above
HUGE = 1e9  # mm; squares of more may overflow
UPRIGHT = np.diag([-1.0, -1.0, 1.0, 1.0])  # RAS to LPS and back: right and anterior change sign


@dataclass(frozen=True, eq=False)
class StoredImage:
    """values: (k, j, i), the file's fastest index last. affine: (4, 4), indices (i, j, k, 1) to LPS mm.

    unit: of the values, if the file says. names: label value to name, if the file says. notes: of a `Volume`.
    """

    values: AnyArray
    affine: Float64
    unit: str | None = None
    names: Mapping[int, str] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)


def affine_of(grid: Grid) -> Float64:
    """(4, 4): indices (i, j, k, 1) in x, y, z order to LPS mm."""
    affine = np.eye(4)
    affine[:3, :3] = grid.direction * np.array(grid.spacing[::-1])
    affine[:3, 3] = grid.origin
    return affine


def voxel_size(affine: Float64) -> Float64:
    """Voxel size (x, y, z) mm. Rounded to 12 digits: 1.5 mm that went through a rotation shall be 1.5 again."""
    return np.array([float(f"{length:.12g}") for length in np.linalg.norm(affine[:3, :3], axis=0)])


def right_handed(path: Path, stored: StoredImage) -> tuple[AnyArray, Grid]:
    """Values (z, y, x) and their grid; a left-handed file has its first axis reversed, which moves no voxel.

    Raises `FileError` for axes that are not orthogonal, `GeometryError` for lengths that cannot be.
    """
    values, affine = stored.values, np.array(stored.affine, dtype=np.float64)
    if values.ndim != 3:
        raise FileError(f"{path}: expected 3 axes, got shape {values.shape[::-1]}; save one volume a file")
    if np.isfinite(affine).all() and np.abs(affine).max() < HUGE:
        spacing = np.linalg.norm(affine[:3, :3], axis=0)
    else:
        spacing = np.full(3, np.nan)
    if not (spacing > 0).all():
        raise FileError(f"{path}: its header gives no usable voxel size, {spacing.tolist()} mm; write the header anew")
    axes = affine[:3, :3] / spacing
    skew = np.abs(axes.T @ axes - np.eye(3)).max()
    if skew > SKEW:
        raise FileError(
            f"{path}: voxel axes are not orthogonal (cosine {skew:.3g}, a tilted gantry?); resample it first"
        )
    if np.linalg.det(axes) < 0:
        values = values[:, :, ::-1]
        affine[:3, 3] += affine[:3, 0] * (values.shape[2] - 1)
        axes[:, 0] = -axes[:, 0]
    u, _, vt = np.linalg.svd(axes)  # nearest rotation: headers round their cosines to float32
    return values, Grid(values.shape, voxel_size(affine)[::-1], affine[:3, 3], u @ vt)
