"""The demo on real projections: portal images of a head phantom to a volume, judged by views that were left out."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import ndimage

from palpate.arrays import AnyArray, Bool, Float32, Float64
from palpate.reconstruction.descent import data_curvature
from palpate.reconstruction.likelihood import WeightedLeastSquares
from palpate.reconstruction.multires import pyramid
from palpate.reconstruction.prior import Prior
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.reconstruct import iterates
from palpate.reconstruction.tune import tune
from palpate.scans.files import read_scan, write_scan
from palpate.scans.importers import import_scan
from palpate.scans.scan import Scan
from palpate.scans.views import Views
from palpate.studies.organ import files_section
from palpate.studies.pictures import projections, slices, three_planes
from palpate.studies.reconstructing import reconstructed
from palpate.studies.report import Section, write_report
from palpate.studies.stages import Stages
from palpate.tissue.tissue import Tissue
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

# Head, couch and its rails: what lies outside the box would be fitted inside. Depth in 5 mm slices, 2 mm within.
GRID = Grid((80, 200, 220), (5.0, 2.0, 2.0), (-219.0, -199.0, -197.5))
ERODED, DENSE, FINE = 16, 0.15, 8.0  # pixels off the field's edge; least line integral; sigma of the high pass, pixels
FACTORS = (1.0, 0.1, 0.01)  # of the default strength, which takes 8-bit values for counts

Score = tuple[float, float]  # correlation, full band and high-passed


def head(stages: Stages) -> Mapping[str, Tissue]:
    """Portal images to volume, prediction of left-out views and report.html; nothing to touch. Raises `FileError`."""
    scan = stages("scan.h5", lambda: import_scan("head"), write_scan, read_scan)
    stages.progress("strength of the prior", 0.0)
    factor = best_factor(scan)
    prior = softened(scan, GRID, factor)
    volume, _ = reconstructed(
        stages, scan, GRID, levels=3, likelihood="least-squares", prior=prior, iterations=(10, 20, 40)
    )
    stages.progress("re-projection", 0.0)
    measured, region = line_integrals(scan), judged(scan)
    again = Projector(scan.views, GRID)(volume.values)
    fits = [correlation(a, m, r) for a, m, r in zip(again, measured, region, strict=True)]
    sections = [
        _scan_section(scan, measured, again, fits),
        _volume_section(volume, factor),
        _prediction_section(left_out(scan, stages)),
        files_section(stages),
    ]
    title = "A head from eleven portal images"
    write_report(stages.folder / "report.html", title, "palpate demo head --no-browser", sections)
    return {}


def softened(scan: Scan, grid: Grid, factor: float) -> Prior:
    """The default prior for these data, its strength times `factor`."""
    A, likelihood = Projector(scan.views, grid), WeightedLeastSquares.of(scan)
    prior = tune(Prior(), A, likelihood, data_curvature(A, likelihood))
    assert prior.strength is not None
    return replace(prior, strength=prior.strength * factor)


def best_factor(scan: Scan) -> float:
    """The strength that best predicts the scan's middle view from the others, fine detail, on a coarse grid."""
    coarse, grid = pyramid(scan, GRID, 3, "sum")[2]
    middle = len(scan.views) // 2

    def score(factor: float) -> float:
        predicted = prediction(coarse, grid, middle, factor, levels=1, iterations=15)
        return scored(predicted, coarse, middle, pixels=4)[1]

    return max(FACTORS, key=score)


def prediction(
    scan: Scan, grid: Grid, view: int, factor: float, levels: int, iterations: int, views: Views | None = None
) -> Float32:
    """Line integrals (rows, columns) that a reconstruction from the other views expects in this one.

    views: whose panel for this view to expect them on, if not the scan's own.
    """
    others = scan[[k for k in range(len(scan.views)) if k != view]]
    prior = softened(others, grid, factor)
    *_, last = iterates(others, grid, levels=levels, likelihood="least-squares", prior=prior, iterations=iterations)
    seen = (views or scan.views)[[view]]
    return Projector(seen, grid)(last.volume.values)[0]


def scored(image: Float32, scan: Scan, view: int, pixels: int = 1) -> Score:
    """Correlations of an image with what was measured in a view; pixels: of the full panel in one of this scan's."""
    measured, region = line_integrals(scan)[view], judged(scan, pixels)[view]
    fine = [high_passed(i, scan.mask[view], FINE / pixels) for i in (image, measured)]
    return correlation(image, measured, region), correlation(fine[0], fine[1], region)


def line_integrals(scan: Scan) -> Float32:
    """-log(counts / incident), (views, rows, columns); 0 where nothing was measured."""
    ratio = np.maximum(scan.counts, 0.5) / np.maximum(scan.incident, 0.5)
    return np.where(scan.mask, -np.log(ratio), 0).astype(np.float32)


