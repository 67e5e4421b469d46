"""A tube that turns about an axis, with its panel or above a panel that stays still, by fourteen numbers."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.arrays import Float64
from palpate.errors import GeometryError
from palpate.scans.view_parameters import PARAMETERS, UNITS, Poses

# Source, panel and axis as they are in the middle view, along that panel's own axes. Of the axis: its place and direction
# in the two directions across it.
RIGID = (
    *PARAMETERS,
    "rotation axis moved, first way",
    "rotation axis moved, second way",
    "rotation axis tilted, first way",
    "rotation axis tilted, second way",
    "arc longer",
)
RIGID_UNITS = (*UNITS, "mm", "mm", "degrees", "degrees", "%")
EXACT = 1e-4  # of the distances: how far a start may be from a true rotation


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """The start: poses, number of the middle view, axis (direction and a point), angle of each view from it in radians."""

    at: Poses
    middle: int
    axis: Float64
    point: Float64
    angles: Float64
    turning: bool

    def poses(self, numbers: Float64) -> Poses:
        """The poses for the fourteen numbers of `RIGID`: mm, degrees, and % by which the arc is longer."""
        at, k = self.at, self.middle
        own = at.axes[k]
        source = at.source[k] + numbers[:3] @ own
        panel = at.middle[k] + numbers[3:6] @ own
        axes = own @ Rotation.from_rotvec(np.radians(numbers[6:9]) @ own).as_matrix().T
        across = np.linalg.svd(self.axis[None])[2][1:]  # two unit vectors across the axis
        point = self.point + numbers[9:11] @ across
        axis = self.axis + np.tan(np.radians(numbers[11:13])) @ across
        turn = Rotation.from_rotvec(
            (self.angles * (1 + numbers[13] / 100))[:, None] * axis / np.linalg.norm(axis)
        ).as_matrix()
        sources = point + turn @ (source - point)
        if self.turning:
            return Poses(sources, point + turn @ (panel - point), axes @ turn.transpose(0, 2, 1), at.pitch, at.shape)
        n = len(sources)
        return Poses(sources, np.tile(panel, (n, 1)), np.tile(axes, (n, 1, 1)), at.pitch, at.shape)


def rigid_motion(at: Poses, near: Float64) -> RigidMotion:
    """The rotation that views are; its axis is told nearest to a point. Raises `GeometryError` if they are none."""
    k = len(at.source) // 2
    if len(at.source) < 3:
        raise GeometryError(f"rigid: expected at least 3 views, got {len(at.source)}; fit each view by itself")
    still = np.allclose(at.axes, at.axes[k], atol=1e-7) and np.allclose(at.middle, at.middle[k], atol=1e-4)
    size = float(np.linalg.norm(at.source[k] - at.middle[k]))
    motion = _circle(at, k, near) if still else _turning(at, k, near)
    again = motion.poses(np.zeros(len(RIGID)))
    off = max(np.abs(again.source - at.source).max(), np.abs(again.middle - at.middle).max())
    if off > EXACT * size or np.abs(again.axes - at.axes).max() > EXACT:
        raise GeometryError(
            f"rigid: the views are no rotation of the tube about one axis, with its panel or above a still one (off by "
            f"{off:.3g} mm); fit without rigid"
        )
    return motion


def _circle(at: Poses, k: int, near: Float64) -> RigidMotion:
    """Focal spots on a circle, above a panel that stays still."""
    mean = at.source.mean(axis=0)
    _, s, ways = np.linalg.svd(at.source - mean)
    if s[1] < 1e-6 * s[0] or s[0] == 0:
        raise GeometryError("rigid: the focal spots lie on a line, about which no rotation leads; fit without rigid")
    flat = (at.source - mean) @ ways[:2].T
    # |p|² = 2 p·c + (r² − |c|²): linear in the centre c
    answer = np.linalg.lstsq(np.column_stack([2 * flat, np.ones(len(flat))]), (flat**2).sum(axis=1), rcond=None)[0]
    centre = mean + answer[:2] @ ways[:2]
    axis = np.cross(ways[0], ways[1])
    point = centre + axis * ((near - centre) @ axis)
    out = at.source - centre
    first = out[k] / np.linalg.norm(out[k])
    angles = np.arctan2(out @ np.cross(axis, first), out @ first)
    return RigidMotion(at, k, axis, point, _unrolled(angles, k), False)


def _turning(at: Poses, k: int, near: Float64) -> RigidMotion:
    """Source and panel that turn together."""
    turns = np.einsum("vji,jl->vil", at.axes, at.axes[k])  # axes_v = axes_k Rᵀ
    vectors = Rotation.from_matrix(turns).as_rotvec()
    largest = vectors[np.argmax(np.linalg.norm(vectors, axis=1))]
    axis = largest / max(float(np.linalg.norm(largest)), 1e-12)
    angles = _unrolled(vectors @ axis, k)
    # (1 − R) point = middle − R middle_k, for all views
    A = (np.eye(3) - turns).reshape(-1, 3)
    b = (at.middle - turns @ at.middle[k]).reshape(-1)
    point = np.linalg.lstsq(A, b, rcond=1e-8)[0]
    point = point + axis * ((near - point) @ axis)
    return RigidMotion(at, k, axis, point, angles, True)


def _unrolled(angles: Float64, k: int) -> Float64:
    angles = np.unwrap(angles)
    return np.asarray(angles - angles[k])
