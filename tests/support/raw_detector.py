"""A panel that reads raw: planted dark, gain, heel, lag, dead pixels and lines, doses. Shares no code with the correction."""

from dataclasses import dataclass, replace

import numpy as np

import palpate as pp


@dataclass(frozen=True, eq=False)
class RawDetector:
    """What each pixel does to photons, and how the tube's beam is uneven."""

    dark: np.ndarray  # digital units
    gain: np.ndarray  # digital units a photon
    dead: np.ndarray  # True where the pixel reads its dark alone, or a stuck value
    heel: float  # change of the beam from one edge to the middle, along rows
    lag: float  # of the first order
    noise: float  # of the read-out, digital units

    def read(self, photons, rng=None, lag=True):
        """Frames (n, rows, columns) of one sequence, the panel at rest before; without rng no read-out noise."""
        charge = self.gain * np.asarray(photons, float)
        n = len(charge)
        seen = charge
        if lag and self.lag:  # by the sum itself: y(k) = (1 - s) sum over j of s^j x(k - j)
            seen = np.stack([sum((1 - self.lag) * self.lag**j * charge[k - j] for j in range(k + 1)) for k in range(n)])
        read = self.dark + np.where(self.dead, 0, seen)
        if rng is not None:
            read = read + self.noise * rng.standard_normal(read.shape)
        return np.maximum(read, 0)


def planted(shape, seed, units=2.0, heel=0.1, lag=0.03, noise=4.0, dead=0.01, lines=5):
    """A panel drawn from a seed: gain within ±20 %, dark of 300 ± 30, dead pixels and lines."""
    rng = np.random.default_rng(seed)
    gain = units * rng.uniform(0.8, 1.2, shape)
    dark = 300 + 30 * rng.standard_normal(shape)
    broken = rng.random(shape) < dead
    for k in range(lines):
        axis = k % 2
        line = rng.integers(0, shape[axis])
        broken[(line, slice(None)) if axis == 0 else (slice(None), line)] = True
    return RawDetector(dark, gain, broken, heel, lag, noise)


def heel_of(shape, size):
    """(rows, columns): 1 + size on one edge, 1 - size on the other, not quite linear."""
    v = np.linspace(-1, 1, shape[0])[:, None]
    return np.broadcast_to(1 + size * (v + 0.15 * (v**2 - 1 / 3)), shape)


def rigid_views(shape, pitch, count):
    """Tube and panel turn together, so one flat serves all."""
    return pp.rotating_views(
        pp.Panel(shape, (pitch, pitch), (-(shape[1] - 1) / 2 * pitch, -(shape[0] - 1) / 2 * pitch, -100)),
        np.linspace(-20, 20, count),
        source=(0, 0, 900),
        pivot=(0, 0, 0),
    )


@dataclass(frozen=True, eq=False)
class RawCase:
    """Raw frames and what they were made of."""

    raw: np.ndarray
    dark: np.ndarray
    flat: np.ndarray
    detector: RawDetector
    views: pp.Views
    dose: np.ndarray
    clean: pp.Scan  # the same photons, counted by a perfect panel
    expected: np.ndarray  # photons without noise
    incident: np.ndarray

    def but(self, **changes):
        return replace(self, **changes)


def raw_case(seed, shape=(96, 120), pitch=2.0, count=9, photons=20_000, frames=20, noise=True, doses=True, **of_panel):
    """A body in the beam of a planted panel; the beam: heel and inverse square law on a panel fixed to the tube."""
    rng = np.random.default_rng([seed, 1])
    detector = planted(shape, seed, **of_panel)
    views = rigid_views(shape, pitch, count)
    wide = shape[1] * pitch
    body = pp.Phantom(
        [
            (pp.Ellipsoid((0, 0, 0), (0.3 * wide, 0.24 * wide, 40)), 0.02),
            (pp.Ellipsoid((0.1 * wide, 0.05 * wide, 10), 0.05 * wide), 0.02),
        ]
    )
    panel, source = views.panels[0], views.source[0]
    rows, columns = np.indices(shape)
    places = panel.points(np.stack([rows.ravel(), columns.ravel()], 1)).reshape(*shape, 3)
    ray = places - source
    fall = np.abs(ray @ panel.normal) / np.linalg.norm(ray, axis=-1) ** 3
    beam = photons * fall / fall.max() * heel_of(shape, detector.heel)
    dose = rng.uniform(0.9, 1.1, count) if doses else np.ones(count)
    incident = beam * dose[:, None, None]
    expected = pp.simulate_scan(body, views, incident, None).counts.astype(float)
    seen = rng.poisson(expected).astype(float) if noise else expected
    flats = np.broadcast_to(beam, (frames, *shape))
    flats = rng.poisson(flats).astype(float) if noise else flats
    read = rng if noise else None
    return RawCase(
        raw=detector.read(seen, read),
        dark=detector.read(np.zeros((frames, *shape)), read),
        flat=detector.read(flats, read),
        detector=detector,
        views=views,
        dose=dose,
        clean=pp.Scan(seen, incident, views),
        expected=expected,
        incident=incident,
    )
