"""Sections of the dissertation's chapter: set-up, images, levels, convergence, samplers, ordered subsets, motions."""

from itertools import product

from palpate.report.html_report import Section
from palpate.report.tables import where
from palpate.studies.tomosynthesis import plots, volume_figures
from palpate.studies.tomosynthesis.config import HEIGHT, MOTIONS, PANEL, RADIUS, VIEWS
from palpate.studies.tomosynthesis.experiment_runner import GAPS
from palpate.studies.tomosynthesis.experiments import MOTION_DOSE, SAMPLING_DOSE, STARTS
from palpate.studies.tomosynthesis.report_inputs import MERITS, RUN, ReportInputs
from palpate.studies.tomosynthesis.tables import summary
from palpate.volumes.volume import Volume


def set_up(inputs: ReportInputs) -> Section:
    """What is scanned, and how images are judged."""
    s, grid = inputs.setting, inputs.setting.grid
    size, pitch = " x ".join(map(str, grid.shape)), s.views("circular").panels[0].pitch[0]
    text = [
        f"{VIEWS} focal spots lie on a circle of {RADIUS:g} mm radius, {HEIGHT:g} mm above a panel of {PANEL:g} mm with "
        f"pixels of {pitch:g} mm. The volume has {size} voxels (z, y, x) of "
        f"{' x '.join(f'{d:.3g}' for d in grid.spacing)} mm. Claims about M-MAP rest on {s.seeds} noise "
        f"realisations a dose, as do ordered subsets and motions. All else has {s.few}.",
        "The scans are line integrals in closed form through ellipsoids and boxes, "
        f"{s.subrays} x {s.subrays} rays a pixel, with Poisson noise: never a projection of voxels. No face of the slab "
        "lies on a face of voxels, since coarse grids would be flattered by that.",
        "NMSE of the full field is the dissertation's: it is dominated by the slab's walls and by the scale, which few "
        "views leave open. NMSE of the region is over the inserts and the plain slab within 12 mm around them, in their "
        "slices, free of window and level. There 1 means that nothing of the inserts is seen. SSIM is taken slice by "
        "slice inside the slab, 5 mm off its walls. Contrast to noise is the mean over the eight inserts, each against "
        "the plain slab around it. Spread in depth is the width at half of the artefact spread function of the ball at "
        "z = 60 mm.",
        "The prior is the dissertation's kind, edge-preserving over 26 neighbours (Lange's potential); its strength and edge "
        "are what the data choose.",
    ]
    picture = volume_figures.depth_slices({"phantom": inputs.image_quality.truth})
    caption = "The phantom at the depths of its inserts; window 0 to 0.045 1/mm, as in every slice below."
    return Section("Set-up", text, pictures=[(picture, caption)])


def images(inputs: ReportInputs) -> Section:
    """Every dose from both starts at all depths, and the line profiles."""
    pictures = []
    for start in STARTS:
        rows = {dose: _shown(inputs, dose, start) for dose in inputs.setting.doses}
        for dose, row in rows.items():
            caption = (
                f"{dose:,} photons, by coordinate descent from a {start} start, each at its own stop, at all depths."
            )
            pictures.append((volume_figures.depth_slices(row), caption))
        lines = {f"{dose:,} photons": row for dose, row in rows.items()}
        caption = (
            "Line profile through the slice at z = 48 mm, y = 18 mm: the box at the left, the ellipsoid in the middle; "
            f"{start} start."
        )
        pictures.append((volume_figures.profiles(lines), caption))
    table = summary(
        inputs.tables["convergence"], RUN, [*MERITS, ("passes", "passes", ".1f"), ("cpu_s", "processor s", ".2f")]
    )
    return Section("Images", ["Each run at its own stopping rule."], table, pictures)


def _shown(inputs: ReportInputs, dose: int, start: str) -> dict[str, Volume]:
    maps = {m: inputs.volume("convergence", dose, m, "descent", start) for m in ("F-MAP", "M-MAP-2", "M-MAP-3")}
    back = inputs.volume("direct", dose, "backprojection")
    return {"phantom": inputs.image_quality.truth, "backprojection": back, **maps}


def levels(inputs: ReportInputs) -> Section:
    """The dissertation's table of resolutions and iterations."""
    rows = inputs.tables["levels"]
    heads = ["method", "optimiser", "level", "voxels", "voxel_mm", "pixels", "pixel_mm"]
    doses = [f"iterations_{dose}" for dose in inputs.setting.doses]
    names = [*(h.replace("_", ", ") for h in heads), *(f"iterations, {dose:,}" for dose in inputs.setting.doses)]
    body = [[*(row[h] for h in heads), *(f"{row[d]:.1f}" for d in doses)] for row in rows]
    text = [
        "Resolution of volume (z, y, x) and projections, and iterations up to the stop: mean over seeds and starts."
    ]
    return Section("Levels", text, [names, *body])


