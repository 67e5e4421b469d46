"""The detection study's report: what MAP by resolution reaches, all measures, images, and what was not modelled."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from palpate.arrays import AnyArray, Float32
from palpate.report.figures import slice_table
from palpate.report.html_report import Section
from palpate.report.plot_axes import canvas, finish
from palpate.report.tables import where
from palpate.studies.detection.acquisition import DENSE, expose, noise, path_lengths
from palpate.studies.detection.config import BEAM, FALSE, GAP, KV, MASS, RADIUS, RESAMPLES, SLACK, WIDTH, Kind, Setting
from palpate.studies.detection.judgement import Claim, Judgement
from palpate.studies.detection.methods import EDGES, JUDGED, OURS, images
from palpate.studies.detection.run import PROJECTIONS, random_case, true_image
from palpate.volumes.grid import Grid
from palpate.volumes.notebook_figure import line_style
from palpate.volumes.volume import Volume

TITLE = "Which lesions are found: random breasts, model observers"
SHOWN = 0  # seed of the breast that is shown, of the middle kind
ROWS = JUDGED, EDGES, "SART, 1 pass", "SIRT, 20 iterations", "FBP, cutoff 1"
DIFFERENCE = " found"  # what a measure ends with whose rivals are compared by difference


def shown_kind(setting: Setting) -> Kind:
    """Of the breast that is shown."""
    return setting.kinds[len(setting.kinds) // 2]


def shown_images(setting: Setting, scatter: Float32) -> dict[str, AnyArray]:
    """Slices through the middle mass of one breast, by "dose|method", and "truth", (y, x) 1/mm."""
    kind = shown_kind(setting)
    breast, signals, _ = random_case(kind, SHOWN, setting)
    views, grid = setting.views(kind), setting.grid(kind)
    exposure = expose(path_lengths(breast, views), scatter, views, signals)
    masses = signals.centre[[name == MASS for name in signals.size]]
    at = int(np.argmin(np.abs(grid.axis("z") - np.median(masses[:, 2]))))
    found = {"truth": true_image(breast, kind, grid)[0][at]}
    for dose in (setting.doses[0], setting.doses[-1]):
        normal = np.random.default_rng([SHOWN, dose]).standard_normal(exposure.signal.shape, dtype=np.float32)
        for name, values in images(noise(exposure, dose, kind.thick, normal), grid):
            if name in ROWS:
                found[f"{dose}|{name}"] = values[at].copy()
    return found


def sections(judgement: Judgement, shown: Mapping[str, AnyArray]) -> list[Section]:
    """What was asked first, then all that was measured."""
    return [
        _conclusions(judgement),
        _set_up(judgement.setting),
        *(_measures(judgement, dose) for dose in judgement.setting.doses),
        _images(judgement.setting, shown),
    ]


def _conclusions(judgement: Judgement) -> Section:
    claims = judgement.claims
    met = [claim for claim in claims if claim.met]
    missed = [claim for claim in claims if not claim.met]
    text = [
        f"Judged is MAP with a quadratic prior whose resolution is {WIDTH:g} voxels, within the object's hull. "
        f"At each dose and for each measure it is compared with the best rival, chosen by the result itself. "
        f"{len(met)} of {len(claims)} targets are met. What palpate does if nothing is asked is {EDGES}.",
        f"A target is met if the lower end of the 95 % interval lies above it, or below it by at most {SLACK:g}. The "
        f"interval is that of {RESAMPLES} draws of breasts with replacement within each kind, the same for both. Targets, "
        f"breasts and observers were fixed before these breasts were looked at.",
    ]
    if missed:
        text.append(f"Missed: {'; '.join(map(_sentence, missed))}.")
    head = ["quanta", "measure", "best rival", "MAP and rival", "95 %", "asked", "met"]
    body = [[f"{c.dose:,}", c.measure, c.rival, *_numbers(c), "yes" if c.met else "no"] for c in claims]
    return Section(
        "Conclusions",
        text,
        [head, *body],
        [(_ratios(judgement), "MAP by resolution and the best rival, 95 % intervals.")],
    )


def _sentence(claim: Claim) -> str:
    value, interval, least = _numbers(claim)
    return f"{claim.measure} at {claim.dose:,} quanta is {value} ({interval}) against {claim.rival}, asked {least}"


def _numbers(claim: Claim) -> list[str]:
    form = "+.2f" if claim.measure.endswith(DIFFERENCE) else ".3f"
    return [f"{claim.value:{form}}", f"{claim.low:{form}} to {claim.high:{form}}", f"{claim.least:{form}}"]


def _ratios(judgement: Judgement) -> Figure:
    figure, panels = canvas(2, 4.2)
    names = list(dict.fromkeys(c.measure for c in judgement.claims))
    for axes, ends in zip(panels, (False, True), strict=True):
        shown = [name for name in names if name.endswith(DIFFERENCE) == ends]
        for i, dose in enumerate(judgement.setting.doses):
            claims = [c for name in shown for c in judgement.claims if c.measure == name and c.dose == dose]
            x = np.arange(len(shown)) + 0.22 * (i - 1)
            y = np.array([c.value for c in claims])
            bars = np.array([[c.value - c.low, c.high - c.value] for c in claims]).T
            style = line_style(i) | {"ls": "none", "markevery": 1, "ms": 6}
            axes.errorbar(x, y, np.maximum(bars, 0), capsize=3, label=f"{dose:,} quanta", **style)
            for place, claim in zip(x, claims, strict=True):
                axes.plot([place - 0.1, place + 0.1], [claim.least] * 2, color="#1c2530", lw=1)
        axes.axhline(0 if ends else 1, color="#1c2530", lw=0.5, ls=":")
        axes.set_xticks(range(len(shown)), shown)
        what = "difference of the shares found" if ends else "ratio"
        finish(axes, f"MAP by resolution and best rival: {what}", "", "MAP − rival" if ends else "MAP / rival")
    panels[0].legend(frameon=False, fontsize=8)
    return figure


def _set_up(setting: Setting) -> Section:
    breasts = ", ".join(
        f"{k.name} ({k.glandular:.0%} gland, {2 * k.across:g} x {k.out:g} x {k.thick:g} mm)" for k in setting.kinds
    )
    sizes = " and ".join(f"{d:g}" for d in setting.sizes)
    return Section(
        "Set-up",
        [
            f"{setting.seeds} breasts of each kind: {breasts}. Gland and fat have the texture of a random field whose power "
            f"falls with the cube of frequency, crossed by ligaments and wrapped in skin, in voxels of {setting.fine:g} mm.",
            f"Up to {setting.masses} masses of {setting.mass[0]:g} mm a breast add gland in place of fat, most in their "
            f"middle ({setting.mass[1]:.0%}). Up to {setting.calcifications} spheres of each of {sizes} mm are the "
            f"calcifications, {DENSE:.0%} of whose length is calcium oxalate. Path lengths within them are in closed form.",
            f"{len(setting.angles)} views over {max(setting.angles) - min(setting.angles):g}° at {RADIUS:g} mm, pixels of "
            f"{setting.pixel:g} mm, {KV:g} kV {BEAM}, {GAP:g} mm of air below the breast, no grid. The panel integrates "
            f"energy; scatter is that of a Monte Carlo of a body of the same outline with fat outside and a denser core. The "
            f"noise is that of the quanta. Every method is given the same estimate of scatter, which knows the compressed "
            f"thickness and the beam, and takes the tissue for half gland. Doses are quanta a pixel in the open beam.",
            f"Images have voxels of {setting.voxel:g} mm in slices of {setting.slice_:g} mm. Observers see a known place "
            "through Laguerre-Gauss channels in two depths of focus. Their weights are Hotelling's, taught on other breasts. "
            "d_A is the distance of ratings with and without a signal by ranks, √2 Φ⁻¹(area under the ROC curve). Found is "
            f"the share of signals rated above all but {FALSE:.1%} of the places without. RMSE is "
            "that of the image without signals, all voxels in the breast, "
            "against the attenuation for the beam behind half of it.",
            "Not modelled: blur of the panel and the focal spot, lag, motion, a reader's search, real lesions' shapes.",
        ],
    )


def _measures(judgement: Judgement, dose: int) -> Section:
    rows = where(judgement.rows, dose=dose)
    names = [name for name in rows[0] if name not in ("dose", "method")]
    heads = ["method", *("RMSE, 1/mm" if name == "1 / RMSE" else name for name in names)]

    def cell(name: str, value: float | None) -> str:
        if value is None:
            return ""
        return f"{1 / value:.5f}" if name == "1 / RMSE" else f"{value:.2f}"

    body = [[row["method"], *(cell(name, row.get(name)) for name in names)] for row in rows]
    text = [
        f"The first {len(OURS)} are palpate's. The last line, {PROJECTIONS}, is a linear observer of all views without any "
        "reconstruction: a reference, not a bound, since its channels are coarse too."
    ]
    return Section(f"{dose:,} quanta", text, [heads, *body])


def _images(setting: Setting, shown: Mapping[str, AnyArray]) -> Section:
    kind = shown_kind(setting)
    (_, dy, dx), doses = setting.grid(kind).spacing, (setting.doses[0], setting.doses[-1])
    grid = Grid((1, *shown["truth"].shape), (1.0, dy, dx))

    def volume(name: str) -> tuple[Volume, float]:
        return Volume(np.maximum(shown[name], 0)[None], grid), 0.0

    rows = {name: [volume(f"{dose}|{name}") for dose in doses] for name in ROWS}
    inside = shown["truth"] > 0
    low, high = np.quantile(shown["truth"][inside], [0.01, 0.99]).tolist()
    window = low - 0.3 * (high - low), high + 0.3 * (high - low)
    heads = [f"{dose:,} quanta" for dose in doses]
    everything = {"truth": [volume("truth")] * len(doses), **rows}
    caption = f"One slice of a {kind.name} breast. Black to white {window[0]:.3f} to {window[1]:.3f} 1/mm."
    picture = slice_table(everything, [window] * len(everything), heads)
    return Section(
        "Images", ["The truth is shown without its masses and calcifications."], pictures=[(picture, caption)]
    )