def judged(scan: Scan, pixels: int = 1) -> Bool:
    """(views, rows, columns) pixels on which images are judged: inside the field and behind something dense."""
    inner = [ndimage.binary_erosion(m, iterations=ERODED // pixels, border_value=1) for m in scan.mask]
    return np.asarray(np.stack(inner) & (line_integrals(scan) > DENSE))


def correlation(a: AnyArray, b: AnyArray, region: Bool) -> float:
    """Pearson's, over the region: blind to each image's gain and offset."""
    return float(np.corrcoef(a[region], b[region])[0, 1])


def high_passed(image: Float32, measured: Bool, sigma: float = FINE) -> Float64:
    """What is left of an image without its mean over about `sigma` pixels, unmeasured pixels not counted."""
    weight = ndimage.gaussian_filter(measured.astype(np.float64), sigma)
    mean = ndimage.gaussian_filter(np.where(measured, image, 0).astype(np.float64), sigma) / np.maximum(weight, 1e-6)
    return np.asarray(np.where(measured, image - mean, 0))


def left_out(scan: Scan, stages: Stages) -> list[tuple[int, float, Score, Score | None]]:
    """Each view predicted from the others: (view, factor, scores of the prediction, scores of null).

    The strength is chosen without the view, by predicting another of those left. Null is the mean of the two
    neighbouring views, which the outermost have not. At half the grid's resolution; judged on the full panel.
    """
    coarse, grid = pyramid(scan, GRID, 2, "sum")[1]
    measured = line_integrals(scan)
    rows = []
    for k in range(len(scan.views)):
        stages.progress(f"view {k} predicted from the others", k / len(scan.views))
        factor = best_factor(scan[[i for i in range(len(scan.views)) if i != k]])
        predicted = prediction(coarse, grid, k, factor, levels=2, iterations=20, views=scan.views)
        null = (measured[k - 1] + measured[k + 1]) / 2 if 0 < k < len(scan.views) - 1 else None
        rows.append((k, factor, scored(predicted, scan, k), None if null is None else scored(null, scan, k)))
    stages.progress("left-out views", 1.0)
    return rows


def _scan_section(scan: Scan, measured: Float32, again: Float32, fits: Sequence[float]) -> Section:
    angles = np.degrees(np.arctan2(scan.views.source[:, 0], scan.views.source[:, 2]))
    titles = [f"{a:+.0f}°, r = {r:.4f}" for a, r in zip(angles, fits, strict=True)]
    beams = ", ".join(f"{b:.0f}" for b in scan.incident.max(axis=(1, 2)))
    return Section(
        "Projections",
        [
            "Eleven megavoltage portal images of an anthropomorphic head phantom, tube and panel turning together. The "
            "values are 8-bit display intensities, not photon counts: weighted least squares, not Poisson.",
            f"Open beam, estimated from the brightest level that many pixels of each view share: {beams}.",
            f"Re-projected, the volume correlates with every measured view at {min(fits):.4f} or more (behind the head, "
            f"{ERODED} pixels off the field's edge).",
        ],
        pictures=[
            (
                projections(measured[::2], titles[::2]),
                "Measured, -log(intensity / open beam); r is the re-projection's.",
            ),
            (projections(again[::2], titles[::2]), "Re-projected from the volume."),
        ],
    )


def _volume_section(volume: Volume, factor: float) -> Section:
    nz = volume.grid.shape[0]
    return Section(
        "Slices",
        [
            f"M-MAP-3 on {' x '.join(map(str, volume.grid.shape))} voxels (z, y, x) of 5 x 2 x 2 mm, back to front.",
            f"The prior has {factor:g} times its default strength: of {FACTORS} the one that best predicts the middle view "
            f"from the others.",
        ],
        pictures=[
            (
                slices(volume, np.linspace(0.2 * nz, 0.8 * nz, 8).astype(int).tolist()),
                "Coronal slices at eight depths.",
            ),
            (
                three_planes(volume, [nz // 2, volume.grid.shape[1] // 2, volume.grid.shape[2] // 2]),
                "Three planes through the isocentre. The views span 40°: depth is smeared in the second and third.",
            ),
        ],
    )


def _prediction_section(rows: Sequence[tuple[int, float, Score, Score | None]]) -> Section:
    head = ("view left out", "strength", "full band", "high-passed", "null, full band", "null, high-passed")
    table = [
        (k, f"{factor:g}", *(f"{c:.4f}" for c in found), *(("–", "–") if null is None else (f"{c:.4f}" for c in null)))
        for k, factor, found, null in rows
    ]
    return Section(
        "Views that were left out",
        [
            "Each view is predicted from the ten others, by a reconstruction with 4 mm voxels, its prior's strength chosen "
            "without that view. Correlation with what was measured there, full band and without what is coarser than about "
            "8 pixels.",
            "The null score is the mean of the two neighbouring views, 4° away on either side: hard to beat, since "
            "neighbours share almost everything.",
        ],
        table=[head, *table],
    )
