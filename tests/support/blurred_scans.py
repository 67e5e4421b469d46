"""Scans of spheres through a real focal spot and a panel that spreads light: shares nothing with the model it judges.

Chords of spheres in closed form, from each of many point sources in the focal spot to points finer than the pixels;
transmissions are added up, blurred by SciPy's Gaussian and summed over pixels.
"""

import numpy as np
from scipy.ndimage import gaussian_filter

import palpate as pp

FINE = 3  # points along a pixel
SPOTS = 5  # point sources along a side of the focal spot
FWHM = 2.354820045  # of a normal distribution, over its standard deviation


def line_integrals(spheres, source, points):
    """(N,) along segments from source (3,) to points (N, 3); spheres: (centre (3,), radius mm, 1/mm)."""
    ray = points - source
    length = np.linalg.norm(ray, axis=1)
    total = np.zeros(len(points))
    for centre, radius, attenuation in spheres:
        nearest = np.linalg.norm(np.cross(ray, centre - source), axis=1) / length
        total += 2 * attenuation * np.sqrt(np.maximum(radius**2 - nearest**2, 0))
    return total


def expected_transmission(spheres, views, panel_fwhm, spot_fwhm):
    """(views, rows, columns): mean share of the open beam, pixel by pixel, in float64."""
    rows, columns = views.shape[1:]
    step = (np.arange(FINE) - (FINE - 1) / 2) / FINE
    r, c = np.meshgrid(
        (np.arange(rows)[:, None] + step).ravel(), (np.arange(columns)[:, None] + step).ravel(), indexing="ij"
    )
    places = np.linspace(-2, 2, SPOTS) * spot_fwhm / FWHM
    weights = np.exp(-0.5 * np.linspace(-2, 2, SPOTS) ** 2)
    weights /= weights.sum()
    if spot_fwhm == 0:
        places, weights = np.zeros(1), np.ones(1)
    else:  # a few points have a little less variance than the distribution whose FWHM is meant
        places = places * spot_fwhm / FWHM / np.sqrt((weights * places**2).sum())
    mean = np.empty(views.shape)
    for k, (source, panel) in enumerate(zip(views.source, views.panels, strict=True)):
        points = panel.points(np.stack([r.ravel(), c.ravel()], axis=1))
        fine = np.zeros(r.size)
        for a, wa in zip(places, weights, strict=True):
            for b, wb in zip(places, weights, strict=True):
                spot = source + a * panel.row_axis + b * panel.column_axis
                fine += wa * wb * np.exp(-line_integrals(spheres, spot, points))
        sigma = panel_fwhm / FWHM * FINE / np.array(panel.pitch)
        blurred = gaussian_filter(fine.reshape(r.shape), sigma, mode="nearest", truncate=6)
        mean[k] = blurred.reshape(rows, FINE, columns, FINE).mean(axis=(1, 3))
    return mean


def magnifying_scan(spheres, photons=4000.0, background=100.0, panel_fwhm=0.3, spot_fwhm=0.4, seed=0, side=40):
    """16 views at magnification 2 around the z axis on pixels of 0.2 mm; noise free where the seed is None."""
    views = pp.orbit_views((side, side), (0.2, 0.2), source_to_centre=60, source_to_panel=120, count=16, arc=200)
    mean = photons * expected_transmission(spheres, views, panel_fwhm, spot_fwhm) + background
    counts = mean if seed is None else np.random.default_rng(seed).poisson(mean)
    blur = pp.Blur(panel=panel_fwhm, focal_spot=spot_fwhm, at=(0, 0, 0))
    return pp.Scan(counts.astype(np.float32), photons, views, background, blur=blur)
