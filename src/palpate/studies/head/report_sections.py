"""The head study's report: who predicts the left-out views best, before and after correction, in words, tables, pictures."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy import ndimage

from palpate.arrays import AnyArray, Float32, Float64
from palpate.reconstruction.self_calibration import Calibration
from palpate.report.figures import curves, projections, slice_table
from palpate.report.html_report import Section
from palpate.report.plot_axes import canvas, finish
from palpate.studies.head.leave_one_view_out import LEAST, WORSE, ViewScore, path_of
from palpate.volumes.notebook_figure import line_style
from palpate.volumes.volume import Volume

TITLE = "A head from portal images: views predicted from the others"
BANDS = ("full band", "high-passed")
NULL = "mean of the neighbours"
Fold = Mapping[str, Any]
Table = list[Sequence[object]]
Lists = Mapping[str, Sequence[Sequence[str]]]


def sections(
    folds: Sequence[Fold],
    null: Float64,
    lists: Lists,
    everyone: Calibration,
    angles: Float64,
    voxel: str,
) -> list[Section]:
    """Scores first, then what was chosen and what correction gains.

    lists: for each method and view the candidates that were tried for its choice, in order. everyone: gains and shifts
    from all views, angles (views,) radians.
    """
    return [
        _conclusions(folds, null, lists),
        _judging(folds, voxel),
        *(_scores(folds, null, band) for band in (0, 1)),
        _choices(folds, lists),
        _corrections(folds, everyone, angles),
    ]


def predicted_section(score: ViewScore, view: int, images: Mapping[str, Float32]) -> Section:
    """One left-out view as measured, as predicted, and what the predictions miss."""
    box = _box(score)
    scaled = {name: _scaled(image, score)[box] for name, image in images.items()}
    measured, region = score.measured[box], score.region[box]
    fine = {"measured": score.detail(score.measured), **{n: score.detail(_scaled(i, score)) for n, i in images.items()}}
    missed = [(measured - image) * region for image in scaled.values()]
    spread = 3 * float(np.std([m[region] for m in missed]))
    detail = 3 * float(fine["measured"][score.region].std())
    low, high = np.quantile(measured[region], [0.02, 0.998]).tolist()
    return Section(
        f"View {view}, which no method had seen",
        ["Every image at the gain and offset at which it is nearest to the measured one."],
        pictures=[
            (
                projections(
                    np.stack([measured, *scaled.values()]),
                    ["measured", *scaled],
                    window=(low - 0.1 * (high - low), high),
                ),
                "Line integrals.",
            ),
            (
                projections(np.stack(missed), list(scaled), window=(-spread, spread)),
                f"What is missed, measured less predicted; black to white ±{spread:.3f}.",
            ),
            (
                projections(
                    np.stack([image[box] * region for image in fine.values()]), list(fine), window=(-detail, detail)
                ),
                f"High-passed, where it is judged; black to white ±{detail:.3f}.",
            ),
        ],
    )


def slices_section(view: int, slices: Mapping[str, Volume], depths: Sequence[float]) -> Section:
    """Coronal slices of every method at these depths, made without the view."""
    rows = {name: [(volume, z) for z in depths] for name, volume in slices.items()}
    windows = []
    for volume in slices.values():
        _, rim, side = np.array(volume.grid.shape) // (1, 5, 4)
        windows.append(tuple(np.quantile(volume.values[:, rim:-rim, side:-side], [0.01, 0.995]).tolist()))
    heads = [f"z = {z:g} mm" for z in depths]
    caption = f"Coronal slices through the head, from all views but {view}, at the settings chosen there without it. "
    return Section(
        "Slices",
        ["The views span 40°: what lies above and below a slice is smeared into it."],
        pictures=[
            (
                slice_table(rows, windows, heads, y_up=True),
                caption + "Black and white are each method's own 1 % and 99.5 % in the middle.",
            )
        ],
    )


def ranks(folds: Sequence[Fold], null: Float64) -> dict[str, list[list[int]]]:
    """For each rival and band, the views on which M-MAP does not score higher."""
    ours, rivals = _scored(folds, null)
    return {
        name: [np.flatnonzero(ours[:, band] <= theirs[:, band]).tolist() for band in (0, 1)]
        for name, theirs in rivals.items()
    }


def at_the_end(folds: Sequence[Fold], lists: Lists) -> dict[str, tuple[int, int]]:
    """For each method with a choice, on how many views its first and its last candidate were chosen.

    Of several paths (relaxations), the first and last of the path that was chosen.
    """
    ends = {}
    for name, of_views in lists.items():
        first = last = 0
        for fold, names in zip(folds, of_views, strict=True):
            chosen = fold["chosen"][name]
            path = [each for each in names if path_of(each) == path_of(chosen)]
            first, last = first + (chosen == path[0]), last + (chosen == path[-1])
        if len(of_views[0]) > 1:
            ends[name] = first, last
    return ends


def _scored(folds: Sequence[Fold], null: Float64) -> tuple[Float64, dict[str, Float64]]:
    ours = np.array([fold["scores"]["M-MAP"] for fold in folds])
    names = [name for name in folds[0]["scores"] if name != "M-MAP"]
    return ours, {**{name: np.array([fold["scores"][name] for fold in folds]) for name in names}, NULL: null}


def _conclusions(folds: Sequence[Fold], null: Float64, lists: Lists) -> Section:
    ours, rivals = _scored(folds, null)
    table: Table = [("M-MAP against", *(f"better on, {b}" for b in BANDS), *(f"error ratio, {b}" for b in BANDS))]
    for name, lost in ranks(folds, null).items():
        won = [
            f"{len(folds) - len(views)} of {len(folds)}" + (f", not on {', '.join(map(str, views))}" if views else "")
            for views in lost
        ]
        ratio = np.exp(np.mean(np.log((1 - ours) / (1 - rivals[name])), axis=0))
        table.append((name, *won, *(f"{r:.2f}" for r in ratio)))
    beaten = [name for name, lost in ranks(folds, null).items() if not any(lost)]
    open_ = [name for name in rivals if name not in beaten]
    closest = int(np.argmax(((1 - ours) / (1 - null))[:, 0]))
    gained = np.mean([np.subtract(f["corrections"]["shifts"], f["corrections"]["none"]) for f in folds], axis=0)
    ends = at_the_end(folds, lists).items()
    text = [
        f"On every one of the {len(folds)} views, full band and high-passed, M-MAP predicts better than: "
        f"{', '.join(beaten) or 'none'}. Not on every view better than: {', '.join(open_) or 'none'}.",
        f"The neighbours' mean comes nearest on view {closest}: {null[closest, 0]:.5f} against {ours[closest, 0]:.5f}, "
        "full band.",
        f"Correcting shifts changes the scores on the coarse grid by {gained[0]:+.5f} (full band) and {gained[1]:+.4f} "
        "(high-passed) on the mean.",
        "Views for which the first or the last of a method's candidates was chosen, so that a longer list might do better: "
        + ", ".join(f"{name} {first + last}" for name, (first, last) in ends)
        + ".",
        "Error is 1 - r, r the correlation with what was measured. Ratios are geometric means over the views of M-MAP's "
        "error over the other's: below 1 M-MAP predicts better.",
    ]
    return Section("Conclusions", text, table=table)


def _judging(folds: Sequence[Fold], voxel: str) -> Section:
    return Section(
        "How it is judged",
        [
            f"{len(folds)} megavoltage portal images of an anthropomorphic head phantom. Each is left out in turn and "
            f"predicted from the others by projecting what each method makes of them, with voxels of {voxel} mm "
            "(z, y, x).",
            "Scores are correlations r with what was measured, inside the field and behind the head. They are blind to the "
            "gain and the offset of the view that is judged. High-passed: without what is coarser than about 8 pixels.",
            "Nothing was chosen with the view that is judged. Each method's strength, iterations or cut-off is the one that "
            "best predicted one or two other views, from fits that saw neither them nor this one. Gains and shifts were "
            "estimated from the others alone. The panel of the left-out view was put where its neighbours' shifts say. "
            "The grid and the lists of candidates were set beforehand, by people who had seen scores of earlier versions.",
            "The null model is the mean of the two neighbouring views; the first and the last view have but one neighbour, "
            "which then stands for the mean, and every method must extrapolate there.",
            "RTK's SART is another code's, from the same images."
            if "RTK's SART" in folds[0]["scores"]
            else "RTK's SART, the reference from outside, is left out: itk-rtk is not installed here.",
        ],
    )


def _scores(folds: Sequence[Fold], null: Float64, band: int) -> Section:
    ours, rivals = _scored(folds, null)
    lines = {"M-MAP": ours[:, band], **{name: theirs[:, band] for name, theirs in rivals.items()}}
    values = np.stack(list(lines.values()), axis=1)
    table: Table = [("view left out", *lines)]
    table += [(str(k), *(f"{v:.5f}" for v in row)) for k, row in enumerate(values)]
    table.append(("mean", *(f"{v:.5f}" for v in values.mean(axis=0))))
    errors = {name: 1 - line for name, line in lines.items()}
    figure = curves(np.arange(len(folds)), errors, "view left out", "1 - correlation", log=True)
    figure.axes[0].set_xticks(range(len(folds)))
    return Section(f"Scores, {BANDS[band]}", table=table, pictures=[(figure, f"Error of each view, {BANDS[band]}.")])


def _choices(folds: Sequence[Fold], lists: Lists) -> Section:
    names = ["correction", *at_the_end(folds, lists)]
    table: Table = [("view left out", *names), *((k, *(f["chosen"][n] for n in names)) for k, f in enumerate(folds))]
    table.append(("first, last of the list", "", *(f"{a}, {b}" for a, b in at_the_end(folds, lists).values())))
    return Section(
        "What was chosen without the view",
        [
            "The candidate with the least geometric mean of 1 - correlation over both bands, on the views left out together "
            "with this one. Strengths of M-MAP are tried from strong to weak, each going on from the one before until an "
            f"iteration lowers the objective by less than {LEAST:g} of it. A list of passes or iterations goes on until the "
            f"last {WORSE} predict worse than one before them, for each relaxation. The last line counts the views for "
            "which the first and the last candidate of a list was chosen."
        ],
        table=table,
    )


def _corrections(folds: Sequence[Fold], found: Calibration, angles: Float64) -> Section:
    names = list(folds[0]["corrections"])
    table: Table = [("view left out", *(f"{n}, {b}" for b in BANDS for n in names))]
    values = np.array([[fold["corrections"][n] for n in names] for fold in folds])  # (views, corrections, bands)
    table += [(str(k), *(f"{v:.4f}" for v in rows.T.ravel())) for k, rows in enumerate(values)]
    table.append(("mean", *(f"{v:.4f}" for v in values.mean(axis=0).T.ravel())))
    changes, panels = canvas(2, 3.6)
    for band, axes in enumerate(panels):
        for i, name in enumerate(names[1:], 1):
            axes.plot(values[:, i, band] - values[:, 0, band], lw=1.5, label=f"{name} corrected", **line_style(i))
        axes.axhline(0, color="#5b6775", lw=0.8)
        axes.set_xticks(range(len(folds)))
        finish(axes, BANDS[band], "view left out", "change of the correlation")
    panels[0].legend(frameon=False, fontsize=8)
    return Section(
        "Before and after correction",
        [
            "M-MAP on the coarse grid: with the geometry and the contrast as imported, with small shifts of each panel "
            "estimated from the data, and with the gain of each view estimated too."
        ],
        table=table,
        pictures=[
            (changes, "What correction changes on each view left out; above 0 it helps."),
            (_found(found, angles), "Shifts and gains as estimated from all views together; in no score."),
        ],
    )


def _found(found: Calibration, angles: Float64) -> Figure:
    figure, (left, right) = canvas(2, 3.6)
    degrees = np.degrees(angles)
    for i, name in enumerate(("along the columns (dv)", "along the rows (du)")):
        left.plot(degrees, found.shifts[:, i], lw=1.5, label=name, **line_style(i))
    left.legend(frameon=False, fontsize=8)
    right.plot(degrees, found.gains, "o-", ms=3.5, lw=1.5)
    finish(left, "shift of the panel", "angle of the view, degrees", "mm")
    finish(right, "gain of the line integrals", "angle of the view, degrees", "of the mean")
    return figure


def _box(score: ViewScore) -> tuple[slice, slice]:
    """Around the largest connected part of what is judged: the head."""
    parts, count = ndimage.label(score.region)
    largest = 1 + int(np.argmax(np.bincount(parts.ravel(), minlength=count + 1)[1:]))
    rows, columns = ndimage.find_objects(parts)[largest - 1]
    return rows, columns


def _scaled(image: AnyArray, score: ViewScore) -> Float64:
    slope, level = np.polyfit(image[score.region], score.measured[score.region], 1)
    return np.asarray(slope * image + level)
