"""Sections on how the chapter is read: every reading of its set-up, and its deformed-node index table."""

from palpate.report.html_report import Section
from palpate.report.tables import distinct, shown
from palpate.studies.deformation import chapter_plots
from palpate.studies.deformation.config import DEPTH, MARKS, SIDE
from palpate.studies.deformation.reading_claims import LIMIT, SAME, readings_table, rest_length_sentence
from palpate.studies.deformation.report_inputs import ReportInputs
from palpate.studies.deformation.row_table import SHOWN, STILL
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
    picture = chapter_plots.law_curves(), "Home over edge stiffness by row, for one RSC0 in both laws."
    return Section("Every reading of the set-up", text, readings_table(inputs.tables["readings"]), [picture])


def row_table(inputs: ReportInputs) -> Section:
    """The table itself."""
    table = shown(
        inputs.tables["row_table"],
        ("row", "{row}"),
        ("nodes", "{count}"),
        ("which", "{members}"),
        ("moves by up to, mm", "{most_mm:.3f}"),
    )
    text = [
        f"The deformed-node index table of the cube with {inputs.setting.sizes[0]}³ nodes, pushed {SHOWN:g} mm at the "
        "triangle: row 1 holds the touched nodes, row 2 their neighbours, and so on (deformed_rows in Python; rows are "
        "also what native.rows of a spring model gives). Nodes in no row stay at home.",
        "The stopping rule is inferred. Sweeps go over the rows of the table, from the first down. A row is joined while "
        "some node of the last one has moved by a threshold; the sweeps end when no node steps by as much. Here the "
        f"threshold is {STILL[-1]:g} mm.",
    ]
    return Section("The deformed-node index table", text, table)


def reach(inputs: ReportInputs) -> Section:
    """How far pushes reach, and what the table saves."""
    table = shown(
        inputs.tables["reach"],
        ("nodes", "{nodes}³"),
        ("threshold, mm", "{still_mm:g}"),
        ("push, mm", "{depth_mm:g}"),
        ("rows", "{rows} of {whole_rows}"),
        ("nodes in them", "{nodes_in_table} of {all}"),
        ("sweeps", "{sweeps}"),
        ("of all nodes", "{whole_sweeps}"),
        ("time, ms", lambda r: f"{1e3 * r['s']:.3g}"),
        ("of all nodes", lambda r: f"{1e3 * r['whole_s']:.3g}"),
        ("saving", lambda r: f"{r['whole_s'] / r['s']:.1f} times"),
        ("worst error, % of push", lambda r: f"{100 * r['error_mm'] / r['depth_mm']:.2g}"),
        ("of all nodes", lambda r: f"{100 * r['whole_error_mm'] / r['depth_mm']:.2g}"),
    )
    text = [
        "Triangle, exponential law, RSC0 -0.14, equal edges, Gauss-Seidel sweeps from rest; processor time of the native "
        "solution with contact and rows at hand. All nodes: the same rule with every row from the start. Errors are "
        "against the springs' own solution: a rule that looks at steps stops early, most of all for small pushes.",
    ]
    picture = chapter_plots.reach(inputs.tables["row_nodes"]), f"Nodes of the middle plane, threshold {STILL[0]:g} mm."
    return Section("How far a push reaches", text, table, [picture])


def rest_length(inputs: ReportInputs) -> Section:
    """Beside the linear springs."""
    tables = inputs.tables
    table = shown(
        tables["rest_length"],
        ("contact", "{contact}"),
        ("way", "{way}"),
        ("Poisson's ratio", "{poisson:g}"),
        ("measure", "{measure}"),
        ("best RSC0, rest length", "{rsc:.2g}"),
        ("linear", "{linear_rsc:.2g}"),
        ("measure, mm, rest length", "{error_mm:.3f}"),
        ("linear", "{linear_mm:.3f}"),
        ("worst node, mm, rest length", "{worst_mm:.2f}"),
        ("linear", "{linear_worst_mm:.2f}"),
    )
    forces = [row for row in tables["rest_length_force"] if row["force_n"] is not None]
    searched = distinct(tables["rest_length_force"], "rsc")
    missing = len(tables["rest_length_force"]) - len(forces)
    ratio: dict[tuple[str, float], dict[str, float]] = {}
    for row in forces:
        ratio.setdefault((row["contact"], row["rsc"]), {})[row["way"]] = abs(row["force_n"])
    more = [ways["pull"] / ways["push"] for ways in ratio.values() if len(ways) == 2]
    text = [
        "The chapter's force equation is not at hand, so its edge springs may have a rest length: k_e (|x_j - x_i| - l0) "
        "along the edge, solved by Newton's method in steps of the tool. They resist along themselves alone, so for small "
        "pushes they are the linear springs without their stiffness across. Exponential law, equal edges, rows are rings, "
        f"{DEPTH:g} mm pushed and pulled, the cube held at its bottom, judged by P2 elements of small strain. Both "
        f"kinds of springs have the best RSC0 of one list: {', '.join(f'{rsc:.2g}' for rsc in searched)}.",
        rest_length_sentence(tables["rest_length"]),
        f"A pull takes {min(more):.1f} to {max(more):.1f} times the force of a push: edges that are pulled straighten, "
        f"those that are pressed fold away. Linear springs do not tell one from the other. In {missing} of "
        f"{missing + len(forces)} cases the springs folded so far that no equilibrium was found.",
    ]
    return Section("Springs with rest length", text, table)
