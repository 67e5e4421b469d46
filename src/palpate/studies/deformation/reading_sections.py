"""The section that judges the chapter on every reading of its set-up."""

from palpate.report.html_report import Section
from palpate.studies.deformation import plots
from palpate.studies.deformation.config import DEPTH, MARKS, SIDE
from palpate.studies.deformation.reading_claims import LIMIT, SAME, readings_table
from palpate.studies.deformation.report_inputs import ReportInputs
from palpate.studies.deformation.spring_laws import HIGH, LOW, SEARCH


def readings(inputs: ReportInputs) -> Section:
    """What is inferred, every reading, and the two laws."""
    s = inputs.setting
    text = [
        "The set-up of the chapter is inferred from its captions: they do not say how the contact point is held, where the "
        "cube is, or which norm the difference has. So each claim is tried on every reading, and counts what reproduces "
        f"it. The cube of {SIDE:g} mm has {s.main}³ nodes and equal edge springs, rows are rings, the push is {DEPTH:g} mm.",
        "Contact: a single node; the nodes of the touched triangle; the mean over a smooth patch of "
        f"{s.radius:g} mm. Support: the bottom; the four sides; all faces but the top. Measure, for which the best RSC0 is "
        "sought: the worst node, the root mean square, the mean over all nodes. Law: one negative RSC0 serves both, as the "
        "caption of the chapter's laws has it: RSC = -RSC0 r (linear) and 1 - exp(RSC0 r) (exponential), r the row; "
        '"both" takes one RSC0 for both laws and is judged by the worse.',
        f"Below 1 mm: the worst node differs by less than {LIMIT:g} mm at the RSC0 that the measure finds best. RSC0: to "
        f"two decimals between {max(MARKS):.2f} and {min(MARKS):.2f}. Beats uniform: its measure is at least "
        f"{100 * SAME:.0f} % better than that of the best uniform RSC; beats low, high: than those of {LOW:g} and {HIGH:g}, "
        "which stand for the chapter's low and high. The counts are over Poisson's ratios; a reading reproduces a claim "
        f"that it reproduces at every ratio. The search ends at {-SEARCH[0]:g}, hardly any home springs, and at "
        f"{-SEARCH[1]:g}, hardly any neighbours.",
    ]
    picture = plots.law_curves(), "Home over edge stiffness by row, for one RSC0 in both laws."
    return Section("Every reading of the set-up", text, readings_table(inputs.tables["readings"]), [picture])
