"""The head study: every method predicts each portal image from the others, all its settings chosen without that image."""

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import Float32, Float64
from palpate.atomic import replacing
from palpate.errors import FileError
from palpate.reconstruction.multires import pyramid
from palpate.reconstruction.projector import Projector
from palpate.reconstruction.refine import Refinement, between, moved_panels, refine, refined
from palpate.scans.importers import import_scan
from palpate.scans.scan import Scan
from palpate.scans.views import Views
from palpate.studies import head_report
from palpate.studies.leaving import (
    Judge,
    Level,
    choose,
    coarse_map,
    judges,
    methods,
    null_scores,
    pairs,
    without,
)
from palpate.studies.stages import Stages
from palpate.volumes.grid import Grid

# Head, couch and its rails: what lies outside the box would be fitted inside. Levels 1 and 2 are used: 2 and 4 mm voxels
# (pixels in twos and fours), in slices of 8 mm.
GRID = Grid((50, 400, 440), (8.0, 1.0, 1.0), (-219.5, -199.5, -196.0))
Fold = dict[str, Any]
CORRECTIONS = ("none", "shifts", "gains and shifts")


def head_study(
    folder: str | Path,
    *,
    quick: bool = False,
    resume: bool = False,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Path:
    """Writes report.html, scores.csv and one JSON file a fold into `folder`; returns the report's path.

    Each view is left out in turn. Strength, iterations, relaxation, window and correction are those that predict best a
    view left out together with it, so that nothing is chosen with the view that is judged; scores are correlations,
    blind to that view's gain. quick: every third view, voxels of 8 and 16 mm, for tests. resume: go on from the folds
    that are there. progress(what, share): told how far it is. Raises `FileError` when the folder cannot be written.
    """
    stages = Stages(Path(folder), resume, progress)
    scan = import_scan("head")
    everything = pyramid(scan[::3] if quick else scan, GRID, 5 if quick else 3, "sum")
    levels = everything[3:5] if quick else everything[1:3]
    scan, panel = everything[2 * quick][0], judges(everything[2 * quick][0], 4 if quick else 1)
    inner = {
        (i, j): _stage(stages, f"without_{i}_{j}.json", partial(learnt, scan, levels, panel, (i, j)))
        for i, j in pairs(len(panel))
    }
    outer = []
    for k in range(len(panel)):
        names = ("correction", *methods())
        chosen = {name: choose(k, len(panel), {pair: _scores(r[name]) for pair, r in inner.items()}) for name in names}
        make = partial(predicted, scan, levels, panel, k, chosen)
        outer.append(_stage(stages, f"view_{k}.json", make))
    null = null_scores(panel)
    _write_csv(stages.folder / "scores.csv", outer, null)
    everyone = refine(*levels[-1], likelihood="least-squares")
    middle = len(panel) // 2
    shown = head_report.predicted_section(panel[middle], middle, images(scan, levels, panel, middle, outer[middle]))
    report = stages.folder / "report.html"
    command = "palpate study head" + (" --quick" if quick else "")
    voxel = " x ".join(f"{d:g}" for d in levels[0][1].spacing)
    head_report.write(report, command, outer, null, CORRECTIONS, everyone, _angles(scan), voxel, [shown])
    return report


def learnt(scan: Scan, levels: Sequence[Level], panel: Sequence[Judge], pair: tuple[int, int]) -> Fold:
    """Scores (2, 2) of both views of a pair, left out together, by every candidate of every method, and each correction.

    The candidates run without correction, so that none is chosen with the view that it is chosen for.
    """
    kept = without(levels, pair)
    scores: Fold = {"correction": corrections(scan, levels, panel, pair)[0]}
    ahead = Projector(scan.views[list(pair)], levels[0][1])
    for name, estimates in methods().items():
        scores[name] = {}
        for candidate, values in estimates(kept):
            scores[name][candidate] = [panel[k](image).tolist() for k, image in zip(pair, ahead(values), strict=True)]
    return scores


def predicted(
    scan: Scan, levels: Sequence[Level], panel: Sequence[Judge], view: int, chosen: Mapping[str, str]
) -> Fold:
    """What the chosen candidates score on a view, what was chosen, and what each correction scores on the coarse grid."""
    coarse, found = corrections(scan, levels, panel, [view])
    correction = found[chosen["correction"]]
    kept = [(refined(s, correction), g) for s, g in without(levels, [view])]
    ahead = Projector(_placed(scan, [view], correction), levels[0][1])
    scores = {name: panel[view](ahead(_estimate(name, kept, chosen[name]))[0]).tolist() for name in methods()}
    return {"chosen": dict(chosen), "scores": scores, "corrections": {name: s[0] for name, s in coarse.items()}}


def images(scan: Scan, levels: Sequence[Level], panel: Sequence[Judge], view: int, fold: Fold) -> dict[str, Float32]:
    """The view as M-MAP, SART and the mean of its neighbours predict it, for the report."""
    _, found = corrections(scan, levels, panel, [view])
    correction = found[fold["chosen"]["correction"]]
    kept = [(refined(s, correction), g) for s, g in without(levels, [view])]
    ahead = Projector(_placed(scan, [view], correction), levels[0][1])
    shown = {name: ahead(_estimate(name, kept, fold["chosen"][name]))[0] for name in ("M-MAP", "SART")}
    return {**shown, "mean of the neighbours": (panel[view - 1].measured + panel[view + 1].measured) / 2}


def _estimate(name: str, kept: Sequence[Level], candidate: str) -> Float32:
    for at, values in methods()[name](kept):
        if at == candidate:
            return values
    raise FileError(f"{name}: there is no {candidate!r}; the folder holds another version's folds, choose another")


def corrections(
    scan: Scan, levels: Sequence[Level], panel: Sequence[Judge], left: Sequence[int]
) -> tuple[dict[str, list[list[float]]], dict[str, Refinement]]:
    """For each correction the scores of the left-out views on the coarse grid, and what was estimated without them."""
    ((coarse, grid),) = without(levels[-1:], left)
    both = refine(coarse, grid, likelihood="least-squares")
    still, even = np.zeros_like(both.shifts), np.ones_like(both.gains)
    found = dict(zip(CORRECTIONS, (Refinement(even, still), replace(both, gains=even), both), strict=True))
    scores = {}
    for name, correction in found.items():
        values = coarse_map([(refined(coarse, correction), grid)])
        images = Projector(_placed(scan, left, correction), grid)(values)
        scores[name] = [panel[k](image).tolist() for k, image in zip(left, images, strict=True)]
    return scores, found


def _placed(scan: Scan, left: Sequence[int], correction: Refinement) -> Views:
    """Left-out views, each panel where its neighbours' shifts say that it is: its own image is not looked at."""
    angles = _angles(scan)
    others = np.delete(angles, left)
    return moved_panels(scan.views[list(left)], np.array([between(others, correction.shifts, angles[k]) for k in left]))


def _angles(scan: Scan) -> Float64:
    """(views,) of the sources about the y axis, radians."""
    return np.asarray(np.arctan2(scan.views.source[:, 0], scan.views.source[:, 2]))


def _scores(by_candidate: Mapping[str, object]) -> dict[str, Float64]:
    return {name: np.asarray(scores) for name, scores in by_candidate.items()}


def _stage(stages: Stages, name: str, make: Callable[[], Fold]) -> Fold:
    def write(path: Path, result: Fold) -> None:
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(result, indent=1))

    return stages(name, make, write, lambda path: json.loads(path.read_text()))


def _write_csv(path: Path, outer: Sequence[Fold], null: Float64) -> None:
    with replacing(path) as temporary, temporary.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(("view", "method", "setting", "correction", "full band", "high-passed"))
        for k, fold in enumerate(outer):
            for name, scores in fold["scores"].items():
                table.writerow((k, name, fold["chosen"][name], fold["chosen"]["correction"], *scores))
            table.writerow((k, "neighbours", "-", "-", *null[k]))
