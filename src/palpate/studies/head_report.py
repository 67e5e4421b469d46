"""The head study's report: who predicts the left-out views best, before and after correction, in words, tables, pictures."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from palpate.arrays import Float32, Float64
from palpate.reconstruction.refine import Refinement
from palpate.studies.leaving import Judge
from palpate.studies.pictures import curves, projections
from palpate.studies.report import Section, write_report

BANDS = ("full band", "high-passed")
Fold = Mapping[str, Any]


def write(
    path: Path,
    command: str,
    folds: Sequence[Fold],
    null: Float64,
    corrections: Sequence[str],
    everyone: Refinement,
    angles: Float64,
    voxel: str,
    sections: Sequence[Section],
) -> None:
    """Writes the report: scores first, then what was chosen, what correction gains, and the sections given."""
    write_report(
        path,
        "A head from portal images: views predicted from the others",
        command,
        [
            _verdict(folds, null, voxel),
            *(_scores(folds, null, band) for band in (0, 1)),
            _choices(folds),
            _corrections(folds, corrections, everyone, angles),
            *sections,
        ],
    )


def predicted_section(judge: Judge, view: int, images: Mapping[str, Float32]) -> Section:
    """One left-out view as measured and as predicted, whole and without what is coarse."""
    shown = {"measured": judge.measured, **images}
    whole = np.stack([_scaled(image, judge) for image in shown.values()])
    fine = np.stack([judge.detail(image) * judge.region for image in whole])
    return Section(
        f"View {view}, which no method had seen",
        ["Every image at the gain and offset at which it is nearest to the measured one."],
        pictures=[
            (projections(whole, list(shown)), "Whole."),
            (projections(fine, list(shown)), "High-passed, where it is judged."),
        ],
    )


def standing(folds: Sequence[Fold], null: Float64) -> dict[str, list[list[int]]]:
    """For each rival and band, the views on which M-MAP does not score higher."""
    ours = np.array([fold["scores"]["M-MAP"] for fold in folds])
    rivals = {
        name: np.array([fold["scores"][name] for fold in folds]) for name in folds[0]["scores"] if name != "M-MAP"
    }
    rivals["mean of the neighbours"] = null
    return {
        name: [np.flatnonzero(ours[:, band] <= theirs[:, band]).tolist() for band in (0, 1)]
        for name, theirs in rivals.items()
    }


def _verdict(folds: Sequence[Fold], null: Float64, voxel: str) -> Section:
    table: list[Sequence[object]] = [("M-MAP against", *BANDS)]
    for name, lost in standing(folds, null).items():
        won = [f"higher on {len(folds) - len(views)} of {len(folds)}" for views in lost]
        table.append(
            (name, *(w + (f"; not on {', '.join(map(str, v))}" if v else "") for w, v in zip(won, lost, strict=True)))
        )
    return Section(
        "Who predicts best",
        [
            f"{len(folds)} megavoltage portal images of an anthropomorphic head phantom. Each is left out in turn and "
            f"predicted from the others by projecting what each method makes of them, with voxels of {voxel} mm "
            "(z, y, x).",
            "Score: correlation with what was measured, inside the field and behind the head: blind to the gain and the "
            "offset of the view that is judged. High-passed: without what is coarser than about 8 pixels.",
            "Nothing was chosen with the view that is judged: each method's strength, iterations, relaxation or window is "
            "the one that best predicted another view, left out together with it; gains and shifts were estimated from the "
            "others alone, and the panel of the left-out view was put where its neighbours' shifts say.",
            "The null model is the mean of the two neighbouring views; the first and the last view have but one neighbour, "
            "which then stands for the mean, and every method must extrapolate there.",
            "RTK's SART is another code's, from the same images."
            if "RTK's SART" in folds[0]["scores"]
            else "RTK's SART, the reference from outside, is left out: itk-rtk is not installed here.",
        ],
        table=table,
    )


def _scores(folds: Sequence[Fold], null: Float64, band: int) -> Section:
    names = list(folds[0]["scores"])
    table = [("view left out", *names, "mean of the neighbours")]
    values = np.array(
        [[*(fold["scores"][name][band] for name in names), null[k, band]] for k, fold in enumerate(folds)]
    )
    table += [(str(k), *(f"{v:.4f}" for v in row)) for k, row in enumerate(values)]
    table.append(("mean", *(f"{v:.4f}" for v in values.mean(axis=0))))
    lines = dict(zip(table[0][1:], values.T, strict=True))
    figure = curves(np.arange(len(folds)), lines, "view left out", "correlation")
    return Section(f"Scores, {BANDS[band]}", table=table, pictures=[(figure, f"Each view's score, {BANDS[band]}.")])


def _choices(folds: Sequence[Fold]) -> Section:
    names = [name for name in folds[0]["chosen"] if name != "backprojection"]
    table = [("view left out", *names), *((k, *(fold["chosen"][n] for n in names)) for k, fold in enumerate(folds))]
    return Section(
        "What was chosen without the view",
        [
            "The candidate with the least geometric mean of 1 - correlation over both bands, on the view left out together "
            "with this one. Strengths are tried from strong to weak, each going on from the one before: the choice is of "
            "strength and effort together. A choice at the end of its list (most passes, most iterations) might go further."
        ],
        table=table,
    )


def _corrections(folds: Sequence[Fold], names: Sequence[str], found: Refinement, angles: Float64) -> Section:
    table: list[Sequence[object]] = [("view left out", *(f"{n}, {b}" for b in BANDS for n in names))]
    values = np.array([[fold["corrections"][n] for n in names] for fold in folds])  # (views, corrections, bands)
    table += [(str(k), *(f"{v:.4f}" for v in rows.T.ravel())) for k, rows in enumerate(values)]
    table.append(("mean", *(f"{v:.4f}" for v in values.mean(axis=0).T.ravel())))
    return Section(
        "Before and after correction",
        [
            "M-MAP on the coarse grid: with the geometry and the contrast as imported, with small shifts of each panel "
            "estimated from the data, and with the gain of each view estimated too.",
            "From all views together (in no score), gains: " + ", ".join(f"{g:.3f}" for g in found.gains) + ".",
        ],
        table=table,
        pictures=[(_shifts(found, angles), "Shifts of the panel, from all views; in no score.")],
    )


def _shifts(found: Refinement, angles: Float64) -> Figure:
    lines = {"along the columns (dv)": found.shifts[:, 0], "along the rows (du)": found.shifts[:, 1]}
    return curves(np.degrees(angles), lines, "angle of the view, degrees", "shift of the panel, mm")


def _scaled(image: Float32, judge: Judge) -> Float64:
    slope, level = np.polyfit(image[judge.region], judge.measured[judge.region], 1)
    return np.asarray(slope * image + level)
