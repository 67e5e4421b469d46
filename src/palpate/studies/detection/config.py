"""What is scanned, how, and how often; and what MAP has to reach: the full study, and a small one for tests."""

from dataclasses import dataclass

import numpy as np

from palpate.scans.trajectories import arc_views
from palpate.scans.views import Panel, Views
from palpate.volumes.grid import Grid

KV, BEAM, GRID = 30.0, "W/Rh", "none"
GAP = 15.0  # mm from the panel to the breast
RADIUS = 650.0  # mm of the arc of focal spots about the panel's edge at the chest wall
SHIFT = (0.07, 0.11, 0.0)  # mm in x, y, z: voxels lie otherwise than those of the breast, slices between the plates
MARGIN = 6.0  # mm of air in the images
WIDTH = 1.3  # resolution of what is judged, in voxels across
FALSE = 1e-3  # of the places without a signal that an observer may take for one
RESAMPLES = 1000  # of the bootstrap
SLACK = 0.05  # how far the lower end of a 95 % interval may lie below a target that is met
MASS, CALCIFICATION = "mass", "calcification"


@dataclass(frozen=True)
class Kind:
    """A kind of breast. glandular: share of gland in its inside. across: half its width; out: from the chest wall to the
    nipple; thick: compressed; all mm."""

    name: str
    glandular: float
    across: float
    out: float
    thick: float


@dataclass(frozen=True)
class Target:
    """What MAP by resolution must reach against the best rival. measure: of `measures`. ratio: or else a difference. low: at
    the lowest dose, if another."""

    measure: str
    least: float
    ratio: bool = True
    low: float | None = None


# RMSE counts as its inverse, so that more is better in every line. Committed before the run that they judge.
TARGETS = (
    Target("mass d_A", 0.96),
    Target("0.3 mm d_A", 1.10),
    Target("0.4 mm d_A", 1.0),
    Target("mass found", -0.05, ratio=False, low=0.0),
    Target("0.3 mm found", -0.05, ratio=False, low=0.0),
    Target("0.4 mm found", -0.05, ratio=False, low=0.0),
    Target("1 / RMSE", 1 / 0.95),
)


@dataclass(frozen=True)
class Setting:
    """quick: the small one. kinds: of breasts. seeds: breasts a kind. doses: quanta that a pixel counts without a breast.

    fine: mm, a voxel of the breast. voxel, slice_: mm, of the images. pixel: mm. angles: of the views, degrees.
    masses, calcifications: places a breast, at most; of each size. mass: diameter, mm, and the gland that it adds in its
    middle. sizes: diameters of calcifications, mm. lattice: mm between places without a signal. scatter: photons of each
    Monte Carlo.
    """

    quick: bool
    kinds: tuple[Kind, ...]
    seeds: int
    doses: tuple[int, ...]
    fine: float
    voxel: float
    slice_: float
    pixel: float
    angles: tuple[float, ...]
    masses: int
    calcifications: int
    mass: tuple[float, float]
    sizes: tuple[float, ...]
    lattice: float
    scatter: int

    def views(self, kind: Kind) -> Views:
        """Focal spots on an arc above the chest wall's edge of a panel that shows air on the other three sides."""
        half = kind.across * 1.1 + (GAP + kind.thick) * np.tan(np.radians(max(np.abs(self.angles)))) * 1.1
        columns, rows = int(2 * half / self.pixel), int(1.2 * kind.out / self.pixel)
        corner = (-columns * self.pixel / 2 + self.pixel / 2, self.pixel / 2, 0.0)
        panel = Panel((rows, columns), (self.pixel, self.pixel), corner)
        return arc_views(panel, self.angles, radius=RADIUS)

    def grid(self, kind: Kind) -> Grid:
        """The voxels of the images: between the plates, with air beside the breast, and as far as the panel sees."""
        low = np.array([-kind.across - MARGIN, -1.0, GAP]) + SHIFT
        size = np.array([2 * (kind.across + MARGIN), kind.out + MARGIN + 1, kind.thick])
        spacing = np.array([self.voxel, self.voxel, self.slice_])
        return Grid(np.ceil(size / spacing)[::-1], spacing[::-1], origin=low + spacing / 2)


FULL = Setting(
    quick=False,
    kinds=(
        Kind("fatty", 0.12, 46.0, 58.0, 44.0),
        Kind("scattered", 0.25, 44.0, 54.0, 38.0),
        Kind("dense", 0.45, 42.0, 50.0, 32.0),
    ),
    seeds=7,
    doses=(2500, 8000, 25000),
    fine=0.25,
    voxel=0.4,
    slice_=1.0,
    pixel=0.4,
    angles=tuple(np.linspace(-20, 20, 15).tolist()),
    masses=16,
    calcifications=17,
    mass=(5.0, 0.4),
    sizes=(0.3, 0.4),
    lattice=3.0,
    scatter=8_000_000,
)
QUICK = Setting(
    quick=True,
    kinds=(Kind("scattered", 0.25, 26.0, 32.0, 20.0),),
    seeds=3,
    doses=(2500, 25000),
    fine=0.5,
    voxel=0.6,
    slice_=2.0,
    pixel=0.5,
    angles=(-16.0, -8.0, 0.0, 8.0, 16.0),
    masses=4,
    calcifications=6,
    mass=(5.0, 0.4),
    sizes=(0.3, 0.4),
    lattice=2.0,
    scatter=200_000,
)