def curves(inputs: ReportInputs) -> Section:
    """Log-posterior and errors against iterations and time."""
    pictures = []
    what = {"gap": "Log-posterior", "nmse": "NMSE of the full field", "nmse_region": "NMSE of the region"}
    for start, column, time in product(STARTS, what, (False, True)):
        figure = plots.convergence(inputs.records, inputs.setting.doses, start, column, time)
        words = f"{what[column]} against {'time' if time else 'iterations'}, {start} start, first scan."
        pictures.append((figure, words))
    text = [
        "The log-posterior is that of the finest level throughout: coarse iterates are interpolated for it. It is shown "
        "as what it lacks of the best that any run found. Large marks stand where the stopping rule ended a run; the "
        f"curves go on until {GAPS[-1]:.1%} or for some tens of iterations more. Processor time counts every thread. It is "
        "longer on a busy machine, as where this page was made; passes are not.",
        f"Dotted reference lines: the error of the backprojection, and {GAPS[0]:.0%} and {GAPS[-1]:.1%} above the best "
        "log-posterior. Figure 2.14 of the chapter has a reference line too; the text at hand does not say of what.",
    ]
    heads = [("gap_at_stop", "above the best at the stop", ".4f"), ("passes", "passes to the stop", ".1f")]
    heads += [(f"passes_to_{gap:g}", f"passes to {gap:.1%}, or spent", ".1f") for gap in GAPS]
    heads += [(f"cpu_to_{gap:g}", f"processor s to {gap:.1%}, or spent", ".2f") for gap in GAPS]
    rows = [row for row in inputs.tables["convergence"] if row["seed"] < inputs.setting.few]
    return Section("Convergence", text, summary(rows, RUN, heads), pictures)


def samplers(inputs: ReportInputs) -> Section:
    """Interpolators of volumes and down-samplers of projections."""
    pictures = []
    for by, other, fixed, what in (
        ("interpolation", "downsample", "sum", "Interpolators of coarse volumes (projections: summed counts)"),
        ("downsample", "interpolation", "linear", "Down-samplers of projections (volumes: linear)"),
    ):
        figure = plots.sampling(inputs.records, by, other, fixed)
        words = f"{what}; M-MAP-3 by descent, uniform start. Thin: the other scans. Dotted: F-MAP at its stop."
        pictures.append((figure, words))
    heads = [("nmse_region_at_finest_start", "NMSE, region, at the finest level's start", ".3f"), *MERITS]
    heads.append((f"passes_to_{GAPS[0]:g}", f"passes to {GAPS[0]:.0%}, or spent", ".1f"))
    table = summary(inputs.tables["sampling"], ("downsample", "interpolation"), heads)
    text = [f"{SAMPLING_DOSE:,} photons. Once the finest level has converged, its start is forgotten."]
    return Section("Interpolators and down-samplers", text, table, pictures)


def subsets(inputs: ReportInputs) -> Section:
    """Ordered subsets of the views beside what has none."""
    passes = inputs.setting.passes
    rows = [{**row, "reached": float(row["reached"])} for row in inputs.tables["subsets"]]
    heads = [("passes", "passes, or spent", ".1f"), ("reached", "share of scans that came there", ".2f")]
    heads += [("cpu_s", "processor s", ".2f"), ("others", "passes without subsets", ".1f")]
    heads += [("others_s", "processor s without subsets", ".2f")]
    text = [
        f"On the finest grid, from the backprojection, until the log-posterior that descent has after {passes} passes, or "
        f"for {2 * passes}. A pass is a projection and a backprojection of all {VIEWS} views; one that is made again, since "
        "it raised the objective, counts again. Plain: separable surrogates (Erdogan and Fessler 1999). With momentum: "
        "Nesterov's. Each subset costs a pass over the neighbours more, which processor time counts and passes do not. "
        "Without subsets: the better of descent and momentum (memory gradient)."
    ]
    figure = plots.subsets(inputs.records, inputs.setting.doses)
    caption = "Log-posterior against passes by number of subsets, first scan."
    return Section("Ordered subsets", text, summary(rows, ("dose", "momentum", "subsets"), heads), [(figure, caption)])


def motions(inputs: ReportInputs) -> Section:
    """Circular, linear and hypocycloidal paths of the source."""
    shown = {}
    for method, name in (("backprojection", "backprojection"), ("map", "M-MAP-3")):
        for motion in MOTIONS:
            shown[f"{name}, {motion}"] = inputs.volume("motions", MOTION_DOSE, method, motion=motion)
    picture = volume_figures.depth_slices(shown)
    caption = "The ball at z = 70 mm in the slices below it: a ring by circular motion, a streak by linear motion."
    heads = [*MERITS, ("ring", "ring over centre", ".2f"), ("streak", "along x over y", ".2f")]
    table = summary(inputs.tables["motions"], ("method", "motion"), heads)
    z = inputs.setting.grid.axis("z")[inputs.image_quality.slices]
    truth = inputs.image_quality.spread(inputs.image_quality.truth.values)
    groups = []
    for motion in MOTIONS:
        runs = where(inputs.records, experiment="motions", seed=0, motion=motion)
        groups.append((f"{motion} motion", [(r["method"].replace("map", "M-MAP-3"), r) for r in runs]))
    asf = plots.depth_spread(groups, z, truth), "Artefact spread function of the ball at z = 60 mm."
    text = [
        f"{MOTION_DOSE:,} photons. All paths reach {RADIUS:g} mm from the middle. The hypocycloid has three cusps "
        "(trispiral). Last columns: what is left of the ball at z = 70 mm in the slice at z = 38 mm."
    ]
    return Section("Circular, linear and hypocycloidal motion", text, table, [(picture, caption), asf])
