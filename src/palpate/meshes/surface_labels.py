"""Labels from closed surfaces: voxels whose middle lies within."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from palpate.arrays import Bool, Float64, Int64, UInt8
from palpate.errors import MeshError
from palpate.meshes.surface_parts import different_names
from palpate.meshes.surface_repair import read_solids
from palpate.meshes.triangle_surface import connected_groups
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Labels

VOXELS = 30e6  # at most: finer ones give no better mesh
A_VOXEL = 1 / 5  # of an edge
MARGIN = 3  # voxels around the surface
OFF = ((0.0012345, 0.0006789), (0.0023571, 0.0017113), (0.0031415, 0.0027182))  # of a voxel: columns beside corners
HOLE = 2.0  # edges: a hole that is wider may be where a part of the organ is missing


def read_surfaces(path: str | Path, edge: float = 4.0, inclusions: Sequence[str | Path] = ()) -> Labels:
    """Read closed surfaces of triangles (.stl, .ply, .obj, .glb, .gltf) as labels, fine enough for elements of `edge`.

    Coordinates are taken as mm in patient space (LPS); those of glTF as metres, y towards the head, z to the front. Nodes
    of glTF are moved by their transforms. Defects that can be repaired are repaired, with a warning: points and triangles
    that are there twice, triangles without area, small holes. Which side of a triangle is outside does not matter. A
    surface inside another is a void; one that crosses another joins it, with a warning.

    A file of several closed solids is an organ with its inclusions: the largest is the organ, those inside it become
    labels of their own, others join it, with a warning. Solids are those of a text .stl, the regions of a .ply whose
    faces have a `region`, the objects and groups of an .obj, the nodes of glTF. Parts that meet at open edges, such as
    groups of one material each, are one solid.

    Parameters
    ----------
    path : str or Path
        The organ's surface. It becomes label 1.
    edge : float, optional
        Edge of the elements that are to be made, mm. Voxels are a fifth of it.
    inclusions : sequence of str or Path, optional
        Surfaces inside the organ, which become labels 2, 3 and so on.

    Returns
    -------
    Labels
        Labels with the names of the files, to be given to `tetrahedralize`.

    Raises
    ------
    FileError
        If a file is missing or cannot be read.
    DataError
        If a point is not finite.
    MeshError
        If a surface is open or of no organ's size, or the edge is no length.

    Examples
    --------
    >>> pp.write_mesh("organ.stl", pp.tetrahedralize(labels, "organ", edge=14))
    >>> pp.read_surfaces("organ.stl", edge=6).names
    {1: 'organ'}
    """
    if not (np.isfinite(edge) and edge > 0):
        raise MeshError(f"edge: expected a positive length in mm, got {edge!r}")
    paths = [Path(p) for p in (path, *inclusions)]
    surfaces: list[tuple[Path, str, Float64, Int64]] = []
    for one in paths:
        solids = read_solids(one, HOLE * edge)
        largest = max(solids, key=lambda name: float(np.prod(np.ptp(solids[name][0], axis=0))))
        every = [(name, solids[name]) for name in (largest, *(other for other in solids if other != largest))]
        size = float(np.ptp(every[0][1][0], axis=0).max())
        unit = "metres" if one.suffix.lower() in (".glb", ".gltf") else "mm"
        odd = f"it is {size:.3g} mm across: coordinates are read as {unit}; scale it if they are not"
        if not 0.01 <= size <= 1e5:
            raise MeshError(f"{one}: {odd}")
        if not 1 <= size <= 2000:
            every[0][1][2].append(odd)
        for number, (name, (points, triangles, notes)) in enumerate(every):
            for note in notes:
                warnings.warn(f"{one}: {note}", stacklevel=2)
            surfaces.append((one, name if number else one.stem, points, triangles))
    low, high = surfaces[0][2].min(axis=0), surfaces[0][2].max(axis=0)
    step = max(A_VOXEL * edge, float(np.prod(high - low + edge) / VOXELS) ** (1 / 3))
    shape = np.ceil((high - low) / step).astype(int)[::-1] + 2 * MARGIN
    grid = Grid(tuple(shape.tolist()), (step,) * 3, low + step / 2 - MARGIN * step)
    values = np.zeros(grid.shape, np.int32)
    names: dict[int, str] = {}
    for one, name, points, triangles in surfaces:
        inside = _inside(one, points, triangles, grid)
        if not inside.any():
            raise MeshError(
                f"{one}: {name} holds no voxel of {step:.3g} mm; take a shorter edge, or check that it is in the organ"
            )
        if names and one == paths[0] and np.count_nonzero(inside & (values > 0)) < np.count_nonzero(inside) / 2:
            warnings.warn(f"{one}: {name} lies outside {names[1]}: joined", stacklevel=2)
            values[inside & (values == 0)] = 1
            continue
        names[len(names) + 1] = name
        values[inside & (values > 0) if len(names) > 1 else inside] = len(names)
    return Labels(values, grid, dict(zip(names, different_names(list(names.values()), "surface"), strict=True)))


def _inside(path: Path, points: Float64, triangles: Int64, grid: Grid) -> Bool:
    """Voxels inside: of shells that lie in each other, those in an odd number; of shells that cross, those in any."""
    _, part = connected_groups(len(points), triangles[:, [0, 1, 1, 2]].reshape(-1, 2))
    part = part[triangles[:, 0]]
    whole: Bool = np.zeros(grid.shape, bool)
    crossing, specks = 0, 0
    order = sorted(
        np.unique(part), key=lambda n: -float(np.prod(np.ptp(points[triangles[part == n]].reshape(-1, 3), axis=0)))
    )
    for number in order:
        mask = _filled(path, points, triangles[part == number], grid)
        within, size = int(np.count_nonzero(mask & whole)), int(np.count_nonzero(mask))
        if size == 0:
            specks += 1
        elif within == size:
            whole &= ~mask  # a void
        else:
            crossing += int(within > 0)
            whole |= mask
    if specks and whole.any():
        warnings.warn(f"{path}: {specks} of its {len(order)} parts hold no voxel: dropped", stacklevel=3)
    if crossing:
        warnings.warn(f"{path}: {crossing} of its {len(order)} parts cross others: joined", stacklevel=3)
    return whole


def _filled(path: Path, points: Float64, triangles: Int64, grid: Grid) -> Bool:
    """Voxels within one closed shell: a column along z enters and leaves it by turns."""
    for off in OFF:
        place = (points - grid.origin) / grid.spacing[0]  # in voxels, x, y, z
        place[:, :2] -= off
        turns = _turns(place[triangles], grid.shape)
        inside = np.bitwise_xor.accumulate(turns, axis=2)
        if not inside[:, :, -1].any():  # else a column passed through an edge, and a turn was counted twice
            return np.ascontiguousarray(inside[:, :, :-1].transpose(2, 0, 1)).astype(bool)
    raise MeshError(f"{path}: its inside cannot be told, triangles cross or touch in many places; remesh the surface")


def _turns(corner: Float64, shape: tuple[int, int, int]) -> UInt8:
    """(rows, columns, depth + 1): 1 where a column crosses triangles (F, 3, 3) an odd number of times below a voxel."""
    depth, rows, columns = shape
    low = np.maximum(np.ceil(corner[:, :, :2].min(axis=1)), 0).astype(np.int64)
    high = np.minimum(np.floor(corner[:, :, :2].max(axis=1)), [columns - 1, rows - 1]).astype(np.int64)
    counts = np.maximum(high - low + 1, 0)
    turns = np.zeros((rows, columns, depth + 1), np.uint8)
    per = counts.prod(axis=1)
    for piece in np.array_split(np.arange(len(corner)), max(1, int(per.sum() // 4_000_000))):
        face = np.repeat(piece, per[piece])
        index = np.arange(len(face)) - np.repeat(np.cumsum(per[piece]) - per[piece], per[piece])
        x = low[face, 0] + index % np.maximum(counts[face, 0], 1)
        y = low[face, 1] + index // np.maximum(counts[face, 0], 1)
        a, b, c = (corner[face, k] for k in range(3))
        area = _twice(a, b, c[:, 0], c[:, 1])
        weights = np.stack([_twice(b, c, x, y), _twice(c, a, x, y), _twice(a, b, x, y)])
        hit = (area != 0) & ((weights >= 0).all(axis=0) | (weights <= 0).all(axis=0))
        share = weights[:, hit] / area[hit]
        z = share[0] * a[hit, 2] + share[1] * b[hit, 2] + share[2] * c[hit, 2]
        level = np.clip(np.ceil(z), 0, depth).astype(np.int64)
        np.bitwise_xor.at(turns, (y[hit], x[hit], level), 1)
    return turns


def _twice(p: Float64, q: Float64, x: Float64 | Int64, y: Float64 | Int64) -> Float64:
    """Twice the signed area of the triangle of p, q and (x, y), seen along z."""
    area: Float64 = (q[:, 0] - p[:, 0]) * (y - p[:, 1]) - (q[:, 1] - p[:, 1]) * (x - p[:, 0])
    return area
