"""How the breast is scanned: a polychromatic beam, an energy-integrating panel, scatter by Monte Carlo, quantum noise."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from palpate.arrays import Float32, Float64
from palpate.reconstruction.projector import Projector
from palpate.scans.scan import Scan
from palpate.scans.scatter.cross_sections import attenuation
from palpate.scans.scatter.kernels import tube_spectrum
from palpate.scans.scatter.monte_carlo import GRIDS, scatter_image
from palpate.scans.scatter.scan_scatter import add_scatter
from palpate.scans.views import Views
from palpate.studies.detection.breast import Breast, scattering_body
from palpate.studies.detection.config import BEAM, GAP, GRID, KV, Kind, Setting
from palpate.studies.detection.signals import Signals, added_lengths

CELL = 4.0  # mm, a pixel of the Monte Carlo
BEYOND = 60.0  # mm that the beam goes on beyond the chest wall
LINE = 1.0  # keV: lines closer than this are taken together
MATERIALS = "adipose", "glandular", "calcium oxalate"
DENSE = 0.65  # of a calcification's length is calcium oxalate; the rest weakens as what it lies in


@dataclass(frozen=True, eq=False)
class Exposure:
    """Signal over that of the open beam, (views, rows, columns), and its variance for one quantum in the open beam."""

    views: Views
    signal: Float32
    variance: Float32
    scatter: Float32  # within the signal


def scatter_of(kind: Kind, setting: Setting, seed: int) -> Float32:
    """(views, rows, columns): scatter of a breast of this kind over the signal of the open beam, by Monte Carlo."""
    views = setting.views(kind)
    panel = views.panels[0]
    keV, photons = tube_spectrum(KV, BEAM)
    rows, columns = (int(np.ceil(n * p / CELL)) for n, p in zip(panel.shape, panel.pitch, strict=True))
    left = float(panel.origin[0]) - panel.pitch[1] / 2
    field = left, -BEYOND, left + columns * CELL, rows * CELL
    emitted = setting.scatter * float(photons @ keV) / photons.sum() * CELL**2
    open_beam = emitted / ((field[2] - field[0]) * (field[3] - field[1]))
    at = [(np.arange(n) + 0.5) * p / CELL - 0.5 for n, p in zip(panel.shape, panel.pitch, strict=True)]
    places = np.stack(np.meshgrid(*at, indexing="ij"))
    found = []
    for k, source in enumerate(views.source):
        image = scatter_image(
            scattering_body(kind),
            source,
            field,
            (rows, columns),
            CELL,
            (left, 0.0),
            keV,
            photons,
            setting.scatter,
            seed + k,
            GRIDS[GRID],
        )
        smooth = ndimage.gaussian_filter(image.scatter / open_beam, 1.0, mode="nearest")
        found.append(ndimage.map_coordinates(smooth, places, order=1, mode="nearest").astype(np.float32))
    return np.stack(found)


def path_lengths(breast: Breast, views: Views) -> tuple[Float32, Float32]:
    """(views, rows, columns) each: mm of fat and of gland along each ray."""
    A = Projector(views, breast.grid)
    gland = A(breast.tissue * breast.gland)
    return np.maximum(A(breast.tissue) - gland, 0), gland


def expose(lengths: tuple[Float32, Float32], scatter: Float32, views: Views, signals: Signals | None) -> Exposure:
    """The panel behind a breast, with signals or without."""
    fat, gland = lengths
    calcified = np.zeros_like(fat)
    if signals is not None:
        masses, calcified = added_lengths(signals, views, fat.shape)
        fat, gland = fat - masses, gland + masses
    keV, photons = lines()
    energy = photons * keV / (photons @ keV)  # share of the open beam's signal
    mean = float(photons @ keV) / photons.sum()
    signal, variance = scatter.copy(), scatter * float((photons @ keV**2) / (photons @ keV) / mean)
    for e, share in zip(keV, energy, strict=True):
        a, g, c = (np.float32(attenuation(m, e)) for m in MATERIALS)
        passed = np.float32(share) * np.exp(-(a * fat + g * gland + c * DENSE * calcified))
        signal += passed
        variance += passed * np.float32(e / mean)  # each quantum counts by its energy
    return Exposure(views, signal, variance, scatter)


def lines() -> tuple[Float64, Float64]:
    """The spectrum in lines of at least `LINE` keV: energies, photons."""
    keV, photons = tube_spectrum(KV, BEAM)
    bins = np.floor(keV / LINE).astype(int)
    total = np.asarray(np.bincount(bins, photons), np.float64)
    mean = np.bincount(bins, photons * keV) / np.maximum(total, 1e-30)
    return mean[total > 0], total[total > 0]


def noise(exposure: Exposure, quanta: int, thick: float, normal: Float32) -> Scan:
    """The scan at a dose: quanta that a pixel counts in the open beam.

    thick: mm between the plates, which every unit tells. normal: one draw a pixel, the same with and without signals.
    Scatter is estimated as `palpate scan import` does, from these counts; all methods are given it.
    """
    counts = quanta * exposure.signal + np.sqrt(quanta * exposure.variance) * normal
    bare = Scan(np.maximum(counts, 0), float(quanta), exposure.views)
    return add_scatter(bare, "estimate", KV, BEAM, GAP, GRID, thick)


def effective_attenuation(kind: Kind) -> dict[str, float]:
    """1/mm of each material for the beam that has gone through half of the breast: what a gray volume should show."""
    keV, photons = lines()
    tissue = (1 - kind.glandular) * attenuation("adipose", keV) + kind.glandular * attenuation("glandular", keV)
    weight = photons * keV * np.exp(-tissue * kind.thick / 2)
    return {m: float(weight @ attenuation(m, keV) / weight.sum()) for m in MATERIALS}
