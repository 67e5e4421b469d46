"""What is to be found: masses and calcifications at random places, and the length of each ray within them."""

from dataclasses import dataclass

import numpy as np
from scipy.special import beta

from palpate.arrays import Float32, Float64
from palpate.scans.views import Views
from palpate.studies.detection.breast import Breast, places_inside
from palpate.studies.detection.config import MASS, Setting

POWER = 1.5  # of a mass's profile (1 - r²/R²)^POWER (Burgess, Jacobson & Judy, Med. Phys. 28:419, 2001)
MARGIN = 5.0  # mm of signals and places without, below the skin
APART = 4.0, 11.0  # mm across between two calcifications, and between two masses
BESIDE = 7.0  # mm across between a mass and a calcification
TRIES = 4000
SUBRAYS = 6  # along a pixel's side


@dataclass(frozen=True, eq=False)
class Signals:
    """centre: (n, 3) mm. size: (n,) names, "mass" or the diameter of a calcification. diameter: (n,) mm."""

    centre: Float64
    size: list[str]
    diameter: Float64


def size_name(diameter: float) -> str:
    """Of a calcification."""
    return f"{diameter:g} mm"


def random_signals(breast: Breast, setting: Setting, rng: np.random.Generator) -> Signals:
    """Masses, then calcifications of all sizes, as many as the setting asks for or as have room."""
    calcifications = [(size_name(d), d, setting.calcifications) for d in setting.sizes]
    low, high = breast.grid.bounds
    places = np.zeros((0, 3))
    names: list[str] = []
    diameters: list[float] = []
    for wanted in ([(MASS, setting.mass[0], setting.masses)], calcifications):
        for _ in range(TRIES):
            left = [(name, d) for name, d, most in wanted if names.count(name) < most]
            if not left:
                break
            name, diameter = left[rng.integers(len(left))]
            point = rng.uniform(low, high)
            if not places_inside(breast, point[None], MARGIN)[0]:
                continue
            gaps = np.linalg.norm(places[:, :2] - point[:2], axis=1)
            needed = [BESIDE if (n == MASS) != (name == MASS) else APART[name == MASS] for n in names]
            if (gaps > needed).all():
                places, names, diameters = np.vstack([places, point]), [*names, name], [*diameters, diameter]
    return Signals(places, names, np.array(diameters))


def places_without_signal(breast: Breast, setting: Setting, rng: np.random.Generator) -> Float64:
    """(n, 3) mm: a lattice in random position, the places as far below the skin as signals are."""
    low, high = breast.grid.bounds
    step = setting.lattice * np.array([1.0, 1.0, 2.0])  # images are blurred in depth
    axes = [np.arange(a + rng.uniform(0, s), b, s) for a, b, s in zip(low, high, step, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points + rng.uniform(-0.5, 0.5, points.shape)
    return points[places_inside(breast, points, MARGIN)]


def added_lengths(signals: Signals, views: Views, shape: tuple[int, int, int]) -> tuple[Float32, Float32]:
    """(views, rows, columns) each, mm, means over each pixel: of gland in place of fat in masses, of calcification."""
    masses, calcified = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    sub = (np.arange(SUBRAYS) + 0.5) / SUBRAYS - 0.5
    for k, (source, panel) in enumerate(zip(views.source, views.panels, strict=True)):
        for centre, name, diameter in zip(signals.centre, signals.size, signals.diameter, strict=True):
            radius = diameter / 2
            v, u = views[k].project([centre])[0, 0]
            grown = 1.3 * radius / np.array(panel.pitch) + 2
            first = np.maximum(np.floor([v, u] - grown), 0).astype(int)
            last = np.minimum(np.ceil([v, u] + grown) + 1, panel.shape).astype(int)
            if (first >= last).any():
                continue
            rows, columns = ((np.arange(a, b)[:, None] + sub).ravel() for a, b in zip(first, last, strict=True))
            points = panel.points(np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2))
            rays = points - source
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            square = np.square(np.cross(centre - source, rays)).sum(axis=1)  # of the distance from ray to centre
            rest = np.maximum(1 - square / radius**2, 0)
            chord = 2 * radius * np.sqrt(rest)
            length = chord if name != MASS else radius * beta(0.5, POWER + 1) * rest ** (POWER + 0.5)
            n = last - first
            mean = length.reshape(n[0], SUBRAYS, n[1], SUBRAYS).mean(axis=(1, 3))
            (masses if name == MASS else calcified)[k, first[0] : last[0], first[1] : last[1]] += mean.astype(
                np.float32
            )
    return masses, calcified
