"""Random bodies before views whose panels are shifted, each view for itself."""

import numpy as np

import palpate as pp


def shifted_case(seed, motion):
    """Views, a random body, its grid, and shifts of the panels in mm."""
    rng = np.random.default_rng(seed)
    if motion == "rotating":
        panel = pp.Panel((120, 120), (1.5, 1.5), (-89.25, -89.25, -100))
        views = pp.rotating_views(panel, np.linspace(-20, 20, 11), source=(0, 0, 800))
        grid = pp.Grid((24, 80, 70), (4, 1.5, 1.5), (-51.75, -59.25, -46))
        low, high = np.array([(-40, -45, -35), (40, 45, 35)])
    elif motion == "arc":
        panel = pp.Panel((120, 140), (1.0, 1.0), (-69.5, -59.5, 0))
        views = pp.arc_views(panel, np.linspace(-22, 22, 11), radius=600, pivot=(0, 0, 30))
        grid = pp.Grid((14, 90, 105), (4, 1, 1), (-52, -44.5, 2))
        low, high = np.array([(-45, -38, 8), (45, 38, 48)])
    else:
        views = pp.orbit_views((110, 120), (1.6, 1.6), source_to_centre=600, source_to_panel=900, count=24, arc=200)
        grid = pp.Grid((60, 66, 66), (1.5, 1.5, 1.5), (-48.75, -48.75, -44.25))
        low, high = np.array([(-40, -40, -35), (40, 40, 35)])
    middle, half = (low + high) / 2, (high - low) / 2
    largest = rng.uniform(0.9, 1.6)
    shifts = rng.uniform(-largest, largest, (len(views), 2)) * views.panels[0].pitch[0]
    parts = [(pp.Ellipsoid(middle, half * 1.15), 0.012)]
    for _ in range(30):
        centre = middle + rng.uniform(-0.7, 0.7, 3) * half
        parts.append((pp.Ellipsoid(centre, rng.uniform(2, 8, 3)), rng.uniform(-0.008, 0.015)))
    return views, pp.Phantom(parts), grid, shifts
