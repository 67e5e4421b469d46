"""Stiffness of each tetrahedron from a map on voxels, such as MR elastography makes."""

from itertools import product

import numpy as np

from palpate.arrays import Float64
from palpate.errors import DataError
from palpate.meshes.tet_mesh import TetMesh
from palpate.tissue.named_tissues import Named, named_materials, poisson_of
from palpate.tissue.tissue import Constant, constant_per_tet
from palpate.volumes.volume import Volume

QUANTITIES = ("shear", "young")
MOST_STEPS = 6  # 56 points a tet
SOFTEST, STIFFEST = 0.01, 1000.0  # kPa: medians of soft tissue lie far inside


def stiffness_from_map(
    mesh: TetMesh,
    stiffness: Volume,
    quantity: str,
    poisson: Constant | None = None,
    tissue: Named | None = None,
) -> Float64:
    """Return Young's modulus of each tetrahedron: the mean of a map over the tetrahedron.

    The map is interpolated linearly between voxel centres, at points that fill each tetrahedron, about one voxel apart.
    A linear map is averaged exactly. Voxels of 0 hold no measurement and are left out.

    Parameters
    ----------
    mesh : TetMesh
        The solid, in the patient space of the map.
    stiffness : Volume
        The map, kPa.
    quantity : {"shear", "young"}
        What the map holds. MR elastography gives the shear modulus μ, and E = 2 (1 + ν) μ.
    poisson, tissue : optional
        As for `fit`; a shear modulus needs ν.

    Returns
    -------
    ndarray, (M,)
        Young's modulus, kPa.

    Raises
    ------
    DataError
        If the quantity is not known, a value is negative or cannot be kPa, or the map does not cover the mesh.
    MaterialError
        If Poisson's ratio is not that of a tissue.

    Notes
    -----
    MR elastography vibrates the tissue, at 40 to 60 Hz most often. Tissue is stiffer there than under a slow press.

    Examples
    --------
    >>> elastogram = pp.Volume(np.full(grid.shape, 5.0), grid, unit="kPa")
    >>> young = pp.stiffness_from_map(mesh, elastogram, quantity="shear", poisson=0.4)
    >>> bool(np.allclose(young, 14))
    True
    """
    if quantity not in QUANTITIES:
        raise DataError(
            f"quantity: {quantity!r} is not known; say what the map holds: shear (of MR elastography) or young"
        )
    total, samples, points = _sampled(mesh, stiffness)
    _refuse_gaps(mesh, samples, points)
    mean = total / samples
    _refuse_units(mean)
    if quantity == "young":
        return mean
    nu = constant_per_tet("poisson", poisson_of(mesh, poisson, named_materials(mesh, tissue)), mesh)
    return np.asarray(2 * (1 + nu) * mean)


def lattice(steps: int) -> Float64:
    """(P, 4) barycentric coordinates of a lattice in the tetrahedron; equal weights are exact for quadratic maps.

    A lattice point is shifted towards the centroid by what makes its second moments those of the tetrahedron. Two steps are
    the four-point rule of degree 2.
    """
    whole = np.array([c for c in product(range(steps), repeat=4) if sum(c) == steps - 1], dtype=np.float64)
    size = np.sqrt((steps - 1) * (steps + 3))
    return np.asarray((whole + (size - (steps - 1)) / 4) / size)


def _sampled(mesh: TetMesh, stiffness: Volume) -> tuple[Float64, Float64, int]:
    """Sum of the map over the points of each tet that it covers, their number (M,), and the points in each tet."""
    corners = mesh.nodes[mesh.tets]
    longest = max(
        float(np.linalg.norm(corners[:, a] - corners[:, b], axis=1).max()) for a in range(4) for b in range(a)
    )
    points = lattice(int(np.clip(np.ceil(longest / min(stiffness.grid.spacing)), 2, MOST_STEPS)))
    total, samples = np.zeros(len(mesh.tets)), np.zeros(len(mesh.tets))
    for shares in points:
        value, covered = _interpolated(stiffness, np.einsum("k,mkx->mx", shares, corners))
        total += np.where(covered, value, 0)
        samples += covered
    return total, samples, len(points)


def _interpolated(stiffness: Volume, points: Float64) -> tuple[Float64, Float64]:
    """Linear between the voxels that hold a measurement; 1 where those have half of the weight or more, else 0."""
    shape = np.array(stiffness.grid.shape)
    at = stiffness.grid.indices(points)
    inside = ((at >= -0.5) & (at <= shape - 0.5)).all(axis=1)
    at = np.clip(at, 0, shape - 1)
    low = np.minimum(at.astype(int), np.maximum(shape - 2, 0))
    part = at - low
    total, weight = np.zeros(len(points)), np.zeros(len(points))
    for step in product((0, 1), repeat=3):
        w = np.where(step, part, 1 - part).prod(axis=1) * inside
        z, y, x = np.minimum(low + step, shape - 1).T
        values = stiffness.values[z, y, x].astype(np.float64)
        _refuse_negative(values, w, (z, y, x))
        w = w * (values > 0)
        total += w * values
        weight += w
    covered = (weight >= 0.5 - 1e-9).astype(np.float64)
    return total / np.where(covered > 0, weight, 1), covered


def _refuse_negative(values: Float64, weight: Float64, voxels: tuple[Float64, ...]) -> None:
    bad = np.flatnonzero((values < 0) & (weight > 0))
    if len(bad):
        where = ", ".join(str(int(axis[bad[0]])) for axis in voxels)
        raise DataError(
            f"stiffness: {values[bad[0]]:g} kPa at voxel ({where}) (z, y, x), inside the mesh; expected positive values, "
            f"or 0 where nothing was measured"
        )


def _refuse_gaps(mesh: TetMesh, samples: Float64, points: int) -> None:
    if (samples == 0).any():
        outside = 100 * float(mesh.volumes @ (1 - samples / points)) / float(mesh.volumes.sum())
        raise DataError(
            f"stiffness: {outside:.3g} % of the mesh lies outside the map or where the map is 0, first tet "
            f"{int(np.argmin(samples))}; expected a map that covers the mesh: take the map of the same scan, or cut the mesh"
        )


def _refuse_units(mean: Float64) -> None:
    middle = float(np.median(mean))
    for wrong, unit, factor in ((middle > STIFFEST, "Pa", "divide by 1000"), (middle < SOFTEST, "MPa", "times 1000")):
        if wrong:
            raise DataError(f"stiffness: the median is {middle:g}: in {unit}? expected kPa; {factor}")
