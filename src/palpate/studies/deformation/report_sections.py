"""The report's sections, in the order of the dissertation's chapter and then beyond."""

from palpate.report.html_report import Section
from palpate.studies.deformation import claims, dissertation_sections, extension_sections
from palpate.studies.deformation import reading_sections as readings
from palpate.studies.deformation.counterparts import counterparts
from palpate.studies.deformation.report_inputs import ReportInputs


def sections(inputs: ReportInputs) -> list[Section]:
    """All of them."""
    chapter, more = dissertation_sections, extension_sections
    parts = [
        readings.readings,
        readings.rest_length,
        readings.row_table,
        readings.reach,
        chapter.set_up,
        chapter.cube,
        chapter.laws,
        chapter.optimum,
        chapter.meshes,
        chapter.sweeps,
        chapter.kidneys,
        chapter.kidney_shapes,
    ]
    parts += [more.ladder, more.needed, more.fit, more.ripple, more.loops, more.strain, more.truth_cube]
    found = [*conclusions(inputs), *(part(inputs) for part in parts)]
    return [*found, counterparts(found), files(inputs)]


def conclusions(inputs: ReportInputs) -> list[Section]:
    """Claims and promises with their verdicts."""
    text = [
        "Every number here is computed in this run; the tables beside this report hold what it is made from. Springs are "
        "judged by quadratic finite elements (P2, scikit-fem's assembly, a direct solution), which share nothing with them "
        "but the mesh. Times are processor time of one core.",
        "Worst is the greatest difference of displacement over all nodes, as a length; errors against finite elements are "
        "not the certified bound of an answer, which speaks of the model's own equations.",
    ]
    return [
        Section("The dissertation's claims", [*text, *(one.sentence for one in claims.claims(inputs.tables))]),
        Section(
            "What palpate promises beyond",
            ["Each path and radius; what fails is said."],
            claims.own_claims(inputs.tables),
        ),
    ]


def files(inputs: ReportInputs) -> Section:
    """What lies in the folder."""
    text = [
        "tables/: every number (CSV). figures/: the pictures (PNG). runs/: each experiment (JSON, NPZ), "
        "from which --resume goes on."
    ]
    return Section("Files", text)
