"""A lump's outline in each sample, as the share of every voxel that it fills; and how much of each tetrahedron."""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy import ndimage

from palpate.arrays import ArrayLike, Bool, Float32, Float64, float32
from palpate.errors import DataError
from palpate.meshes.tet_mesh import TetMesh
from palpate.reconstruction.posterior import Posterior
from palpate.tissue.stiffness_map import lattice
from palpate.volumes.ellipsoid_shares import ellipsoid_shares
from palpate.volumes.grid import Grid
from palpate.volumes.radial_gradient import RADII, ball_near
from palpate.volumes.segmentation import segment
from palpate.volumes.volume import Volume

STEPS = 5  # of the lattice in a tetrahedron on which the lump's share is read
LEAST_LEVEL = 0.05  # of a voxel's share: where a lump reaches beyond the mesh
SHELL = 0.4, 1.0  # of the lump's radius: where what its contrast compares with begins, and how wide it is
CLOSE = 3.0, 5.0  # mm across and in depth between the ball of a sample and that of the MAP estimate, at most
SIZES = 0.6, 1.5  # radius of a sample's ball over that of the MAP estimate

Rule = Callable[[Volume], ArrayLike]


def outlines(found: Posterior, near: ArrayLike | None, rule: Rule | None) -> list[Float32]:
    """Shares of the MAP estimate and of every sample."""
    grid = found.map.grid
    if rule is None:
        if near is None:
            raise DataError("near: give the lump's place (x, y, z) in mm, or a rule that finds the lump in a volume")
        rule = ball_rule(found.map, near, organ(found.map))
    made = []
    assert found.samples is not None
    for k, values in enumerate([found.map.values, *found.samples]):
        shares = float32("rule", rule(Volume(values, grid, found.map.unit)), grid.shape)
        if not (shares.min() >= 0 and shares.max() <= 1 and shares.any()):
            which = f"sample {k - 1}" if k else "the MAP estimate"
            raise DataError(f"rule: of {which}: expected shares of 0 to 1, and some lump; found up to {shares.max():g}")
        made.append(shares)
    return made


def organ(volume: Volume) -> Bool:
    """(z, y, x) the largest part above Otsu's threshold, filled."""
    return np.asarray(segment(volume, keep="largest", fill_holes=True, fill_slices=True, smooth=1.5).values > 0)


def tet_shares(mesh: TetMesh, shares: Float32, grid: Grid) -> Float64:
    """(M,) share of each tetrahedron that a lump fills: where its share of the voxels, interpolated, is above a level.

    The level is that which keeps the lump's volume: one half would shrink a lump of a few voxels.
    """
    corners, points = grid.indices(mesh.nodes)[mesh.tets], lattice(STEPS)
    filled = np.argwhere(shares > 0)
    near = ((corners.max(axis=1) > filled.min(axis=0) - 1) & (corners.min(axis=1) < filled.max(axis=0) + 1)).all(axis=1)
    at = np.einsum("pk,mkx->xmp", points, corners[near])
    values = ndimage.map_coordinates(shares, at.reshape(3, -1), order=1, mode="constant").reshape(at.shape[1:])
    parts = np.broadcast_to(mesh.volumes[near, None] / len(points), values.shape)
    order = np.argsort(-values, axis=None)
    above = np.cumsum(parts.ravel()[order])
    last = int(np.searchsorted(above, float(shares.sum()) * grid.voxel_volume))
    level = values.ravel()[order[min(last, len(order) - 1)]] if len(order) else 0.0
    found = np.zeros(len(mesh.tets))
    found[near] = (values > max(level, LEAST_LEVEL)).mean(axis=1)
    return found


def contrast_weights(shares: Float32) -> Float32:
    """(z, y, x): Σ weights · f is the mean of f in the lump less that in a shell about it, in the slices of the lump."""
    lump = shares > 0.5
    if not lump.any():
        lump = shares >= shares.max()
    rows = [np.flatnonzero(lump.any(axis=tuple({0, 1, 2} - {k}))) for k in (1, 2)]
    reach = max(np.ptp(r) + 1 for r in rows) / 2
    shell = np.zeros(shares.shape, bool)
    for k in np.flatnonzero(lump.any(axis=(1, 2))):
        away = ndimage.distance_transform_edt(~lump[k])
        shell[k] = (away > SHELL[0] * reach) & (away <= SHELL[0] * reach + max(SHELL[1] * reach, 2))
    weights = shares / shares.sum() - shell / max(shell.sum(), 1)
    return np.asarray(weights, np.float32)


def centre_of_mass(shares: Float32, grid: Grid) -> Float64:
    """(3,) mm: the centre of mass."""
    return np.asarray(grid.points(np.array([ndimage.center_of_mass(shares)]))[0])


def ball_rule(volume: Volume, near: ArrayLike, inside: Bool, radii: tuple[float, float] = RADII) -> Rule:
    """The rule that finds the ball near that of the MAP estimate, in an organ (z, y, x). radii: mm, of the latter."""
    first = ball_near(volume, near, radii=radii, inside=inside)
    return partial(_near_ball, centre=first.centre, radius=first.radius, inside=inside)


def _near_ball(volume: Volume, centre: tuple[float, float, float], radius: float, inside: Bool) -> Float32:
    """The default rule: the ball near that of the MAP estimate."""
    found = ball_near(volume, centre, CLOSE[0], CLOSE[1], (SIZES[0] * radius, SIZES[1] * radius), inside)
    return ellipsoid_shares(volume.grid, found.centre, found.radius)
