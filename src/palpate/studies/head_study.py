"""The head study: every method predicts each portal image from the others, all its settings chosen without that image."""

import csv
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import Float32, Float64
from palpate.atomic import output_folder, replacing
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
    groups,
    judges,
    methods,
    null_scores,
    without,
)
from palpate.studies.publish import publish
from palpate.studies.stages import Stages, begun
from palpate.volumes.grid import Grid

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
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Path:
    """Writes report.html, scores.csv, figures and one JSON file a fold into `folder`; returns the report's path.

    Each view is left out in turn. Strength, iterations, window and correction are those that predict best one or two views
    left out together with it, so that nothing is chosen with the view that is judged; scores are correlations,
    blind to that view's gain. quick: every third view, voxels of 8 and 16 mm, for tests. resume: go on from the folds
    that are there. docs: a folder that gets the page head.md with its pictures. progress(what, share): told how far it
    is. Raises `FileError` when a folder cannot be written.
    """
    stages = begun(folder, resume, docs, progress)
    output_folder(stages.folder / "figures")
    scan = import_scan("head")
    everything = pyramid(scan[::3] if quick else scan, GRID, 5 if quick else 3, "sum")
    levels = everything[3:5] if quick else [pyramid(scan, THIN, 2, "sum")[1], everything[2]]
    scan, panel = everything[2 * quick][0], judges(everything[2 * quick][0], 4 if quick else 1)
    inner = {
        group: _stage(stages, f"without_{'_'.join(map(str, group))}.json", partial(learnt, scan, levels, panel, group))
        for group in groups(len(panel))
    }
    null, middle, outer = null_scores(panel), len(panel) // 2, []
    for k in range(len(panel)):
        names = ("correction", *methods())
        chosen = {
            name: choose(k, len(panel), {group: _scores(r[name]) for group, r in inner.items()}) for name in names
        }
        if k == middle:
            make_images = partial(shown, scan, levels, panel, k, chosen)
            images, slices = stages("shown.npz", make_images, _write_images, _read_images)
        make = partial(predicted, scan, levels, panel, k, chosen, images if k == middle else None)
        outer.append(_stage(stages, f"view_{k}.json", make))
    _write_csv(stages.folder / "scores.csv", outer, null)
    first = next(iter(inner.values()))
    lists = {name: list(first[name]) for name in methods()}
    voxel = " x ".join(f"{d:g}" for d in levels[0][1].spacing)
    everyone = refine(*levels[-1], likelihood="least-squares")
    sections = [
        *head_report.sections(outer, null, lists, everyone, _angles(scan), voxel),
        head_report.predicted_section(panel[middle], middle, {**images, head_report.NULL: _neighbours(panel, middle)}),
        head_report.slices_section(middle, slices, DEPTHS),
    ]
    command = "palpate study head" + (" --quick" if quick else "")
    return publish(stages.folder, "head", head_report.TITLE, command, sections, docs)


def learnt(scan: Scan, levels: Sequence[Level], panel: Sequence[Judge], group: Sequence[int]) -> Fold:
    """Scores (views, 2) of each view of a group, left out together, by every candidate of every method and correction.

    The candidates run without correction, so that none is chosen with the view that it is chosen for.
    """
    kept = without(levels, group)
    scores: Fold = {"correction": corrections(scan, levels, panel, group)[0]}
    ahead = Projector(scan.views[list(group)], levels[0][1])
    for name, estimates in methods().items():
        scores[name] = {}
        for candidate, values in estimates(kept):
            scores[name][candidate] = [panel[k](image).tolist() for k, image in zip(group, ahead(values), strict=True)]
    return scores


def predicted(
    scan: Scan,
    levels: Sequence[Level],
    panel: Sequence[Judge],
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


def shown(scan: Scan, levels: Sequence[Level], panel: Sequence[Judge], view: int, chosen: Mapping[str, str]) -> Shown:
    """For the report, of every method without the view: its prediction, and slices at `DEPTHS`, +y upwards."""
    _, found = corrections(scan, levels, panel, [view])
    grid = levels[0][1]
    z = np.array([np.argmin(np.abs(grid.axis("z") - depth)) for depth in DEPTHS])
    y, x = (np.flatnonzero(np.abs(grid.axis(name) - middle) <= BOX) for name, middle in (("y", -20.0), ("x", 0.0)))
    images, slices = {}, {}
    for name, image, values in _predictions(scan, levels, view, chosen, found[chosen["correction"]]):
        images[name], slices[name] = image, values[np.ix_(z, y[::-1], x)]
    return images, slices


def _predictions(
    scan: Scan, levels: Sequence[Level], view: int, chosen: Mapping[str, str], correction: Refinement
) -> Iterator[tuple[str, Float32, Float32]]:
    """Each method, the view as it predicts it from the others, and the volume that the prediction is made from."""
    kept = [(refined(s, correction), g) for s, g in without(levels, [view])]
    ahead = Projector(_placed(scan, [view], correction), levels[0][1])
    for name in methods():
        values = _estimate(name, kept, chosen[name])
        yield name, ahead(values)[0], values


def _neighbours(panel: Sequence[Judge], view: int) -> Float32:
    mean: Float32 = np.mean([panel[view - 1].measured, panel[view + 1].measured], axis=0)
    return mean


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
    scores, values = {}, None
    for name, correction in found.items():  # each goes on from the one before: they differ little
        values = coarse_map([(refined(coarse, correction), grid)], values)
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


def _write_images(path: Path, shown: Shown) -> None:
    images, slices = shown
    predicted, cut = (np.stack(list(of.values())) for of in (images, slices))
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, names=np.array(list(images)), images=predicted, slices=cut)


def _read_images(path: Path) -> Shown:
    with np.load(path, allow_pickle=False) as file:
        names = file["names"].tolist()
        images, slices = (dict(zip(names, file[kind], strict=True)) for kind in ("images", "slices"))
    return images, slices
