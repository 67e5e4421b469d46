"""The demo on real projections: portal images of a head phantom to a volume, judged by views that were left out."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from palpate.arrays import Float32, Float64
from palpate.demos.checkpointed_reconstruction import reconstruct_stage
from palpate.demos.organ_pipeline import files_section
from palpate.reconstruction.models.likelihood import WeightedLeastSquares
from palpate.reconstruction.models.mrf_prior import Prior
from palpate.reconstruction.multiresolution import pyramid
from palpate.reconstruction.optimizers.coordinate_descent import data_curvature
from palpate.reconstruction.prior_parameters import choose_prior_parameters
from palpate.reconstruction.projector import Projector
from palpate.report.figures import projections, slice_table
from palpate.report.html_report import Section, write_report
from palpate.report.stages import Stages
from palpate.scans.importers import import_scan
from palpate.scans.intensity_correction import line_integrals
from palpate.scans.io import read_scan, write_scan
from palpate.scans.scan import Scan
from palpate.studies.head.leave_one_view_out import (
    ERODED,
    Level,
    ViewScore,
    leave_out,
    map_path,
    null_scores,
    view_scores,
)
from palpate.tissue.tissue import Tissue
from palpate.volumes.display_window import default_window
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume
from palpate.volumes.volume_plots import plot_volume

# Head, couch and its rails: what lies outside the box would be fitted inside. The volume is reconstructed at level 1 of it
# (2 mm voxels in 5 mm slices, pixels in twos), predictions at level 2 (4 mm).
GRID = Grid((80, 400, 440), (5.0, 1.0, 1.0), (-219.5, -199.5, -197.5))
FACTORS, EACH = (1.0, 0.3, 0.1), 20  # of the default strength, which takes 8-bit values for counts; iterations of each


def head(stages: Stages) -> Mapping[str, Tissue]:
    """Portal images to volume, prediction of left-out views and report.html; nothing to touch. Raises `FileError`."""
    scan = stages("scan.h5", lambda: import_scan("head"), write_scan, read_scan)
    levels = pyramid(scan, GRID, 3, "sum")
    panel = view_scores(scan)
    scores = left_out(scan, levels[2], panel, stages)
    factor = FACTORS[int(np.argmax(scores[:, :, 1].mean(axis=1)))]
    coarse, grid = levels[1]
    prior = softened(coarse, grid, factor)
    volume, _ = reconstruct_stage(
        stages, coarse, grid, levels=3, likelihood="least-squares", prior=prior, iterations=(8, 15, 25)
    )
    again = Projector(scan.views, grid)(volume.values)
    fits = [float(score(image)[0]) for score, image in zip(panel, again, strict=True)]
    sections = [
        _scan_section(scan, again, fits),
        _volume_section(volume, factor),
        _prediction_section(scores, null_scores(panel)),
        files_section(stages),
    ]
    title = "A head from eleven portal images"
    write_report(stages.folder / "report.html", title, "palpate demo head --no-browser", sections)
    return {}


def softened(scan: Scan, grid: Grid, factor: float) -> Prior:
    """The default prior for these data, its strength times `factor`."""
    A, likelihood = Projector(scan.views, grid), WeightedLeastSquares.of(scan)
    prior = choose_prior_parameters(Prior(), A, likelihood, data_curvature(A, likelihood))
    assert prior.strength is not None
    return replace(prior, strength=prior.strength * factor)


def left_out(scan: Scan, coarse: Level, panel: Sequence[ViewScore], stages: Stages) -> Float64:
    """Scores (factors, views, 2) of each view predicted from the others at each strength, judged on the full panel."""
    scores = np.empty((len(FACTORS), len(panel), 2))
    for k, score in enumerate(panel):
        stages.progress(f"view {k} predicted from the others", k / len(panel))
        ((others, grid),) = leave_out([coarse], [k])
        ahead = Projector(scan.views[[k]], grid)
        for i, (_, values) in enumerate(map_path(others, grid, FACTORS, EACH)):
            scores[i, k] = score(ahead(values)[0])
    stages.progress("left-out views", 1.0)
    return scores


def _scan_section(scan: Scan, again: Float32, fits: Sequence[float]) -> Section:
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
                projections(line_integrals(scan)[::2], titles[::2]),
                "Measured, -log(intensity / open beam); r is the re-projection's.",
            ),
            (projections(again[::2], titles[::2]), "Re-projected from the volume."),
        ],
    )


def _volume_section(volume: Volume, factor: float) -> Section:
    z = np.percentile(volume.grid.axis("z"), np.linspace(20, 80, 8)).tolist()
    rows = {"": [(volume, depth) for depth in z[:4]], " ": [(volume, depth) for depth in z[4:]]}
    window = default_window(volume.values)
    return Section(
        "Slices",
        [
            f"M-MAP-3 on {' x '.join(map(str, volume.grid.shape))} voxels (z, y, x) of 5 x 2 x 2 mm, back to front.",
            f"The prior has {factor:g} times its default strength: of {FACTORS} the one that best predicts views from the "
            f"others, fine detail on average.",
        ],
        pictures=[
            (
                slice_table(rows, [window, window], y_up=True),
                "Coronal slices at eight depths.",
            ),
            (
                plot_volume(volume, at=(0, 0, 0), window=window, reach=140, y_up=True),
                "Three planes through the isocentre. The views span 40°: depth is smeared in the second and third.",
            ),
        ],
    )


def _prediction_section(scores: Float64, null: Float64) -> Section:
    head = ("view left out", "strength", "full band", "high-passed", "null, full band", "null, high-passed")
    table = []
    for k, other in enumerate(null):
        fine = np.delete(scores[:, :, 1], k, axis=1).mean(axis=1)
        i = int(np.argmax(fine))
        table.append((k, f"{FACTORS[i]:g}", *(f"{c:.4f}" for c in (*scores[i, k], *other))))
    return Section(
        "Views that were left out",
        [
            "Each view is predicted from the ten others, with 4 mm voxels; the prior's strength is the one that best "
            "predicts the other views. Correlation with what was measured there, full band and without what is coarser than "
            f"about 8 pixels. Strengths are tried from strong to weak, {EACH} iterations each, going on from the one before.",
            "The null score is the mean of the two neighbouring views, 4° away on either side (of the one neighbour at "
            "either end): hard to beat, since neighbours share almost everything. `palpate study head` predicts with finer "
            "voxels, every choice nested.",
        ],
        table=[head, *table],
    )
