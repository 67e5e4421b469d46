"""The report's sections, in the order of the dissertation's chapter and then beyond."""

from collections.abc import Sequence

from palpate.report.html_report import Section
from palpate.studies.counterparts import Counterpart, list_counterparts
from palpate.studies.tomosynthesis import chapter_sections, claims, extension_sections
from palpate.studies.tomosynthesis.experiments import STARTS
from palpate.studies.tomosynthesis.findings import findings
from palpate.studies.tomosynthesis.intervals import LEVEL, SAME
from palpate.studies.tomosynthesis.pairs import pair_table
from palpate.studies.tomosynthesis.report_inputs import ReportInputs
from palpate.studies.tomosynthesis.tables import ENOUGH


def sections(inputs: ReportInputs) -> list[Section]:
    """All of them."""
    chapter, more = chapter_sections, extension_sections
    parts = [chapter.set_up, chapter.images, chapter.levels, chapter.curves, chapter.samplers, chapter.subsets]
    parts += [chapter.motions, more.local, more.baselines, more.priors, more.strengths, more.dose_curves]
    found = [*conclusions(inputs), *(part(inputs) for part in parts)]
    return [*found, list_counterparts(found, counterparts(inputs.setting.doses), CAPTIONS), more.files(inputs)]


CAPTIONS = (
    "Figures and tables of chapter 2 by what their captions show. Its text from section 2.2.4 on is not at hand, nor most "
    "of the numbers. Slices of real projections are shown by palpate demo and palpate study head.",
)


def counterparts(doses: Sequence[int]) -> list[Counterpart]:
    """What the chapter shows, and where it is here."""
    many, count = "Images", len(doses)
    found: list[Counterpart] = [("figure", "slices of the phantom at several depths", "Set-up", "picture 1")]
    for i, start in enumerate(STARTS):
        for j, dose in enumerate(doses):
            words = f"backprojection, F-MAP, M-MAP-2, M-MAP-3 at {dose:,} photons, {start} start"
            found.append(("figure", words, many, f"picture {i * (count + 1) + j + 1}"))
        found.append(
            ("figure", f"a line profile at z = 4.8 cm, {start} start", many, f"picture {(i + 1) * (count + 1)}")
        )
    kinds = [f"{what} against {by}" for what in ("log-posterior", "NMSE") for by in ("iterations", "time")]
    for i, start in enumerate(STARTS):
        found += [
            ("figure", f"{kind}, {start} start", "Convergence", f"picture {6 * i + k + 1}")
            for k, kind in enumerate(kinds)
        ]
    found.append(("table", "resolutions and iterations of each algorithm and scale", "Levels", "table"))
    for k, what in enumerate(("interpolators", "down-samplers"), 1):
        found.append(
            ("figure", f"the effect of the {what} on M-MAP-3", "Interpolators and down-samplers", f"picture {k}")
        )
    return found


def conclusions(inputs: ReportInputs) -> list[Section]:
    """Claims with their verdicts, and what wins."""
    text = [
        "Every number here is computed in this run; the tables beside this report hold what it is made from. Ratios are "
        f"geometric means over the scans, paired scan by scan. In brackets: their {LEVEL:.0%} interval (Student's t of the "
        f"logarithms), of fewer than {ENOUGH} scans the least and the most. A claim that one is better holds where all "
        f"of the bracket lies above {1 + SAME:g}; two are equal where it lies within {SAME:.0%} of 1. The scans "
        "differ in their noise alone: brackets say nothing of other phantoms.",
        "Work is counted in passes: voxels updated on all levels, over those of the finest grid. ≥ stands where F-MAP had "
        "not come so far when its run was given up: the mean of lower bounds is one.",
    ]
    other = [["claim", "tried", "verdict", "numbers"]]
    other += [[v.claim, v.tried, v.held, v.numbers] for v in claims.by_other_measures(inputs.tables)]
    compared = [
        "Above 1, multi-resolution is better. Work is counted to the log-posterior that multi-resolution had when its rule "
        "ended it; ≥ where F-MAP had not come so far when its run was given up. After the same work: passes, or processor "
        "time in the last pair, whose optimisers differ. Processor time was taken on a busy machine."
    ]
    ranked = [
        "A choice is named if it is better on every scan and by more than 2 % on the mean. Rivals of M-MAP-3 are taken "
        "at the iterate that suits them best, chosen by the truth. M-MAP-3 is taken at its own stop, once with the "
        "strength that the data choose and once with the one that suits it best."
    ]
    asked = ["By measures that the slab's walls do not rule. Claims and brackets are as above."]
    return [
        Section("The dissertation's claims", [*text, *(one.sentence for one in claims.claims(inputs.tables))]),
        Section("The claims about images by other measures", asked, other),
        Section("Fixed resolution and multi-resolution", compared, pair_table(inputs.tables["pairs"])),
        Section("What wins", ranked, findings(inputs.tables, inputs.setting)),
    ]
