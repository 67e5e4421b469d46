"""The elastic half space in closed form: pressures on a disc of radius 1 mm (K. L. Johnson, Contact Mechanics, ch. 3).

The solid is z < 0, pushed down. Nothing here knows of finite elements.
"""

import numpy as np

YOUNG, POISSON = 5.0e-3, 0.3  # N/mm²
SOFT = (1 - POISSON**2) / YOUNG
# Pressure in N/mm² at ρ² = q < 1, its force in N, and how far the disc's centre sinks, mm.
PRESSURE = {
    "kernel": (lambda q: (1 - q) ** 2, np.pi / 3, 16 / 15 * SOFT),  # that of our contacts
    "Hertz": (lambda q: np.sqrt(1 - q), 2 * np.pi / 3, np.pi / 2 * SOFT),
    "Love": (lambda q: np.ones_like(q), np.pi, 2 * SOFT),  # uniform
}


def pressure(kind, x, y):
    """N/mm² at (x, y), 0 off the disc."""
    q = x**2 + y**2
    return np.where(q < 1, PRESSURE[kind][0](np.minimum(q, 1)), 0)


def point_force(x):
    """Boussinesq's displacement (3, n) mm at x (3, n) for 1 N down at the origin."""
    X, Y, Z = x[0], x[1], -x[2]
    R = np.sqrt(X**2 + Y**2 + Z**2)
    by = (1 + POISSON) / (2 * np.pi * YOUNG)
    along = by * (Z / R**3 - (1 - 2 * POISSON) / (R * (R + Z)))
    return np.stack([along * X, along * Y, -by * (Z**2 / R**3 + 2 * (1 - POISSON) / R)])


def _gauss(low, high, n):
    x, w = np.polynomial.legendre.leggauss(n)
    return low + (x + 1) * (high - low) / 2, w * (high - low) / 2


def displacement(kind, x, rings=8, spokes=16):
    """(3, n) mm at points off the disc: point forces added up over it."""
    theta, w = _gauss(0, np.pi / 2, rings)  # ρ = sin θ is at ease with the root at Hertz's rim
    out = np.zeros_like(x)
    for rho, part in zip(np.sin(theta), w * np.cos(theta) * np.sin(theta), strict=True):
        for phi in np.arange(spokes) * 2 * np.pi / spokes:
            at = rho * np.array([[np.cos(phi)], [np.sin(phi)], [0]])
            out += 2 * np.pi / spokes * part * pressure(kind, rho, 0) * point_force(x - at)
    return out


def sinking(kind, rho):
    """mm by which the surface sinks at a distance rho < 1 mm: ∫ p/s dA in polar coordinates about the point there."""
    total, spokes = 0.0, 200
    theta, w = _gauss(-np.pi / 2, np.pi / 2, 40)
    for phi in (np.arange(spokes) + 0.5) * np.pi / spokes:
        half = np.sqrt(1 - (rho * np.sin(phi)) ** 2)  # of the chord through the point
        s = half * np.sin(theta) - rho * np.cos(phi)
        p = pressure(kind, rho + s * np.cos(phi), s * np.sin(phi))
        total += np.pi / spokes * float(w * half * np.cos(theta) @ p)
    return SOFT / np.pi * total


def compliance(kind):
    """mm/N: how far the pressure's own weighted mean sinks, per force."""
    theta, w = _gauss(0, np.pi / 2, 24)
    rho = np.sin(theta)
    work = sum(
        2 * np.pi * part * r * float(pressure(kind, r, 0)) * sinking(kind, r)
        for part, r in zip(w * np.cos(theta), rho, strict=True)
    )
    return work / PRESSURE[kind][1] ** 2
