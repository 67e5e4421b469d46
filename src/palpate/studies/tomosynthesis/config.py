"""What is scanned, how, and how often: the full study, and a small one for tests."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Float64
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.scans.analytic_phantoms import Phantom, slab_phantom
from palpate.scans.scan import Scan
from palpate.scans.simulate import simulate_scan
from palpate.scans.trajectories import circular_views, hypocycloid_views, linear_views
from palpate.scans.views import Panel, Views
from palpate.volumes.grid import Grid

VIEWS = 8
RADIUS, HEIGHT = 250.0, 1000.0  # mm, of the circle that holds every path of focal spots, and above the panel
MOTIONS = ("circular", "linear", "hypocycloidal")  # the last has three cusps: trispiral
SIDE, THICKNESS = 128.0, 48.0  # mm of the volume, across and in depth
PANEL = 204.8  # mm, a side of the panel
PROFILE_Z, PROFILE_Y = 48.0, 18.0  # mm, where the line profile runs along x
DEPTHS = (38.0, 48.0, 60.0, 70.0)  # mm, slices through the phantom's inserts
REGION = ((8.0, -12.0, 52.0), (48.0, 28.0, 68.0))  # mm, lowest and highest corner of the local reconstruction: the ball
EDGE_PRESERVING = Prior("lange")  # the dissertation's kind of prior, whatever the default is
FIRST = 1000  # seed of the first scan: what is judged, and how, was settled on others
# The faces of the slab must not lie on those of voxels of any level: coarse grids would be flattered.
SHIFT = (0.13, -0.19)  # mm in x and y; in depth slices are centred on whole millimetres


@dataclass(frozen=True)
class Setting:
    """quick: the small one. voxels: across. slices: in depth. doses: photons of the dissertation. curve: of dose curves.

    seeds: scans a dose in the comparisons behind the chapter's claims. few: in those beyond it. reference: iterations by
    which the posterior counts as converged. beyond: most iterations of a run after its stopping rule. passes: of each
    trial of ordered subsets. subrays: a pixel's side, of the simulation.
    """

    quick: bool
    voxels: int
    slices: int
    doses: tuple[int, ...]
    curve: tuple[int, ...]
    seeds: int
    few: int
    reference: int
    beyond: int
    passes: int
    subrays: int

    @property
    def grid(self) -> Grid:
        """Slices centred on whole millimetres where they are 1 mm thick."""
        d, dz = SIDE / self.voxels, THICKNESS / self.slices
        corner = -SIDE / 2 + d / 2
        return Grid(
            (self.slices, self.voxels, self.voxels), (dz, d, d), (corner + SHIFT[0], corner + SHIFT[1], 30.5 + dz / 2)
        )

    def views(self, motion: str) -> Views:
        """Eight focal spots on a path that reaches as far as the circle; the panel stays still, two pixels a voxel."""
        n = 2 * self.voxels
        pitch = PANEL / n
        panel = Panel((n, n), (pitch, pitch), (-PANEL / 2 + pitch / 2, -PANEL / 2 + pitch / 2, 0))
        if motion == "circular":
            return circular_views(panel, radius=RADIUS, height=HEIGHT, count=VIEWS)
        if motion == "hypocycloidal":
            return hypocycloid_views(panel, radius=RADIUS, height=HEIGHT, count=VIEWS)
        return linear_views(panel, length=2 * RADIUS, height=HEIGHT, count=VIEWS)

    def passed(self, motion: str, body: Phantom | None = None) -> Float64:
        """(views, rows, columns) share of the photons that pass the phantom, or another body, along each ray."""
        return np.asarray(
            simulate_scan(body or phantom(), self.views(motion), 1.0, None, subrays=self.subrays).counts, np.float64
        )

    def scan(self, passed: Float64, motion: str, dose: int, seed: int) -> Scan:
        """Poisson counts of `dose` photons a pixel without the phantom."""
        counts = np.random.default_rng([FIRST + seed, dose]).poisson(dose * passed)
        return Scan(counts.astype(np.float32), float(dose), self.views(motion))


FULL = Setting(
    False, 128, 48, (200_000, 20_000, 2_000), (500, 2_000, 6_000, 20_000, 60_000, 200_000), 20, 3, 40, 60, 10, 3
)
QUICK = Setting(True, 32, 12, (2_000,), (2_000, 20_000), 2, 1, 12, 12, 3, 1)


def phantom() -> Phantom:
    """A slab with inserts of other attenuation at four depths."""
    return slab_phantom()
