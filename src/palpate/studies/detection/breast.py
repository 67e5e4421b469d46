"""A random breast under compression: gland and fat of power-law texture, Cooper's ligaments, skin.

The spectrum of mammograms falls as 1/f³ (Burgess, Jacobson & Judy, Med. Phys. 28:419, 2001).
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft

from palpate.arrays import Bool, Float32, Float64
from palpate.scans.scatter.monte_carlo import Part
from palpate.studies.detection.config import GAP, Kind
from palpate.volumes.grid import Grid

SKIN = 1.5  # mm
SLOPE = 3.0  # power falls as frequency to this power
LARGEST = 40.0  # mm: wavelengths beyond it have no more power
SHARP = 0.25  # standard deviations of the texture over which gland goes over into fat
SHEET, FOLDS, SHEETS = 0.5, 12.0, 0.8  # ligaments: thickness mm, wavelength mm, share of gland in them
ROUND = 1.6  # upright radius of the ellipsoid that is cut by the plates, over half the compressed thickness


@dataclass(frozen=True, eq=False)
class Breast:
    """tissue: share of each voxel that is breast; gland: share of it that is gland, the rest is fat; (z, y, x)."""

    grid: Grid
    tissue: Float32
    gland: Float32
    depth: Float32  # mm below the skin's surface, or to the plates


def random_breast(kind: Kind, fine: float, rng: np.random.Generator) -> Breast:
    """A breast of a kind in voxels of `fine` mm, chest wall at y = 0, plates at z = GAP and GAP + thick."""
    size = np.array([kind.thick, kind.out, 2 * kind.across])
    shape = np.ceil(size / fine).astype(int)
    grid = Grid(shape, (fine,) * 3, origin=(-kind.across + fine / 2, fine / 2, GAP + fine / 2))
    depth = depth_below_surface(kind, grid)
    tissue = np.clip(depth / fine + 0.5, 0, 1).astype(np.float32)
    inside = depth > SKIN
    texture = random_field(grid, SLOPE, LARGEST, rng)
    texture += (0.04 * np.minimum(depth, 25)).astype(np.float32)  # gland is rarer below the skin
    level = float(np.quantile(texture[inside], 1 - kind.glandular))
    gland = 1 / (1 + np.exp(-(texture - level) / (SHARP * texture[inside].std())))
    folds = random_field(grid, 12.0, FOLDS, rng)
    across = np.sqrt(sum(np.square(g) for g in np.gradient(folds, fine)))
    away = np.abs(folds) / np.maximum(across, 1e-6)  # mm from the nearest sheet, about
    gland = np.maximum(gland, SHEETS * np.exp(-((away / (SHEET / 2)) ** 2)))
    gland[~inside] = 1.0  # skin weakens X-rays as gland does
    return Breast(grid, tissue, gland.astype(np.float32), depth.astype(np.float32))


def depth_below_surface(kind: Kind, grid: Grid) -> Float64:
    """(z, y, x): mm, positive inside: from the distance to the ellipsoid, to first order, and that to the plates."""
    z = (grid.axis("z") - GAP - kind.thick / 2)[:, None, None]
    y, x = grid.axis("y")[:, None], grid.axis("x")
    radii = kind.across, kind.out, ROUND * kind.thick / 2
    s = np.sqrt((x / radii[0]) ** 2 + (y / radii[1]) ** 2 + (z / radii[2]) ** 2)
    slope = np.sqrt((x / radii[0] ** 2) ** 2 + (y / radii[1] ** 2) ** 2 + (z / radii[2] ** 2) ** 2) / np.maximum(
        s, 1e-9
    )
    return np.asarray(np.minimum((1 - s) / np.maximum(slope, 1e-9), kind.thick / 2 - np.abs(z)))


def random_field(grid: Grid, slope: float, largest: float, rng: np.random.Generator) -> Float32:
    """Gaussian, mean 0, deviation 1; power ∝ (f² + 1/largest²)^(-slope/2), periodic, (z, y, x)."""
    noise = fft.rfftn(rng.standard_normal(grid.shape, dtype=np.float32), workers=2)
    f = [fft.fftfreq(n, d) for n, d in zip(grid.shape[:2], grid.spacing[:2], strict=True)]
    across = fft.rfftfreq(grid.shape[2], grid.spacing[2])
    square = f[0][:, None, None] ** 2 + f[1][:, None] ** 2 + across**2
    noise *= ((square + largest**-2) ** (-slope / 4)).astype(np.float32)
    field = fft.irfftn(noise, grid.shape, workers=2)
    return np.asarray((field - field.mean()) / field.std(), np.float32)


def places_inside(breast: Breast, points: Float64, margin: float) -> Bool:
    """(points,): whether each lies at least `margin` mm below the surface, and off the chest wall."""
    at = np.round((points - breast.grid.origin) / breast.grid.spacing[0]).astype(int)
    within = ((at >= 0) & (at < breast.grid.shape[::-1])).all(axis=1) & (points[:, 1] > margin)
    x, y, z = np.where(within[:, None], at, 0).T
    return np.asarray(within & (breast.depth[z, y, x] > margin))


def scattering_body(kind: Kind) -> list[Part]:
    """The breast as its Monte Carlo takes it: an ellipsoid of fat, cut by the plates, with a core of fat and gland.

    The core has as much gland as the breast, half in equal parts. It goes on beyond the chest wall.
    """
    middle = GAP + kind.thick / 2
    radii = kind.across, kind.out, ROUND * kind.thick / 2
    share = min(1.0, 2 * kind.glandular) ** (1 / 3)
    low, high = (-kind.across, -kind.out, GAP), (kind.across, kind.out, GAP + kind.thick)
    core = share * radii[0], share * radii[1], share * kind.thick / 2
    return [
        Part("adipose", low, high, (0.0, 0.0, middle), radii),
        Part("breast", low, high, (0.0, 0.0, middle), core),
    ]
