"""Moment conditions: what the views of one object have in common, whatever the object is."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Bool, Float64
from palpate.scans.scan import Scan

BORDER = 0.12  # of a view's 95th percentile: line integrals above it at the rim mean a truncated view
DENSE, FEW = 0.15, 0.002  # of the same: the object, not scatter; share of its pixels that noise may have put there
NOISE = 0.03  # of the same: below it a pixel is air


@dataclass(frozen=True, eq=False)
class CentreOfMass:
    """Where the views put the centre of the object: `point` (x, y, z) mm, how far each view is off it (rows, columns),
    pixels, and which views show the whole object; the rest have NaN."""

    point: Float64
    offsets: Float64
    whole: Bool


def whole_views(scan: Scan, l: Float64) -> Bool:
    """(views,): True where a view shows the whole object, with air along its rim and no pixel that was not measured."""
    rims = [np.concatenate([v[[0, -1]].ravel(), v[:, [0, -1]].ravel()]) for v in l]
    tops = np.quantile(l, 0.95, axis=(1, 2))
    clear = [np.quantile(rim, 0.95) < BORDER * top for rim, top in zip(rims, tops, strict=True)]
    return np.asarray(np.array(clear) & scan.mask.all(axis=(1, 2)) & (tops > 0))


def centre_of_mass(scan: Scan, l: Float64, whole: Bool) -> CentreOfMass | None:
    """The point in space whose projections are nearest to the centres of mass of the views, None if fewer than 3 are whole.

    l: line integrals. whole: (views,) which views show the whole object.

    Let τ be the depth of a point below the plane through the source parallel to the panel, at distance D. A pixel at
    (u, v) from the foot of the source, multiplied by D / √(u² + v² + D²), is ∫ f dτ. Since du dv = D²/τ² dx dy,

        ∬ p̃ du dv = ∭ f (D/τ)² dV,    ∬ p̃ u du dv = ∭ f (D/τ)² (D/τ) (x − x_s) dV.

    Where all sources lie in one plane parallel to the panels, τ is the same function of the point in every view. So the
    first integral is constant and the second is linear in the source position x_s: their quotient is the projection of one
    point, the centre of mass with weights (D/τ)². These are the moment conditions of orders 0 and 1 of Helgason and Ludwig
    for cone beams. For sources on an arc they hold up to the change of (D/τ)² over the object, some percent.

    References
    ----------
    Clackdoyle & Desbat, Phys. Med. Biol. 58:8437, 2013 (cone beam, sources in a plane).
    """
    if whole.sum() < 3:
        return None
    rows, columns = scan.shape[1:]
    pixels = np.stack(np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"), axis=-1).reshape(-1, 2)
    centres = np.full((len(l), 2), np.nan)
    for k in np.flatnonzero(whole):
        source, panel = scan.views.source[k], scan.views.panels[k]
        ray = panel.points(pixels) - source
        cosine = np.abs(ray @ panel.normal) / np.linalg.norm(ray, axis=1)
        mass = np.where(l[k] > NOISE * np.quantile(l[k], 0.95), l[k], 0).ravel() * cosine
        centres[k] = mass @ pixels / mass.sum()
    keep = whole.copy()
    point = _nearest_point(scan, centres, keep)
    offsets = centres - scan.views.project(point)[:, 0]
    if whole.sum() > 4:  # once more without the worst, which pulls the point towards itself
        keep[np.nanargmax(np.linalg.norm(offsets, axis=1))] = False
        point = _nearest_point(scan, centres, keep)
        offsets = centres - scan.views.project(point)[:, 0]
    return CentreOfMass(point, offsets, whole)


def outline(scan: Scan, l: Float64, centre: CentreOfMass) -> Float64:
    """(2, 2): lowest and highest (x, y) of the object, mm, by the rays that touch its sides in all whole views."""
    middle = scan.views.project(centre.point)[:, 0]
    sides = np.full((4, len(l), 2), np.nan)
    for k in np.flatnonzero(centre.whole):
        at = np.argwhere(l[k] > DENSE * np.quantile(l[k], 0.95))
        low, high = np.quantile(at, [FEW, 1 - FEW], axis=0)
        (top, left), (bottom, right), (row, column) = low, high, middle[k]
        sides[:, k] = (top, column), (bottom, column), (row, left), (row, right)
    points = np.array([_nearest_point(scan, side, centre.whole) for side in sides])[:, :2]
    return np.array([points.min(axis=0), points.max(axis=0)])


def _nearest_point(scan: Scan, centres: Float64, keep: Bool) -> Float64:
    """(3,) the point with the least squared distance from the rays through the centres."""
    normal, offset = np.zeros((3, 3)), np.zeros(3)
    for k in np.flatnonzero(keep):
        source = scan.views.source[k]
        ray = scan.views.panels[k].points(centres[k])[0] - source
        ray /= np.linalg.norm(ray)
        across = np.eye(3) - np.outer(ray, ray)
        normal += across
        offset += across @ source
    return np.asarray(np.linalg.lstsq(normal, offset, rcond=None)[0])
