"""The demo on real projections: portal images of a head phantom to a volume, judged by views that were left out."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import ndimage

from palpate.arrays import Bool, Float32, Float64
from palpate.reconstruction.multires import pyramid
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.reconstruct import iterates
from palpate.scans.files import read_scan, write_scan
from palpate.scans.importers import import_scan
from palpate.scans.scan import Scan
from palpate.studies.organ import files_section
from palpate.studies.pictures import projections, slices, three_planes
from palpate.studies.reconstructing import reconstructed
from palpate.studies.report import Section, write_report
from palpate.studies.stages import Stages
from palpate.tissue.tissue import Tissue
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

GRID = Grid((50, 300, 300), (5.0, 1.0, 1.0), (-149.5, -149.5, -122.5))  # about the isocentre; depth in 5 mm slices
ERODED, DENSE, FINE = 16, 0.15, 8.0  # pixels off the field's edge; least line integral; sigma of the high pass, pixels


def head(stages: Stages) -> Mapping[str, Tissue]:
    """Portal images to volume, prediction of left-out views and report.html; nothing to touch. Raises `FileError`."""
    scan = stages("scan.h5", lambda: import_scan("head"), write_scan, read_scan)
    volume, _ = reconstructed(stages, scan, GRID, levels=3, likelihood="least-squares")
    stages.progress("re-projection", 0.0)
    measured, region = line_integrals(scan), judged(scan)
    again = Projector(scan.views, GRID)(volume.values)
    fits = [correlation(a, m, r) for a, m, r in zip(again, measured, region, strict=True)]
    rows = left_out(scan, stages)
    sections = [
        _scan_section(scan, measured, again, fits),
        _volume_section(volume),
        _prediction_section(rows),
        files_section(stages),
    ]
    title = "A head from eleven portal images"
    write_report(stages.folder / "report.html", title, "palpate demo head --no-browser", sections)
    return {}


def line_integrals(scan: Scan) -> Float32:
    """-log(counts / incident), (views, rows, columns); 0 where nothing was measured."""
    ratio = np.maximum(scan.counts, 0.5) / np.maximum(scan.incident, 0.5)
    return np.where(scan.mask, -np.log(ratio), 0).astype(np.float32)


def judged(scan: Scan) -> Bool:
    """(views, rows, columns) pixels on which predictions are judged: inside the field and behind the head."""
    inner = [ndimage.binary_erosion(m, iterations=ERODED, border_value=1) for m in scan.mask]
    return np.asarray(np.stack(inner) & (line_integrals(scan) > DENSE))


def correlation(a: Float32, b: Float32, region: Bool) -> float:
    """Pearson's, over the region: blind to each image's gain and offset."""
    return float(np.corrcoef(a[region], b[region])[0, 1])


def high_passed(image: Float32, measured: Bool) -> Float64:
    """What is left of an image without its mean over about `FINE` pixels, unmeasured pixels not counted."""
    weight = ndimage.gaussian_filter(measured.astype(np.float64), FINE)
    mean = ndimage.gaussian_filter(np.where(measured, image, 0).astype(np.float64), FINE) / np.maximum(weight, 1e-6)
    return np.asarray(np.where(measured, image - mean, 0))


def left_out(scan: Scan, stages: Stages) -> list[tuple[int, float, float, float | None, float | None]]:
    """Each view predicted from the others, at half the resolution: (view, full band, high-passed, and the same of null).

    Null is the mean of the two neighbouring views, which the outermost have not.
    """
    coarse_scan, coarse_grid = pyramid(scan, GRID, 2, "sum")[1]
    measured, region = line_integrals(scan), judged(scan)
    rows = []
    for k in range(len(scan.views)):
        stages.progress(f"view {k} predicted from the others", k / len(scan.views))
        others = [i for i in range(len(scan.views)) if i != k]
        *_, last = iterates(coarse_scan[others], coarse_grid, levels=2, likelihood="least-squares")
        predicted = Projector(scan.views[[k]], coarse_grid)(last.volume.values)[0]
        guesses = [predicted]
        if 0 < k < len(scan.views) - 1:
            guesses.append((measured[k - 1] + measured[k + 1]) / 2)
        truth, fine = measured[k], high_passed(measured[k], scan.mask[k])
        scores = [
            (correlation(g, truth, region[k]), correlation(high_passed(g, scan.mask[k]), fine, region[k]))
            for g in guesses
        ]
        null = scores[1] if len(scores) > 1 else (None, None)
        rows.append((k, *scores[0], *null))
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


def _volume_section(volume: Volume) -> Section:
    nz = volume.grid.shape[0]
    return Section(
        "Slices",
        [f"M-MAP-3 on {' x '.join(map(str, volume.grid.shape))} voxels (z, y, x) of 5 x 1 x 1 mm, front to back."],
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


def _prediction_section(rows: Sequence[tuple[int, float, float, float | None, float | None]]) -> Section:
    def cell(value: float | None) -> str:
        return "–" if value is None else f"{value:.4f}"

    head = ("view left out", "full band", "high-passed", "null, full band", "null, high-passed")
    return Section(
        "Views that were left out",
        [
            "Each view is predicted from the ten others, by a reconstruction at half the resolution (2 mm in the slice). "
            "Correlation with what was measured there, full band and without what is coarser than about 8 pixels.",
            "The null score is the mean of the two neighbouring views, 4° away on either side: hard to beat, since "
            "neighbours share almost everything.",
        ],
        table=[head, *[(k, *map(cell, scores)) for k, *scores in rows]],
    )
