"""Rectification: resamples views of tilted panels to panels parallel to the slices."""

import numpy as np
from scipy.ndimage import map_coordinates

from palpate.arrays import Bool, Float32
from palpate.reconstruction.projector import Projector
from palpate.scans.views import Panel, Views


def rectify(A: Projector, p: Float32, measured: Bool) -> tuple[Projector, Float32, Bool]:
    """Projector, line integrals and measured pixels on panels parallel to the slices; as they are if all panels are so.

    Rays stay what they are: a plane through which the same rays pass takes their values, by linear interpolation
    between pixels. A new pixel counts as measured if all that it is made of is.
    """
    panels = A.views.panels
    if all(abs(abs(panel.normal[2]) - 1) < 1e-9 for panel in panels):
        return A, p, measured
    floor = min(A.grid.bounds[0, 2], *(float(_corners(panel)[:, 2].min()) for panel in panels))
    boxes, pitches = [], []
    for source, panel in zip(A.views.source, panels, strict=True):
        rays = _corners(panel) - source
        landed = source + (floor - source[2]) / rays[:, 2:] * rays
        boxes.append((landed[:, :2].min(axis=0), landed[:, :2].max(axis=0)))
        pitches.append(min(panel.pitch) * (floor - source[2]) / rays[:, 2].mean())
    pitch = float(np.mean(pitches))
    columns, rows = np.ceil(np.max([high - low for low, high in boxes], axis=0) / pitch).astype(int)
    level = [Panel((rows, columns), (pitch, pitch), (*(low + pitch / 2), floor)) for low, _ in boxes]
    views = Views(A.views.source, level)
    values, known = np.empty(views.shape, np.float32), np.empty(views.shape, bool)
    r, c = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    pixels = np.stack([r.ravel(), c.ravel()], axis=1)
    for k, panel in enumerate(level):
        at = A.views[k].project(panel.points(pixels))[0].T
        values[k] = map_coordinates(p[k], at, order=1, mode="nearest").reshape(panel.shape)
        share = map_coordinates(measured[k].astype(np.float32), at, order=1, mode="constant")
        known[k] = (share > 1 - 1e-3).reshape(panel.shape)
    return Projector(views, A.grid, A.tolerance), values, known


def _corners(panel: Panel) -> np.ndarray:
    rows, columns = panel.shape
    return panel.points([(r, c) for r in (-0.5, rows - 0.5) for c in (-0.5, columns - 0.5)])
