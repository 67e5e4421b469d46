"""Volumes, labels, scans and meshes as layers of napari, and back: its world is patient space in mm, axes (z, y, x)."""

from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import Float64
from palpate.errors import DataError
from palpate.meshes.tet_mesh import TetMesh
from palpate.scans.intensity_correction import line_integrals
from palpate.scans.scan import Scan
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Labels, Volume

LayerTuple = tuple[Any, dict[str, Any], str]  # data, keywords, kind: what a reader of napari returns
SHEAR = 1e-6  # of a voxel's edge


def affine_of(grid: Grid) -> Float64:
    """(4, 4): from voxel indices (z, y, x) to mm (z, y, x)."""
    affine = np.eye(4)
    affine[:3, :3] = grid.direction[::-1, ::-1] * np.array(grid.spacing)
    affine[:3, 3] = grid.origin[::-1]
    return affine


def grid_of(layer: Any) -> Grid:
    """The grid of an image or labels layer, as it lies in the viewer. Raises `DataError`; `GeometryError` if it mirrors."""
    shape = np.shape(layer.data)
    if len(shape) != 3:
        raise DataError(f"layer {layer.name}: {len(shape)} axes, expected 3 (z, y, x)")
    origin = np.array(layer.data_to_world((0, 0, 0)), dtype=np.float64)
    edges = np.stack([np.array(layer.data_to_world(tuple(e)), dtype=np.float64) - origin for e in np.eye(3)], axis=1)
    spacing = np.linalg.norm(edges, axis=0)
    turn = edges / np.maximum(spacing, 1e-300)
    if not np.abs(turn.T @ turn - np.eye(3)).max() < SHEAR:
        raise DataError(f"layer {layer.name}: its axes are not square to each other; resample it first")
    return Grid(shape, spacing, origin=origin[::-1], direction=turn[::-1, ::-1])


def image_layer(volume: Volume, name: str) -> LayerTuple:
    """A volume as an image."""
    low, high = np.percentile(volume.values, (0.5, 99.5)).tolist()
    limits = (low, high if high > low else low + 1)
    return volume.values, {"name": name, "affine": affine_of(volume.grid), "contrast_limits": limits}, "image"


def labels_layer(labels: Labels, name: str) -> LayerTuple:
    """Labels, with their names as features."""
    named = {"index": [0, *labels.names], "name": ["", *labels.names.values()]}
    return labels.values, {"name": name, "affine": affine_of(labels.grid), "features": named}, "labels"


def projections_layer(scan: Scan, name: str) -> LayerTuple:
    """The line integrals of a scan, a slice for each view; pixels in mm."""
    pitch = np.array([panel.pitch for panel in scan.views.panels]).mean(axis=0)
    lines = line_integrals(scan)
    high = float(np.percentile(lines, 99.5))
    keywords = {"name": name, "scale": (1.0, *pitch.tolist()), "contrast_limits": (0.0, max(high, 1e-3))}
    return lines, keywords, "image"


def surface_layer(mesh: TetMesh, name: str) -> LayerTuple:
    """The outer surface of a mesh."""
    used, corner = np.unique(mesh.surface, return_inverse=True)
    # Reversed axes mirror: so do the corners of each triangle.
    faces = corner.reshape(-1, 3)[:, ::-1].astype(np.int32)
    return (mesh.nodes[used][:, ::-1], faces), {"name": name, "shading": "smooth"}, "surface"


def labels_of(layer: Any) -> Labels:
    """The labels of a layer. Raises `DataError` or `GeometryError`."""
    return Labels(np.asarray(layer.data), grid_of(layer))


def name_of(path: str | Path) -> str:
    """The name of a layer from a file."""
    return Path(path).name.removesuffix(".gz").rpartition(".")[0] or Path(path).name
