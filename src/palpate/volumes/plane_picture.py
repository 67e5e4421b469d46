"""The one way in which a plane of a volume is drawn: as radiologists look at a patient, letters at its edges."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable

from palpate.arrays import AnyArray, ArrayLike, Int32, Int64, float64
from palpate.errors import DataError
from palpate.volumes.grid import Grid
from palpate.volumes.notebook_figure import draw_image, title, write_on
from palpate.volumes.patient_axes import VoxelImage, has_patient_axes, patient_grid, patient_view

PIXELS = 400  # along each side of a plane; more are not seen
PLANES = ((0, 1, 2), (1, 0, 2), (2, 0, 1))  # the axis cut, then those down and across
ENDS = {True: (("I", "S"), ("A", "P"), ("R", "L")), False: (("−z", "+z"), ("−y", "+y"), ("−x", "+x"))}
OUTLINES = ("#2a9d8f", "#e76f51", "#e9c46a", "#457b9d")


def draw_plane(
    frame: Axes,
    volume: VoxelImage,
    at: ArrayLike,
    cut: int,
    window: tuple[float, float],
    *,
    labels: Int32 | None = None,
    reach: float | None = None,
    y_up: bool = False,
    words: str | None = None,
) -> ScalarMappable:
    """Draw the plane through point `at` (3,) mm in a frame of `plane_size`.

    The patient's right is on the left, the front or the head above, however the file stores the volume; without a
    patient, z grows upwards. cut: 0, 1 or 2 for the plane across z, y or x. labels: (z, y, x) on the volume's grid, to be
    outlined. reach: mm shown on either side of the point. y_up: y grows upwards too. words: the title, instead of the
    position. Raises `DataError` if the point is outside.
    """
    grid, (index, spans) = patient_grid(volume.grid), _shown(volume.grid, at, reach)
    _, down, across = PLANES[cut]
    upwards = down == 0 or y_up

    def plane(values: AnyArray) -> AnyArray:
        whole = np.take(patient_view(values, volume.grid), index[cut], axis=cut)[spans[down], spans[across]]
        rows, columns = (-(-n // PIXELS) for n in whole.shape)
        seen: AnyArray = whole[:: -rows if upwards else rows, ::columns]
        return seen

    size = plane_size(volume.grid, at, cut, reach)
    picture = draw_image(frame, plane(volume.values), size, window)
    if labels is not None:
        shown = plane(labels)
        for value in np.unique(shown[shown != 0]):
            colour = OUTLINES[(int(value) - 1) % len(OUTLINES)]
            extent = (0, size[0], size[1], 0)
            frame.contour(shown == value, levels=[0.5], colors=[colour], linewidths=1.1, origin="upper", extent=extent)
    place = grid.points(index)[0]
    title(frame, f"{'zyx'[cut]} = {place[2 - cut]:.1f} mm" if words is None else words)
    ends = ENDS[has_patient_axes(volume)]
    (left, right), (above, below) = ends[across], ends[down][::-1] if upwards else ends[down]
    for letter, x, y, ha, va in (
        (left, 0.02, 0.5, "left", "center"),
        (right, 0.98, 0.5, "right", "center"),
        (above, 0.5, 0.98, "center", "top"),
        (below, 0.5, 0.02, "center", "bottom"),
    ):
        write_on(frame, x, y, letter, ha, va)
    return picture


def plane_size(grid: Grid, at: ArrayLike, cut: int, reach: float | None = None) -> tuple[float, float]:
    """Width and height of a plane, mm."""
    spacing, spans = patient_grid(grid).spacing, _shown(grid, at, reach)[1]
    height, width = ((spans[axis].stop - spans[axis].start) * spacing[axis] for axis in PLANES[cut][1:])
    return width, height


def _shown(grid: Grid, at: ArrayLike, reach: float | None) -> tuple[Int64, list[slice]]:
    """Index (3,) of a point (3,) mm on the grid with the patient's axes, and what is shown along each axis."""
    upright = patient_grid(grid)
    index = np.rint(upright.indices(float64("at", at, (3,)))[0]).astype(np.int64)
    if (index < 0).any() or (index >= upright.shape).any():
        raise DataError(f"at: {np.asarray(at).tolist()} mm lies outside the volume, {upright.bounds.tolist()} mm")
    steps = [n if reach is None else int(reach / d) for n, d in zip(upright.shape, upright.spacing, strict=True)]
    limits = zip(index, steps, upright.shape, strict=True)
    return index, [slice(max(0, int(i - k)), min(n, int(i + k + 1))) for i, k, n in limits]
