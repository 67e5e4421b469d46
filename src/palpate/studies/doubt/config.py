"""What is scanned and how; how many breasts teach and how many judge; and what the intervals have to reach."""

from dataclasses import dataclass

import numpy as np

from palpate.scans.trajectories import arc_views
from palpate.scans.views import Panel, Views
from palpate.studies.detection.config import GAP, RADIUS, Kind
from palpate.volumes.grid import Grid

SHIFT = (0.07, 0.11, 0.0)  # mm in x, y, z: voxels of the images lie otherwise than those of the breast
MARGIN = 6.0  # mm of air in the images
LEVEL = 0.9  # of the intervals
# Committed before the run that they judge.
COVERAGE = 0.85, 0.95  # share of the truths that corrected intervals of 90 % hold
WIDTH = 0.80  # median width of corrected intervals over that of the population's own
CALIBRATED = 1.96  # of Spiegelhalter's |z| of the corrected probabilities; their Brier score lies below the base rate's
PUSH, CONTACT = 5.0, 8.0  # mm: depth of the push and radius of the contact
POISSON = 0.45
LUMP, BODY = "breast-carcinoma", "gland"  # tissues whose stiffness is drawn
DIAMETERS, DEPTHS, CONTRASTS = (8.0, 18.0), 26.0, (1.0, 1.4)
"""mm; greatest mm of the centre below the upper plate; lump less fat over gland less fat."""
COVER = 3.0  # mm of tissue between the lump and the plate, at least
LOPSIDED = 0.1  # standard deviation of the logarithm of each radius
INNER = 0.55  # of the outline's ellipse (x / across)² + (y / out)² in which lumps lie
FRONT = 12.0  # mm from the chest wall to the lump's centre, at least
MARK = 2.0  # mm, standard deviation in x and y of the place that a reader marks


@dataclass(frozen=True)
class Setting:
    """quick: the small one. train, judge: breasts. fine: mm, a voxel of the breast. voxel, slice_, pixel: mm, of the scan.

    angles: of the views, degrees. incident: photons a pixel. samples: of each posterior. edge, lump_edge: mm, of the mesh
    from the image, away from the lump and at it. true_edge: mm, of the mesh from the true labels, away from the lump;
    true_fine: edges of its elements across the lump's radius. iterations: of the samples that are compared with first order.
    """

    quick: bool
    kind: Kind
    train: int
    judge: int
    fine: float
    voxel: float
    slice_: float
    pixel: float
    angles: tuple[float, ...]
    incident: float
    samples: int
    edge: float
    lump_edge: float
    true_edge: float
    true_fine: float
    iterations: tuple[int, ...]

    @property
    def views(self) -> Views:
        """Focal spots on an arc above the chest wall's edge of a panel that shows air on the other three sides."""
        half = self.kind.across * 1.1 + (GAP + self.kind.thick) * np.tan(np.radians(max(np.abs(self.angles)))) * 1.1
        columns, rows = int(2 * half / self.pixel), int(1.2 * self.kind.out / self.pixel)
        corner = (-columns * self.pixel / 2 + self.pixel / 2, self.pixel / 2, 0.0)
        return arc_views(Panel((rows, columns), (self.pixel, self.pixel), corner), self.angles, radius=RADIUS)

    @property
    def grid(self) -> Grid:
        """The voxels of the images: between the plates, with air beside the breast."""
        low = np.array([-self.kind.across - MARGIN, -1.0, GAP]) + SHIFT
        size = np.array([2 * (self.kind.across + MARGIN), self.kind.out + MARGIN + 1, self.kind.thick])
        spacing = np.array([self.voxel, self.voxel, self.slice_])
        return Grid(np.ceil(size / spacing)[::-1], spacing[::-1], origin=low + spacing / 2)


FULL = Setting(
    quick=False,
    kind=Kind("scattered", 0.25, 34.0, 42.0, 38.0),
    train=100,
    judge=200,
    fine=1.25,
    voxel=1.6,
    slice_=2.5,
    pixel=1.6,
    angles=tuple(np.linspace(-25, 25, 9).tolist()),
    incident=10_000.0,
    samples=19,
    edge=8.0,
    lump_edge=4.0,
    true_edge=9.0,
    true_fine=2.0,
    iterations=(3, 10, 40),
)
QUICK = Setting(
    quick=True,
    kind=Kind("scattered", 0.25, 26.0, 32.0, 32.0),
    train=3,
    judge=2,
    fine=2.5,
    voxel=2.5,
    slice_=4.0,
    pixel=2.5,
    angles=(-24.0, -12.0, 0.0, 12.0, 24.0),
    incident=10_000.0,
    samples=19,
    edge=14.0,
    lump_edge=7.0,
    true_edge=14.0,
    true_fine=1.5,
    iterations=(3, 5),
)
