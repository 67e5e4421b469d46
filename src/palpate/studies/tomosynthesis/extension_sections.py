"""Sections beyond the dissertation's chapter: its future work, baselines, priors, strengths, doses."""

from palpate.report.html_report import Section
from palpate.report.tables import distinct
from palpate.studies.tomosynthesis import plots, volume_figures
from palpate.studies.tomosynthesis.experiments import LOCAL_DOSE
from palpate.studies.tomosynthesis.local_trial import cropped
from palpate.studies.tomosynthesis.report_inputs import MERITS, ReportInputs
from palpate.studies.tomosynthesis.tables import summary

LOCAL = {  # volumes of the local trial
    "full": "cut out of the full volume",
    "local": "local, the rest modelled",
    "alone": "local, the rest ignored",
}


def local(inputs: ReportInputs) -> Section:
    """Local tomosynthesis, which the dissertation leaves as future work."""
    found = {words: inputs.volume("local", LOCAL_DOSE, name) for name, words in LOCAL.items()}
    truth = cropped(inputs.image_quality.truth, next(iter(found.values())).grid)
    figure = volume_figures.methods({f"{LOCAL_DOSE:,}": {"phantom": truth, **found}}, z=60.0)
    rows = [{**row, "method": LOCAL[row["method"]]} for row in inputs.tables["local"]]
    heads = [("nmse", "NMSE", ".4f"), ("nmse_scaled", "NMSE, free of window and level", ".3f")]
    text = [
        "The dissertation leaves local tomosynthesis as future work. Here a region around the ball is reconstructed by "
        "itself: behind a coarse model of what lies around it, and as if nothing did."
    ]
    caption = f"The region at z = 60 mm, {LOCAL_DOSE:,} photons; where the rest is ignored, it lands in the region."
    return Section("Local tomosynthesis", text, summary(rows, ("method",), heads), [(figure, caption)])


def baselines(inputs: ReportInputs) -> Section:
    """Other methods on the same scans."""
    rows, doses = inputs.tables["baselines"], inputs.setting.doses
    names = distinct(rows, "method")
    shown = {f"{d:,}": {m: inputs.volume("baselines", d, m) for m in names} for d in doses}
    pictures = [
        (volume_figures.methods(shown), "Baselines at z = 48 mm after their last iteration; rows: photons."),
        (plots.over_iterations(inputs.records, doses), "Baselines against iterations, first scan."),
    ]
    heads = [*MERITS, ("best_nmse_region", "NMSE, region, best iterate", ".3f"), ("cpu_s", "processor s", ".2f")]
    text = ["The best iterate is chosen with the truth at hand, which no user has. ML is the posterior without prior."]
    return Section("Baselines", text, summary(rows, ("dose", "method"), heads), pictures)


def priors(inputs: ReportInputs) -> Section:
    """Every potential with what the data choose."""
    rows = inputs.tables["priors"]
    figure = plots.bars(rows, "prior", inputs.setting.doses, ("nmse_region", "ssim", "cnr"))
    text = ["M-MAP-3 as by default; strength and edge of each prior are what the data choose, not the best."]
    caption = "All priors; whiskers: least to most over the scans, from five scans on their deviation."
    return Section("Priors", text, summary(rows, ("dose", "prior"), MERITS), [(figure, caption)])


def strengths(inputs: ReportInputs) -> Section:
    """What a stronger or weaker prior would do."""
    rows = inputs.tables["strengths"]
    figure = plots.over_strength(rows, inputs.setting.doses)
    text = [
        "M-MAP-3, Lange prior: what the data choose (1) is chosen without the truth; the others show what it misses."
    ]
    caption = "Strength of the prior, in shares of the one that the data choose."
    return Section("Strength of the prior", text, summary(rows, ("dose", "share"), MERITS), [(figure, caption)])


def dose_curves(inputs: ReportInputs) -> Section:
    """Six doses."""
    rows = inputs.tables["doses"]
    figure = plots.dose_curves(rows, inputs.setting.curve)
    text = [
        "Tuned: strength and edge from each scan. Same strength: that of the scan at 20,000 photons, so the same "
        "resolution at every dose. Same beta: the same prior in the Bayesian sense."
    ]
    some = [{**r, "method": f"M-MAP-3, {r['strength']}" if "strength" in r else r["method"]} for r in rows]
    caption = "Dose curves; whiskers: least to most over the scans, from five scans on their deviation."
    return Section("Dose", text, summary(some, ("dose", "method"), MERITS), [(figure, caption)])


def files(_: ReportInputs) -> Section:
    """What lies in the folder."""
    text = [
        "tables/: every run as a row (CSV). figures/: the pictures (PNG). volumes/: truth and the volumes shown "
        "(NIfTI). runs/: each run with its trace (JSON), from which --resume goes on."
    ]
    return Section("Files", text)
