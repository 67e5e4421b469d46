"""Nine numbers a view by which its focal spot and its panel move, and what that does to the shadows of points."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.arrays import Float64
from palpate.errors import GeometryError
from palpate.scans.views import Panel, Views

# Directions are those of the panel; rotations are about its middle. Millimetres, then degrees.
PARAMETERS = (
    "source along the row axis",
    "source along the column axis",
    "source away from the panel",
    "panel along the row axis",
    "panel along the column axis",
    "panel towards the source",
    "panel tilted about the row axis",
    "panel tilted about the column axis",
    "panel turned in its plane",
)
UNITS = ("mm",) * 6 + ("degrees",) * 3


@dataclass(frozen=True, eq=False)
class Poses:
    """Views as arrays: source and middle of the panel (views, 3) mm; axes (views, 3, 3): rows' and columns' direction, and
    the normal to the source; pitch (views, 2) mm; shape of the panel."""

    source: Float64
    middle: Float64
    axes: Float64
    pitch: Float64
    shape: tuple[int, int]


def poses(views: Views) -> Poses:
    """The views as arrays. Raises `GeometryError` for a parallel beam, whose focal spot no shadow tells."""
    if views.parallel.any():
        raise GeometryError(
            f"view {int(np.flatnonzero(views.parallel)[0])} has a parallel beam; only cone beams are calibrated"
        )
    shape = views.panels[0].shape
    middle = np.array([p.points([(n - 1) / 2 for n in shape])[0] for p in views.panels])
    normal = np.array([p.normal for p in views.panels])
    normal *= np.sign(np.einsum("ki,ki->k", views.source - middle, normal))[:, None]
    axes = np.stack([[p.row_axis for p in views.panels], [p.column_axis for p in views.panels], normal], axis=1)
    return Poses(views.source, middle, axes, np.array([p.pitch for p in views.panels]), shape)


def views_of(at: Poses, like: Views) -> Views:
    """The arrays as views, with the patient directions of `like`."""
    half = (np.array(at.shape) - 1) / 2
    panels = []
    for middle, axes, pitch in zip(at.middle, at.axes, at.pitch, strict=True):
        corner = middle - half[0] * pitch[0] * axes[0] - half[1] * pitch[1] * axes[1]
        panels.append(Panel(at.shape, pitch, corner, axes[0], axes[1]))
    still = bool((at.middle == at.middle[0]).all() and (at.axes == at.axes[0]).all())
    return Views(at.source, panels[0] if still else panels, like.direction)


def moved(at: Poses, parameters: Float64) -> Poses:
    """The poses after moves (views, 9) in mm and degrees, in the order of `PARAMETERS`."""
    source = at.source + np.einsum("kj,kji->ki", parameters[:, :3], at.axes)
    middle = at.middle + np.einsum("kj,kji->ki", parameters[:, 3:6], at.axes)
    turn = Rotation.from_rotvec(np.einsum("kj,kji->ki", np.radians(parameters[:, 6:]), at.axes)).as_matrix()
    return Poses(source, middle, np.einsum("kij,klj->kli", turn, at.axes), at.pitch, at.shape)


def shadows(at: Poses, points: Float64) -> Float64:
    """(views, N, 2): fractional row and column where rays through points (N, 3) mm meet each panel."""
    ray = points - at.source[:, None]
    gap = at.middle - at.source
    reach = np.einsum("ki,ki->k", gap, at.axes[:, 2])[:, None] / np.einsum("kni,ki->kn", ray, at.axes[:, 2])
    hit = reach[..., None] * ray - gap[:, None]
    half = (np.array(at.shape) - 1) / 2
    return np.asarray(np.einsum("kni,kji->knj", hit, at.axes[:, :2]) / at.pitch[:, None] + half)


def shadow_slopes(at: Poses, points: Float64, parameters: Float64, step: float = 1e-3) -> Float64:
    """(views, N, 2, 9): pixels that a shadow moves for each mm and degree, at moves (views, 9), by central differences."""
    columns = []
    for j in range(len(PARAMETERS)):
        ahead, behind = parameters.copy(), parameters.copy()
        ahead[:, j] += step
        behind[:, j] -= step
        columns.append((shadows(moved(at, ahead), points) - shadows(moved(at, behind), points)) / (2 * step))
    return np.stack(columns, axis=-1)
