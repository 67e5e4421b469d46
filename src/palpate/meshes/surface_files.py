"""Reads the triangles of surface files with their parts: solids, regions, objects, groups, nodes."""

import contextlib
import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.arrays import AnyArray
from palpate.bounded_read import existing_file
from palpate.errors import FileError
from palpate.meshes.gltf_reader import read_gltf
from palpate.meshes.line_file import LineFile
from palpate.meshes.obj_reader import read_obj
from palpate.meshes.ply_reader import read_ply
from palpate.meshes.surface_parts import Part, StoredSurface, fans
from palpate.volumes.suppress_output import suppress_output


def is_surface(path: str | Path) -> bool:
    """Whether a name is that of a surface."""
    return Path(path).suffix.lower() in READERS


def read_surface_file(path: Path) -> StoredSurface:
    """What a file says, nothing checked but its form; polygons are divided into triangles. Raises `FileError`."""
    existing_file(path)
    said = io.StringIO()
    try:
        with suppress_output(), contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            return READERS[path.suffix.lower()](path)
    except (SystemExit, Exception) as problem:
        reason = "" if isinstance(problem, SystemExit) or not str(problem) else f" ({problem})"
        raise FileError(
            f"{path}: cannot be read as a {path.suffix} surface{reason}; it may be truncated or of another kind: "
            f"write it again"
        ) from None


def _read_ply_regions(path: Path) -> StoredSurface:
    points, polygons, region, names = read_ply(path)
    lengths = np.array([len(polygon) for polygon in polygons], np.int64)
    corners: AnyArray = np.concatenate(polygons) if polygons else np.empty(0)
    triangles, polygon = fans(corners.astype(np.int64), lengths)
    labels, part = np.unique(region[polygon], return_inverse=True)
    parts = [Part(k, "", names.get(label, "")) for k, label in enumerate(labels.tolist())]
    return StoredSurface(points, triangles, part.ravel().astype(np.int64), parts)


def _read_stl_solids(path: Path) -> StoredSurface:
    """The solids of a text; a binary STL has one."""
    import meshio

    counts, names = _stl_solids(path)
    stored = meshio.read(path)
    faces = [np.asarray(block.data) for block in stored.cells if block.type == "triangle"]
    points = np.asarray(stored.points, dtype=np.float64).reshape(-1, 3)
    triangles = np.concatenate([np.empty((0, 3), np.int64), *faces]).astype(np.int64)
    part, parts = np.zeros(len(triangles), np.int64), [Part(0, "", "")]
    if sum(counts) == len(triangles) and counts:
        part = np.repeat(np.arange(len(counts)), counts)
        parts = [Part(k, "", name) for k, name in enumerate(names)]
    return StoredSurface(points, triangles, part, parts)


def _stl_solids(path: Path) -> tuple[list[int], list[str]]:
    """How many triangles each solid of a text STL has, and the names of solids; none of a binary one.

    Raises `ValueError` where the file does not hold what it says, before anything is read at once.
    """
    counts: list[int] = []
    names: list[str] = []
    with LineFile(path) as file:
        head = file.read(84)
        said, held = int.from_bytes(head[80:], "little"), (path.stat().st_size - 84) / 50
        if said == held:
            return counts, names
        if not head.startswith(b"solid"):
            raise ValueError(f"it says {said} triangles and holds {max(held, 0):.10g}")
        file.seek(0)
        for line in iter(file.readline, b""):
            first, _, rest = line.strip().partition(b" ")
            if first == b"solid":
                names.append(rest.decode("utf-8", "replace"))
                counts.append(0)
            elif first == b"facet" and counts:
                counts[-1] += 1
    if not any(counts):
        raise ValueError("it holds no triangle")
    return counts, names


READERS: dict[str, Callable[[Path], StoredSurface]] = {
    ".stl": _read_stl_solids,
    ".ply": _read_ply_regions,
    ".obj": read_obj,
    ".glb": read_gltf,
    ".gltf": read_gltf,
}
