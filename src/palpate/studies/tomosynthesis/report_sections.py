"""The report's sections, in the order of the dissertation's chapter and then beyond."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from palpate.report.html_report import Section
from palpate.report.tables import Row, distinct, where
from palpate.studies.tomosynthesis import conclusions, plots, volume_figures
from palpate.studies.tomosynthesis.conclusions import Factor
from palpate.studies.tomosynthesis.config import HEIGHT, PANEL, RADIUS, VIEWS, Setting
from palpate.studies.tomosynthesis.experiments import GAPS, MOTION_DOSE, SAMPLING_DOSE, Record, cell_name
from palpate.studies.tomosynthesis.image_quality import ImageQuality
from palpate.studies.tomosynthesis.tables import summary
from palpate.volumes.io import read_volume
from palpate.volumes.volume import Volume

MERITS = (
    ("nmse", "NMSE, full field", ".4f"),
    ("nmse_region", "NMSE, region", ".3f"),
    ("ssim", "SSIM", ".3f"),
    ("cnr", "contrast to noise", ".2f"),
    ("depth_mm", "spread in depth, mm", ".1f"),
)

RUN = ("dose", "method", "optimiser", "start")  # what tells the runs of the comparison apart


@dataclass(frozen=True)
class ReportSections:
    """Sections from records, tables and stored volumes."""

    folder: Path
    image_quality: ImageQuality
    records: Sequence[Record]
    tables: dict[str, list[Row]]
    found: Sequence[Factor]

    @property
    def setting(self) -> Setting:
        """Of the study."""
        return self.image_quality.setting

    def sections(self) -> list[Section]:
        """All of them."""
        first = [*self._conclusions(), self._set_up(), self._images(), self._levels(), self._curves(), self._sampling()]
        then = [self._motions(), self._baselines(), self._priors(), self._strengths(), self._doses(), self._files()]
        return first + then

    def _volume(self, experiment: str, dose: int, *more: str) -> Volume:
        return read_volume(self.folder / "volumes" / f"{cell_name(experiment, dose, 0, *more)}.nii.gz")

    def _conclusions(self) -> list[Section]:
        text = [
            "Every number here is computed in this run; the tables beside this report hold what it is made from. "
            "Factors are geometric means over the seeds (least to most), errors means (least to most; from five seeds on ± "
            "standard deviation). Times are processor time of all threads.",
            *conclusions.headlines(self.found),
        ]
        claims = [["claim", "here"], *conclusions.claims(self.found, self.tables, self.setting)]
        asked = [
            "As these scans show them. Above 1, M-MAP is better; a claim holds where so by more than 2 % on every scan."
        ]
        compared = [
            "Above 1, multi-resolution is better. Time is counted to the log-posterior that M-MAP-3 had when its rule "
            "ended it; ≥ where F-MAP had not come so far when its run was given up."
        ]
        ranked = [
            "A choice is named if it is better on every scan and by more than 2 % on the mean. Rivals of M-MAP-3 are taken "
            "at the iterate that suits them best, chosen by the truth. M-MAP-3 is taken at its own stop, once with the "
            "strength that the data choose and once with the one that suits it best."
        ]
        return [
            Section("Conclusions", text),
            Section("The dissertation's claims", asked, claims),
            Section("Fixed resolution and multi-resolution", compared, conclusions.factor_table(self.found)),
            Section("What wins", ranked, conclusions.findings(self.tables, self.setting)),
        ]

    def _set_up(self) -> Section:
        s, grid = self.setting, self.setting.grid
        size, pitch = " x ".join(map(str, grid.shape)), s.views("circular").panels[0].pitch[0]
        text = [
            f"{VIEWS} focal spots lie on a circle of {RADIUS:g} mm radius, {HEIGHT:g} mm above a panel of {PANEL:g} mm with "
            f"pixels of {pitch:g} mm. The volume has {size} voxels (z, y, x) of "
            f"{' x '.join(f'{d:.3g}' for d in grid.spacing)} mm. Comparisons of chapter 2 have {s.seeds} noise "
            f"realisations a dose. Those beyond it have {s.few}.",
            "The scans are line integrals in closed form through ellipsoids and boxes, "
            f"{s.subrays} x {s.subrays} rays a pixel, with Poisson noise: never a projection of voxels. No face of the slab "
            "lies on a face of voxels, since coarse grids would be flattered by that.",
            "NMSE of the full field is the dissertation's: it is dominated by the slab's walls and by the scale, which few "
            "views leave open. NMSE of the region is over the inserts and the plain slab within 12 mm around them, in their "
            "slices, free of window and level. There 1 means that nothing of the inserts is seen. SSIM is taken slice by "
            "slice inside the slab, 5 mm off its walls. Contrast to noise is the mean over the eight inserts, each against "
            "the plain slab around it. Spread in depth is the width at half of the artefact spread function of the ball at "
            "z = 60 mm.",
        ]
        picture = volume_figures.depth_slices({"phantom": self.image_quality.truth})
        caption = "The phantom at the depths of its inserts; window 0 to 0.045 1/mm, as in every slice below."
        return Section("Set-up", text, pictures=[(picture, caption)])

    def _images(self) -> Section:
        pictures = []
        for start in ("uniform", "backprojection"):
            rows = {dose: self._shown(dose, start) for dose in self.setting.doses}
            caption = (
                f"Slice at z = 48 mm, by coordinate descent from a {start} start, each at its own stop; rows: photons."
            )
            pictures.append((volume_figures.methods({f"{dose:,}": row for dose, row in rows.items()}), caption))
        for dose in (self.setting.doses[0], self.setting.doses[-1]):
            caption = f"All depths at {dose:,} photons, descent from the backprojection."
            pictures.append((volume_figures.depth_slices(rows[dose]), caption))
        lines = {f"{dose:,} photons": row for dose, row in rows.items()}
        caption = (
            "Line profile through the slice at z = 48 mm, y = 18 mm: the box at the left, the ellipsoid in the middle."
        )
        pictures.append((volume_figures.profiles(lines), caption))
        table = summary(self.tables["convergence"], RUN, [*MERITS, ("cpu_s", "processor s", ".2f")])
        return Section("Images", ["Each run at its own stopping rule."], table, pictures)

    def _shown(self, dose: int, start: str) -> dict[str, Volume]:
        maps = {m: self._volume("convergence", dose, m, "descent", start) for m in ("F-MAP", "M-MAP-2", "M-MAP-3")}
        back = self._volume("baselines", dose, "backprojection")
        return {"phantom": self.image_quality.truth, "backprojection": back, **maps}

    def _levels(self) -> Section:
        rows = self.tables["levels"]
        heads = ["method", "optimiser", "level", "voxels", "voxel_mm", "pixels", "pixel_mm"]
        doses = [f"iterations_{dose}" for dose in self.setting.doses]
        names = [*(h.replace("_", ", ") for h in heads), *(f"iterations, {dose:,}" for dose in self.setting.doses)]
        body = [[*(row[h] for h in heads), *(f"{row[d]:.1f}" for d in doses)] for row in rows]
        text = [
            "Resolution of volume (z, y, x) and projections, and iterations up to the stop: mean over seeds and starts."
        ]
        return Section("Levels", text, [names, *body])

    def _curves(self) -> Section:
        pictures = []
        what = {"gap": "Log-posterior", "nmse": "NMSE of the full field", "nmse_region": "NMSE of the region"}
        for start, by_time in (("uniform", (False, True)), ("backprojection", (True,))):
            for column, time in product(what, by_time):
                figure = plots.convergence(self.records, self.setting.doses, start, column, time)
                words = f"{what[column]} against {'time' if time else 'iterations'}, {start} start, first seed."
                pictures.append((figure, words))
        text = [
            "The log-posterior is that of the finest level throughout: coarse iterates are interpolated for it. It is shown "
            "as what it lacks of the best that any run found. Dots mark where the stopping rule ended a run; the curves go "
            f"on until {GAPS[-1]:.1%} or for some tens of iterations more. Processor time counts every thread.",
        ]
        heads = [("gap_at_stop", "above the best at the stop", ".4f"), ("cpu_s", "s to the stop", ".2f")]
        heads += [(f"cpu_s_to_{gap:g}", f"s to {gap:.1%}, or spent", ".2f") for gap in GAPS]
        table = summary(self.tables["convergence"], RUN, heads)
        return Section("Convergence", text, table, pictures)

    def _sampling(self) -> Section:
        pictures = []
        for by, other, fixed, what in (
            ("interpolation", "downsample", "sum", "Interpolators of coarse volumes (projections: summed counts)"),
            ("downsample", "interpolation", "linear", "Down-samplers of projections (volumes: linear)"),
        ):
            figure = plots.sampling(self.records, by, other, fixed)
            pictures.append((figure, f"{what}; M-MAP-3 by descent, uniform start. Thin: the other seeds."))
        heads = [("nmse_region_at_finest_start", "NMSE, region, at the finest level's start", ".3f"), *MERITS[1:]]
        heads.append((f"cpu_s_to_{GAPS[0]:g}", f"s to {GAPS[0]:.0%}, or spent", ".2f"))
        table = summary(self.tables["sampling"], ("downsample", "interpolation"), heads)
        text = [f"{SAMPLING_DOSE:,} photons. Once the finest level has converged, its start is forgotten."]
        return Section("Interpolators and down-samplers", text, table, pictures)

    def _motions(self) -> Section:
        shown = {}
        for method, name in (("backprojection", "backprojection"), ("map", "M-MAP-3")):
            for motion in ("circular", "linear"):
                file = f"{cell_name('motions', MOTION_DOSE, 0, method, motion=motion)}.nii.gz"
                shown[f"{name}, {motion}"] = read_volume(self.folder / "volumes" / file)
        picture = volume_figures.depth_slices(shown)
        caption = "Circular motion blurs what lies in other slices into rings, linear motion into streaks."
        table = summary(self.tables["motions"], ("method", "motion"), [*MERITS, ("streaks", "directedness", ".2f")])
        z = self.setting.grid.axis("z")[self.image_quality.slices]
        truth = self.image_quality.spread(self.image_quality.truth.values)
        groups = []
        for motion in ("circular", "linear"):
            runs = where(self.records, experiment="motions", seed=0, motion=motion)
            groups.append((f"{motion} motion", [(r["method"].replace("map", "M-MAP-3"), r) for r in runs]))
        asf = plots.depth_spread(groups, z, truth), "Artefact spread function of the ball at z = 60 mm."
        text = ["Directedness: mean square of the error's steps along y over those along x; 1 without direction."]
        return Section("Circular and linear motion", text, table, [(picture, caption), asf])

    def _baselines(self) -> Section:
        rows, doses = self.tables["baselines"], self.setting.doses
        names = distinct(rows, "method")
        shown = {f"{d:,}": {m: self._volume("baselines", d, m) for m in names} for d in doses}
        pictures = [
            (volume_figures.methods(shown), "Baselines at z = 48 mm after their last iteration; rows: photons."),
            (plots.over_iterations(self.records, doses), "Baselines against iterations, first seed."),
        ]
        heads = [*MERITS, ("best_nmse_region", "NMSE, region, best iterate", ".3f"), ("cpu_s", "processor s", ".2f")]
        text = [
            "The best iterate is chosen with the truth at hand, which no user has. ML is the posterior without prior."
        ]
        return Section("Baselines", text, summary(rows, ("dose", "method"), heads), pictures)

    def _priors(self) -> Section:
        rows = self.tables["priors"]
        figure = plots.bars(rows, "prior", self.setting.doses, ("nmse_region", "ssim", "cnr"))
        text = ["M-MAP-3 as by default; strength and edge of each prior are what the data choose, not the best."]
        caption = "All priors; whiskers: least to most over the seeds, from five seeds on their deviation."
        return Section("Priors", text, summary(rows, ("dose", "prior"), MERITS), [(figure, caption)])

    def _strengths(self) -> Section:
        rows = self.tables["strengths"]
        figure = plots.over_strength(rows, self.setting.doses)
        text = [
            "M-MAP-3, Lange prior: what the data choose (1) is chosen without the truth; the others show what it misses."
        ]
        caption = "Strength of the prior, in shares of the one that the data choose."
        return Section("Strength of the prior", text, summary(rows, ("dose", "share"), MERITS), [(figure, caption)])

    def _doses(self) -> Section:
        rows = self.tables["doses"]
        figure = plots.dose_curves(rows, self.setting.curve)
        text = [
            "Tuned: strength and edge from each scan. Same strength: that of the scan at 20,000 photons, so the same "
            "resolution at every dose. Same beta: the same prior in the Bayesian sense."
        ]
        some = [{**r, "method": f"M-MAP-3, {r['strength']}" if "strength" in r else r["method"]} for r in rows]
        caption = "Dose curves; whiskers: least to most over the seeds, from five seeds on their deviation."
        return Section("Dose", text, summary(some, ("dose", "method"), MERITS), [(figure, caption)])

    def _files(self) -> Section:
        text = [
            "tables/: every run as a row (CSV). figures/: the pictures (PNG). volumes/: truth and the volumes shown "
            "(NIfTI). runs/: each run with its trace (JSON), from which --resume goes on."
        ]
        return Section("Files", text)
