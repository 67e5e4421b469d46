"""The doubt study's report: what was asked and found, the intervals, the probabilities, the first-order check, one breast."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse

from palpate.arrays import AnyArray
from palpate.report.html_report import Section
from palpate.report.plot_axes import INK, canvas, finish
from palpate.studies.detection.config import RADIUS
from palpate.studies.doubt.config import (
    BODY,
    CONTACT,
    CONTRASTS,
    COVER,
    DEPTHS,
    DIAMETERS,
    LEVEL,
    LUMP,
    MARK,
    POISSON,
    PUSH,
    Setting,
)
from palpate.studies.doubt.judgement import JUDGED, Judgement
from palpate.studies.doubt.run import ITERATIONS
from palpate.tissue.lump_uncertainty import WEBER, WEBER_SOURCE
from palpate.tissue.named_tissues import tissue_properties
from palpate.volumes.grid import Grid
from palpate.volumes.plane_picture import draw_plane
from palpate.volumes.volume import Volume

TITLE = "How far the doubt can be trusted: intervals of a lump, and whether a hand feels it"
UNITS = {"diameter": "mm", "depth": "mm", "added": "N"}
WORDS = {"diameter": "diameter", "depth": "depth of the centre", "added": "added force"}
HELD, MISSED = "#0b6e99", "#d1495b"
ONE_ORDER = 3.0  # of the added force: how many decades are drawn


def sections(judgement: Judgement, setting: Setting, shown: Mapping[str, AnyArray]) -> list[Section]:
    """What was asked first, then all that was measured."""
    return [
        _conclusions(judgement),
        _set_up(judgement, setting),
        _intervals(judgement),
        _felt(judgement),
        _first_order(judgement, shown),
        _one_breast(setting, shown),
    ]


def _conclusions(judgement: Judgement) -> Section:
    claims = judgement.claims
    missed = [f"{c.what} is {c.value:.3g}, asked {c.asked}" for c in claims if not c.met]
    text = [
        f"{sum(c.met for c in claims)} of {len(claims)} targets are met. They, the breasts and the corrections' form were "
        f"fixed before these breasts were looked at. {len(judgement.train)} breasts taught the corrections, "
        f"{len(judgement.judge)} others judged them.",
    ]
    if missed:
        text.append(f"Missed: {'; '.join(missed)}.")
    body = [[c.what, f"{c.value:.3g}", c.asked, "yes" if c.met else "no"] for c in claims]
    return Section("Conclusions", text, [["target", "found", "asked", "met"], *body])


def _set_up(judgement: Judgement, setting: Setting) -> Section:
    kind, grid = setting.kind, setting.grid
    stiff, soft = (tissue_properties(name).young for name in (LUMP, BODY))
    assert stiff is not None
    assert soft is not None
    misses = np.array([float(r["miss"]) for r in (*judgement.train, *judgement.judge)])
    return Section(
        "Set-up",
        [
            f"Random breasts of {2 * kind.across:g} x {kind.out:g} x {kind.thick:g} mm between plates, {kind.glandular:.0%} "
            f"gland of power-law texture, as in the detection study, in voxels of {setting.fine:g} mm. Each has one lump, an "
            f"ellipsoid of {DIAMETERS[0]:g} to {DIAMETERS[1]:g} mm, its centre at most {DEPTHS:g} mm below the upper plate "
            f"with at least {COVER:g} mm between, its attenuation above fat {CONTRASTS[0]:g} to {CONTRASTS[1]:g} times that "
            f"of gland. Its stiffness is drawn from {stiff.text}, that of the rest from {soft.text}, both log-normal.",
            f"{len(setting.angles)} views over {max(setting.angles) - min(setting.angles):g}° at {RADIUS:g} mm, pixels of "
            f"{setting.pixel:g} mm, {setting.incident:g} photons a pixel, one energy, no scatter. Voxels of "
            f"{setting.voxel:g} x {setting.voxel:g} x {setting.slice_:g} mm, {grid.size:,} of them. A quadratic prior whose "
            f"strength the data choose, {setting.samples} samples.",
            f"A reader marks the lump in the plane of the panel, with a standard deviation of {MARK:g} mm each way; depth is "
            f"not told. Whether there is a lump is not asked. In {np.mean(misses > CONTACT / 2):.1%} of all breasts what was "
            f"found lies more than {CONTACT / 2:g} mm across from the lump; these count as the others do.",
            f"The push is {PUSH:g} mm deep with a patch of {CONTACT:g} mm radius, at the place of the upper plate over the "
            f"lump as found. The breast is held at the lower plate and the chest wall, Poisson's ratio {POISSON:g}. The true "
            f"force is that of the same push on a mesh of the true labels whose faces follow the lump, by finite elements, "
            f"with the true stiffness. The samples stiffen the elements of a coarser mesh of the breast as segmented.",
            "Not modelled: other energies, scatter, other kinds of breast, stiffness that varies within a tissue, large "
            "strain. The truths' stiffness comes from the range that the intervals assume.",
        ],
    )


def _intervals(judgement: Judgement) -> Section:
    def share(row: Mapping[str, float], words: str) -> str:
        low, high = row[f"{words} low"], row[f"{words} high"]
        return f"{row[f'{words} held']:.1%} ({low:.1%} to {high:.1%})"

    head = [
        "quantity",
        "raw: held",
        "corrected: held",
        "raw width",
        "corrected width",
        "population's width",
        "corrected / population",
    ]
    body = [
        [
            f"{WORDS[row['quantity']]}, {UNITS[row['quantity']]}",
            share(row, "raw"),
            share(row, "corrected"),
            *(f"{row[f'{name} width']:.3g}" for name in ("raw", "corrected", "population")),
            f"{row['corrected width'] / row['population width']:.2f}",
        ]
        for row in judgement.rows
    ]
    figure, panels = canvas(3, 4.0)
    for axes, name in zip(panels, JUDGED, strict=True):
        _truths_and_intervals(axes, judgement, name)
    return Section(
        "Intervals",
        [
            f"How many of the truths the intervals of {LEVEL:.0%} hold, with 95 % intervals of that share, and the median "
            f"width. Raw: between quantiles of the samples. Corrected: by the line, the extra spread and the quantiles of "
            f"the residuals that the other breasts taught, on logarithms. The population's interval is that of the truths "
            f"of the breasts that taught: what is known without a scan."
        ],
        [head, *body],
        [(figure, f"Corrected intervals of {LEVEL:.0%} of the breasts that judge over their truths; red ones miss.")],
    )


def _truths_and_intervals(axes: Axes, judgement: Judgement, name: str) -> None:
    truth = np.array([float(r[f"true|{name}"]) for r in judgement.judge])
    ends, held = judgement.intervals(name, True), judgement.held(name, True)
    for which, colour in ((held, HELD), (~held, MISSED)):
        axes.vlines(truth[which], ends[which, 0], ends[which, 1], color=colour, lw=1, alpha=0.6)
    low, high = float(truth.min()), float(truth.max())
    axes.plot([low, high], [low, high], color=INK, lw=1)
    if name == "added":
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_ylim(max(float(ends.min()), high * 10**-ONE_ORDER), float(ends.max()))
    finish(axes, WORDS[name], f"truth, {UNITS[name]}", f"interval, {UNITS[name]}")


def _felt(judgement: Judgement) -> Section:
    head = ["Weber fraction", "felt", "Brier: base rate", "Brier: raw", "Brier: corrected", "z of the corrected"]
    body = [
        [
            f"{row['weber']:.0%}",
            f"{row['felt']:.1%}",
            *(f"{row[name]:.3f}" for name in ("base rate", "raw", "corrected")),
            f"{row['z']:+.2f}",
        ]
        for row in judgement.felt_rows
    ]
    figure, panels = canvas(2, 4.2)
    for axes, corrected in zip(panels, (False, True), strict=True):
        rows = judgement.reliability(WEBER, corrected)
        x, y = (np.array([row[name] for row in rows]) for name in ("told", "felt"))
        bars = np.array([[row["felt"] - row["low"], row["high"] - row["felt"]] for row in rows]).T
        axes.plot([0, 1], [0, 1], color=INK, lw=1)
        axes.errorbar(x, y, np.maximum(bars, 0), fmt="o", capsize=3, color=HELD)
        for row in rows:
            axes.annotate(
                str(row["breasts"]), (row["told"], row["felt"]), (5, -10), textcoords="offset points", fontsize=8
            )
        axes.set_xlim(-0.03, 1.03)
        axes.set_ylim(-0.03, 1.03)
        words = "corrected" if corrected else "raw"
        finish(axes, f"{words} probabilities", "probability told", "share that is felt")
    return Section(
        "Whether it is felt",
        [
            f"A lump is felt if it adds more than a Weber fraction of the force without it. {WEBER:.0%} is judged; the "
            f"others are told. Measured are {WEBER_SOURCE}. The forces here are below 1 N, for which no source is at hand.",
            "The Brier score is the mean square of probability less outcome; that of the base rate tells every breast the "
            "share of the breasts that taught. z is Spiegelhalter's, standard normal for calibrated probabilities; below "
            "zero they are more cautious than need be, above it too sure.",
        ],
        [head, *body],
        [
            (
                figure,
                f"Reliability at a Weber fraction of {WEBER:.0%}: breasts in each fifth of the probabilities, their number, "
                f"and the share of them that is felt with its 95 % interval.",
            )
        ],
    )


def _first_order(judgement: Judgement, shown: Mapping[str, AnyArray]) -> Section:
    samples, linear = judgement.first_order
    ratio = samples / linear
    low, high = np.quantile(ratio, [0.1, 0.9]).tolist()
    expected = 1 / np.sqrt(2 * (len(judgement.judge[0]["samples|contrast"]) - 1))
    body = [
        (f"{n}{', as in the study' if n == ITERATIONS else ''}", f"{r:.2f}")
        for n, r in zip(shown["iterations"], shown["ratios"], strict=True)
    ]
    figure, panels = canvas(1, 4.0)
    most = 1e3 * float(max(samples.max(), linear.max())) * 1.05
    panels[0].plot([0, most], [0, most], color=INK, lw=1)
    panels[0].plot(1e3 * linear, 1e3 * samples, "o", ms=4, color=HELD)
    finish(
        panels[0],
        "standard deviation of the contrast",
        "to first order, 10⁻³ 1/mm",
        "of the samples, 10⁻³ 1/mm",
    )
    return Section(
        "To first order",
        [
            f"The contrast of the lump with fixed outline is linear in the volume, so that one linear solve gives its "
            f"standard deviation. In {len(ratio)} breasts the samples' is {np.median(ratio):.2f} times that in the median "
            f"({low:.2f} to {high:.2f} in eight of ten); by their number alone the samples scatter by {expected:.0%}. "
            f"The table tells what more iterations of each sample change in the breast shown below, "
            f"{int(shown['converged samples'])} samples under the same noise. Diameter and depth are not linear in the "
            "volume: for them there are only the samples.",
        ],
        [("iterations of a sample", "standard deviation of the contrast, samples / first order"), *body],
        [(figure, "Each point is a breast.")],
    )


def _one_breast(setting: Setting, shown: Mapping[str, AnyArray]) -> Section:
    figure, panels = canvas(3, 3.8)
    grid = setting.grid
    left, top = grid.axis("x")[0] - grid.spacing[2] / 2, grid.axis("y")[-1] + grid.spacing[1] / 2
    plane = Grid((1, *grid.shape[1:]), grid.spacing, grid.origin)
    inside = shown["truth"] > 0
    low, high = np.quantile(shown["truth"][inside], [0.02, 0.995]).tolist()
    for axes, name, title in zip(panels, ("truth", "map"), ("truth", "MAP estimate"), strict=False):
        slice_ = Volume(np.asarray(shown[name], np.float32)[None], plane)
        draw_plane(axes, slice_, np.mean(plane.bounds, axis=0), 0, (0.8 * low, high), y_up=True, words=title)
        axes.set(aspect="equal", xticks=[], yticks=[])
        tx, ty, _ = shown["true centre"]
        rx, ry, _ = shown["true radii"]
        axes.add_patch(Ellipse((tx - left, top - ty), 2 * rx, 2 * ry, fill=False, ec="#7fd1ae", lw=1.2))
        if name == "map":
            cx, cy, _ = shown["centre"]
            r = 2 * float(shown["radius"])
            axes.add_patch(Ellipse((cx - left, top - cy), r, r, fill=False, ec="#ff7f50", lw=1.2))
    band, place = 100 * shown["band"], shown["x"]
    panels[2].fill_between(place, band[0], band[2], color=HELD, alpha=0.25, lw=0)
    panels[2].plot(place, band[1], "o-", ms=3, color=HELD)
    panels[2].axhline(100 * WEBER, color=INK, lw=1, ls="--")
    finish(panels[2], f"force map along x, band of {LEVEL:.0%}", "mm from the lump as found", "added force, %")
    return Section(
        "One breast",
        ["The first breast that judges. The outlines are the lump's (green) and that found in the MAP estimate (red)."],
        pictures=[
            (
                figure,
                f"The slice through the lump; and the force that it adds to the push, along a line of places, with the "
                f"pointwise band of the samples, not corrected. Dashed: {WEBER:.0%}.",
            )
        ],
    )
