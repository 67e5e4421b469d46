"""The head study: every method predicts each portal image from the others, all its settings chosen without that image."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import Float32, Float64, Int64
from palpate.atomic_write import replacing
from palpate.errors import FileError
from palpate.reconstruction.multiresolution import pyramid
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.self_calibration import (
    Calibration,
    apply_calibration,
    calibrate,
    interpolate_over_angle,
    shift_panels,
)
from palpate.report.stages import Progress, Stages, silent
from palpate.scans.importers import import_scan
from palpate.scans.scan import Scan
from palpate.scans.views import Views
from palpate.studies.head import report_sections
from palpate.studies.head.leave_one_view_out import (
    Level,
    ViewScore,
    choose_candidate,
    coarse_map,
    groups,
    leave_out,
    methods,
    null_scores,
    past_the_best,
    path_of,
    view_scores,
)
from palpate.studies.run_store import read_json, write_arrays, write_json
from palpate.studies.study import Study
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume

# Head, couch and its rails: what lies outside the box would be fitted inside. Level 2 of the first, 4 mm voxels in slices of
# 8 mm (pixels in fours), and level 1 of the second, 2 mm in slices of 4 mm (pixels in twos): so thin that rays 20° off
# the vertical, as of the outermost views, move by less than a voxel in a slice.
GRID = Grid((50, 400, 440), (8.0, 1.0, 1.0), (-219.5, -199.5, -196.0))
THIN = Grid((100, 400, 440), (4.0, 1.0, 1.0), (-219.5, -199.5, -198.0))
BOX, DEPTHS = 115.0, (-60.0, -20.0, 20.0, 60.0)  # mm: what the report's slices show to all sides, and where they lie
Fold = dict[str, Any]
Shown = tuple[dict[str, Float32], dict[str, Float32]]  # by method: the view predicted, slices of the volume
CORRECTIONS = ("none", "shifts", "gains and shifts")


def head_study(
    folder: str | Path,
    *,
    quick: bool = False,
    resume: bool = False,
    docs: str | Path | None = None,
    progress: Progress = silent,
) -> Path:
    """Predict each portal image of a head from the others, by every method.

    Each view is left out in turn. Strength, iterations, window and correction are those that predict best one or two other
    views, so that nothing is chosen with the view that is judged. Scores are correlations.

    Parameters
    ----------
    folder : str or Path
        Receives report.html, scores.csv, figures and one JSON file for each view left out.
    quick : bool, optional
        Use every third view and coarse voxels, for tests.
    resume : bool, optional
        Go on from the results that are there.
    docs : str or Path, optional
        A folder that receives the page head.md and its pictures.
    progress : callable, optional
        Called with what is done and the share done.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    FileError
        If a folder cannot be written.

    Examples
    --------
    >>> pp.head_study("head", quick=True)  # doctest: +SKIP
    """
    stages = Stages(Path(folder), resume, progress)
    study = Study("head", report_sections.TITLE, stages, quick, docs)
    scan = import_scan("head")
    everything = pyramid(scan[::3] if quick else scan, GRID, 5 if quick else 3, "sum")
    levels = everything[3:5] if quick else [pyramid(scan, THIN, 2, "sum")[1], everything[2]]
    scan, panel = everything[2 * quick][0], view_scores(everything[2 * quick][0], 4 if quick else 1)
    inner = {}
    for group in groups(len(panel)):
        make = partial(candidate_scores, scan, levels, panel, group)
        inner[group] = stages(f"without_{'_'.join(map(str, group))}.json", make, write_json, read_json)
    null, middle, outer = null_scores(panel), len(panel) // 2, []
    for k in range(len(panel)):
        chosen = {}
        for name in ("correction", *methods()):
            scores = {g: {c: np.asarray(s) for c, s in found[name].items()} for g, found in inner.items()}
            chosen[name] = choose_candidate(k, len(panel), scores)
        if k == middle:
            make_images = partial(middle_view_images, scan, levels, panel, k, chosen)
            images, slices = stages("shown.npz", make_images, _write_images, _read_images)
        make = partial(predict_view, scan, levels, panel, k, chosen, images if k == middle else None)
        outer.append(stages(f"view_{k}.json", make, write_json, read_json))
    _write_csv(stages.folder / "scores.csv", outer, null)
    lists = {
        name: [next(list(f[name]) for g, f in inner.items() if k in g) for k in range(len(panel))] for name in methods()
    }
    voxel = " x ".join(f"{d:g}" for d in levels[0][1].spacing)
    everyone = calibrate(*levels[-1], rounds=4, memory=0, likelihood="least-squares")
    sections = report_sections.sections(outer, null, lists, everyone, _angles(scan), voxel)
    shown = {**images, report_sections.NULL: _neighbours(panel, middle)}
    volumes = {name: Volume(values, _shown(levels[0][1])[0]) for name, values in slices.items()}
    sections += [
        report_sections.predicted_section(panel[middle], middle, shown),
        report_sections.slices_section(middle, volumes, DEPTHS),
    ]
    return study.publish({}, sections)


def candidate_scores(scan: Scan, levels: Sequence[Level], panel: Sequence[ViewScore], group: Sequence[int]) -> Fold:
    """Scores (views, 2) of each view of a group, left out together, by every candidate of every method and correction.

    The candidates run without correction, so that none is chosen with the view that it is chosen for.
    """
    kept = leave_out(levels, group)
    scores: Fold = {"correction": corrections(scan, levels, panel, group)[0]}
    ahead = Projector(scan.views[list(group)], levels[0][1])
    for name, estimates in methods().items():
        scores[name] = {}
        for path in estimates(kept):
            tried: dict[str, Float64] = {}
            for candidate, values in path:
                tried[candidate] = np.array([panel[k](image) for k, image in zip(group, ahead(values), strict=True)])
                if past_the_best(len(panel), tuple(group), tried):
                    break
            scores[name] |= {candidate: each.tolist() for candidate, each in tried.items()}
    return scores


def predict_view(
    scan: Scan,
    levels: Sequence[Level],
    panel: Sequence[ViewScore],
    view: int,
    chosen: Mapping[str, str],
    images: Mapping[str, Float32] | None = None,
) -> Fold:
    """What the chosen candidates score on a view, what was chosen, and what each correction scores on the coarse grid.

    images: the view as each method predicts it, where that is known.
    """
    coarse, found = corrections(scan, levels, panel, [view])
    if images is None:
        made = _predictions(scan, levels, view, chosen, found[chosen["correction"]])
        images = {name: image for name, image, _ in made}
    scores = {name: panel[view](image).tolist() for name, image in images.items()}
    return {"chosen": dict(chosen), "scores": scores, "corrections": {name: s[0] for name, s in coarse.items()}}


def middle_view_images(
    scan: Scan, levels: Sequence[Level], panel: Sequence[ViewScore], view: int, chosen: Mapping[str, str]
) -> Shown:
    """For the report, of every method without the view: its prediction, and slices at `DEPTHS`."""
    _, found = corrections(scan, levels, panel, [view])
    grid = levels[0][1]
    cut = _shown(grid)[1]
    images, slices = {}, {}
    for name, image, values in _predictions(scan, levels, view, chosen, found[chosen["correction"]]):
        images[name], slices[name] = image, values[cut]
    return images, slices


def _shown(grid: Grid) -> tuple[Grid, tuple[Int64, ...]]:
    """The slices at `DEPTHS` as a grid of their own, and how to take its values from those of `grid`."""
    z = np.array([np.argmin(np.abs(grid.axis("z") - depth)) for depth in DEPTHS])
    y, x = (np.flatnonzero(np.abs(grid.axis(name) - middle) <= BOX) for name, middle in (("y", -20.0), ("x", 0.0)))
    spacing = (DEPTHS[1] - DEPTHS[0], *grid.spacing[1:])
    origin = (grid.axis("x")[x[0]], grid.axis("y")[y[0]], DEPTHS[0])
    return Grid((len(z), len(y), len(x)), spacing, origin), np.ix_(z, y, x)


def _predictions(
    scan: Scan, levels: Sequence[Level], view: int, chosen: Mapping[str, str], correction: Calibration
) -> Iterator[tuple[str, Float32, Float32]]:
    """Each method, the view as it predicts it from the others, and the volume that the prediction is made from."""
    kept = [(apply_calibration(s, correction), g) for s, g in leave_out(levels, [view])]
    ahead = Projector(_placed(scan, [view], correction), levels[0][1])
    for name in methods():
        values = _estimate(name, kept, chosen[name])
        yield name, ahead(values)[0], values


def _neighbours(panel: Sequence[ViewScore], view: int) -> Float32:
    mean: Float32 = np.mean([panel[view - 1].measured, panel[view + 1].measured], axis=0)
    return mean


def _estimate(name: str, kept: Sequence[Level], candidate: str) -> Float32:
    for path in methods()[name](kept):
        for at, values in path:
            if at == candidate:
                return values
            if path_of(at) != path_of(candidate):
                break
    raise FileError(f"{name}: there is no {candidate!r}; the folder holds another version's folds, choose another")


def corrections(
    scan: Scan, levels: Sequence[Level], panel: Sequence[ViewScore], left: Sequence[int]
) -> tuple[dict[str, list[list[float]]], dict[str, Calibration]]:
    """For each correction the scores of the left-out views on the coarse grid, and what was estimated without them."""
    ((coarse, grid),) = leave_out(levels[-1:], left)
    both = calibrate(coarse, grid, rounds=4, memory=0, likelihood="least-squares")
    still, even = np.zeros_like(both.shifts), np.ones_like(both.gains)
    found = dict(zip(CORRECTIONS, (Calibration(even, still), replace(both, gains=even), both), strict=True))
    scores, values = {}, None
    for name, correction in found.items():  # each goes on from the one before: they differ little
        values = coarse_map([(apply_calibration(coarse, correction), grid)], values)
        images = Projector(_placed(scan, left, correction), grid)(values)
        scores[name] = [panel[k](image).tolist() for k, image in zip(left, images, strict=True)]
    return scores, found


def _placed(scan: Scan, left: Sequence[int], correction: Calibration) -> Views:
    """Left-out views, each panel where its neighbours' shifts say that it is: its own image is not looked at."""
    angles = _angles(scan)
    others = np.delete(angles, left)
    return shift_panels(
        scan.views[list(left)], np.array([interpolate_over_angle(others, correction.shifts, angles[k]) for k in left])
    )


def _angles(scan: Scan) -> Float64:
    """(views,) of the sources about the y axis, radians."""
    return np.asarray(np.arctan2(scan.views.source[:, 0], scan.views.source[:, 2]))


def _write_csv(path: Path, outer: Sequence[Fold], null: Float64) -> None:
    with replacing(path) as temporary, temporary.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(("view", "method", "setting", "correction", "full band", "high-passed"))
        for k, fold in enumerate(outer):
            for name, scores in fold["scores"].items():
                table.writerow((k, name, fold["chosen"][name], fold["chosen"]["correction"], *scores))
            table.writerow((k, "neighbours", "-", "-", *null[k]))


def _write_images(path: Path, shown: Shown) -> None:
    images, slices = shown
    predicted, cut = (np.stack(list(of.values())) for of in (images, slices))
    write_arrays(path, {"names": np.array(list(images)), "images": predicted, "slices": cut})


def _read_images(path: Path) -> Shown:
    with np.load(path, allow_pickle=False) as file:
        names = file["names"].tolist()
        images, slices = (dict(zip(names, file[kind], strict=True)) for kind in ("images", "slices"))
    return images, slices
