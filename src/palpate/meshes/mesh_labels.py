"""A mesh of each organ of a label map, in a folder."""

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.atomic_write import output_folder
from palpate.errors import DataError, MeshError
from palpate.meshes.io import write_mesh
from palpate.meshes.tetrahedralize import tetrahedralize
from palpate.volumes.volume import Labels

NODES = 2500  # of an organ, about: a few seconds until it can be touched
NODE_SHARE = 0.5  # of the cube of an edge, mm³, that a node has in a body without much surface
LONGEST_STEM = 100  # characters of a file's name


@dataclass(frozen=True)
class LabelMesh:
    """What became of a label that was to be meshed.

    Parameters
    ----------
    label : int
        Its number.
    name : str
        Its name, or else its number.
    edge : float
        Length of an element edge, mm.
    file : Path or None
        The mesh; None if it could not be made.
    nodes, tets : int
        Of the mesh.
    volume : float
        Of the mesh, mm³.
    problem : str
        Why there is no mesh.

    Examples
    --------
    >>> pp.mesh_labels(labels, "meshes", edge=14)[0].problem
    ''
    """

    label: int
    name: str
    edge: float
    file: Path | None
    nodes: int = 0
    tets: int = 0
    volume: float = 0.0
    problem: str = ""


def mesh_labels(
    labels: Labels,
    folder: str | Path,
    edge: float | None = None,
    *,
    nodes: int = NODES,
    progress: Callable[[str, float], None] | None = None,
    **options: Any,
) -> list[LabelMesh]:
    """Mesh each label by itself, and write it to a folder as NAME.vtu.

    A label that cannot be meshed is told in the result, and the others are meshed all the same.

    Parameters
    ----------
    labels : Labels
        The labels; all but 0 are meshed.
    folder : str or Path
        Where the meshes go. It is made if need be; files of the same names are replaced.
    edge : float, optional
        Length of an element edge, mm. The default is as long as gives each organ about so many `nodes`.
    nodes : int, optional
        That number.
    progress : callable, optional
        Is told the name of the label that is meshed, and the share that is done.
    **options
        Of `tetrahedralize`. Unless said, organs that the volume's side cuts are closed.

    Returns
    -------
    list of LabelMesh
        One for each label, by number.

    Raises
    ------
    DataError
        If there is no label, or edge or nodes is not positive.
    FileError
        If the folder cannot be written to.

    Examples
    --------
    >>> for made in pp.mesh_labels(labels, "meshes", edge=14):
    ...     print(made.name, made.file.name)
    organ organ.vtu
    lump lump.vtu
    """
    if edge is not None and not (np.isfinite(edge) and edge > 0):
        raise DataError(f"edge: expected a positive length in mm, got {edge!r}")
    if not nodes > 0:
        raise DataError(f"nodes: expected a number above 0, got {nodes!r}")
    values, counts = np.unique(labels.values, return_counts=True)
    if not values.any():
        raise DataError("labels: all of it is 0; segment an organ first")
    folder = output_folder(folder)
    voxel = float(np.prod(labels.grid.spacing))
    taken: set[str] = set()
    found = []
    for k, (label, count) in enumerate(zip(values.tolist(), counts.tolist(), strict=True)):
        if label == 0:
            continue
        name = labels.names.get(label, str(label))
        if progress:
            progress(name, k / len(values))
        long = edge if edge is not None else float(np.cbrt(count * voxel / (NODE_SHARE * nodes)))
        file = folder / f"{_stem(name, label, taken)}.vtu"
        found.append(_meshed(labels, label, name, long, file, {"closed_at_border": True, **options}))
    if progress:
        progress("meshed", 1.0)
    return found


def _meshed(labels: Labels, label: int, name: str, edge: float, file: Path, options: dict[str, Any]) -> LabelMesh:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # parts that are left out, in each of a hundred organs
        try:
            mesh = tetrahedralize(labels, label, edge, **options)
        except (DataError, MeshError) as problem:
            return LabelMesh(label, name, edge, None, problem=str(problem))
    write_mesh(file, mesh)
    return LabelMesh(label, name, edge, file, len(mesh.nodes), len(mesh.tets), float(mesh.volumes.sum()))


def _stem(name: str, label: int, taken: set[str]) -> str:
    """A file's name that no other label has, on any system."""
    stem = re.sub(r"[^\w.-]+", "_", name)[:LONGEST_STEM].strip("._") or str(label)
    if stem.lower() in taken:
        stem = f"{stem}_{label}"
    taken.add(stem.lower())
    return stem
