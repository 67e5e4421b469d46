"""Sections beyond the chapter: the whole ladder, what a hand feels, large strain, a cube that was measured."""

import numpy as np

from palpate.meshes.tet_mesh import TetMesh
from palpate.report.figures import surface_map
from palpate.report.html_report import Section
from palpate.report.tables import shown
from palpate.studies.deformation import plots
from palpate.studies.deformation.kidney import kidney
from palpate.studies.deformation.report_inputs import ReportInputs


def ladder(inputs: ReportInputs) -> Section:
    """The front of all models."""
    rows = inputs.tables["pareto"]
    table = shown(
        [r for r in rows if r["tolerance"] in (0.5, 0.1, 0.01, 1e-3, 1e-5, 0.0)],
        ("nodes", "{nodes}³"),
        ("model", "{model}"),
        ("tolerance asked", "{tolerance:g}"),
        ("sweeps", "{sweeps}"),
        ("ms a push", lambda r: f"{1e3 * r['seconds']:.3g}"),
        ("error, % of push", lambda r: f"{100 * r['error']:.2g}"),
        ("force error, %", lambda r: f"{100 * r['force_error']:.2g}"),
        ("certified bound, %", lambda r: _number_or_dash(r["bound"], 100)),
        ("error to P2, %", lambda r: f"{100 * r['error_p2']:.3g}" if "error_p2" in r else "-"),
        ("making, s", "{making_s:.2g}"),
    )
    text = [
        "Every model that is built, 5 mm at the top's centre, Poisson's ratio 0.45, springs fitted as palpate fit does. "
        "Error is the worst node against P1 elements on the same mesh; that against P2 holds the elements' own error too, "
        "which no sweep mends. The direct solve has its factors at hand; making says what they took."
    ]
    pictures = [
        (plots.pareto(rows, "error"), "Accuracy against time: displacement. Dotted: one millisecond."),
        (plots.pareto(rows, "force_error"), "Accuracy against time: force."),
    ]
    return Section("The ladder: accuracy against time", text, table, pictures)


def needed(inputs: ReportInputs) -> Section:
    """The model that is enough."""
    table = shown(
        inputs.tables["needed"],
        ("truth", "{truth}"),
        ("within, mm", "{within_mm:g}"),
        ("of force, %", lambda r: f"{100 * r['within_force']:g}"),
        ("push, mm", "{depth_mm:g}"),
        ("model", "{name}"),
        ("enough", lambda r: "yes" if r["enough"] else "no"),
        ("sweeps", "{sweeps}"),
        ("worst, mm", lambda r: _number_or_dash(r["displacement"], 1)),
        ("force, %", lambda r: _number_or_dash(r["force"], 100)),
        ("ms a push", lambda r: _number_or_dash(r["seconds"], 1e3)),
        ("needed", lambda r: "needed" if r["needed"] else ""),
    )
    text = [
        "Pushes are on random points of the cube that no fit saw, half of them 45° to the normal. The table shows the fewest "
        "sweeps from rest that keep every push within what is asked. A dash: some push is too deep for the model. "
        "pp.select_model and palpate fit --within do this for any tissue."
    ]
    return Section("Which model is needed", text, table)


def _number_or_dash(value: float | None, unit: float) -> str:
    """None: no number, as for too deep a push for the model."""
    return "-" if value is None else f"{unit * value:.2g}"


def fit(inputs: ReportInputs) -> Section:
    """A fit's error on the organ."""
    rows = inputs.tables["kidney_error"]
    points, error = np.array([[r[a] for a in "xyz"] for r in rows]), np.array([r["error_mm"] for r in rows])
    mesh: TetMesh = kidney(inputs.setting.kidneys[0][1]).mesh
    text = [
        "The kidney at its lowest resolution, springs fitted to finite elements, on contacts that the fit never saw.",
        *(r["line"].strip() for r in inputs.tables["kidney_words"]),
    ]
    caption = "Greatest difference between fitted springs and finite elements at each surface node."
    pictures = [(surface_map(mesh, points, error, "mm"), caption)]
    return Section("A fitted organ: where springs are wrong", text, pictures=pictures)


def ripple(inputs: ReportInputs) -> Section:
    """Stiffness under a sliding contact."""
    s = inputs.setting
    text = [
        f"A contact slides over more than four edges of the {s.ripple}³ cube's top, {s.points} points, 1 mm deep; what is "
        "left of the stiffness when a parabola is taken out. Edges are those of the lattice; its mean edge, diagonals "
        "counted, is 1.27 times as long."
    ]
    picture = plots.ripple(inputs.tables["ripple"]), "Peak to peak in the titles: the greatest of the models."
    return Section("Stiffness while sliding", text, pictures=[picture])


def loops(inputs: ReportInputs) -> Section:
    """Work of loops."""
    text = [
        "The hand presses 3 mm, moves, and lets go; work is force times the motion of the tool. "
        "Equilibrium: pushes solved step by step. Session: the real-time loop in lockstep, "
        "then a rest.",
        "A contact that stays glued to one place gives nothing back that was not put in; sweeps that lag "
        "take a little. A contact that slides along the surface at constant depth does not: stored "
        "energy depends on where it is, and the force on the tool lacks that slope. So sliding one way "
        "takes work and the other way gives it, whatever the model.",
    ]
    picture = plots.loops(inputs.tables["loops"]), "Below zero the hand gets work out; dotted: -1 %."
    return Section("Work of closed and sliding loops", text, pictures=[picture])


def strain(inputs: ReportInputs) -> Section:
    """Against finite strain, pushed and pulled."""
    both = {"push": inputs.tables["large"], "pull": inputs.tables["pull"]}
    table = shown(
        [row | {"way": way} for way, rows in both.items() for row in rows],
        ("way", "{way}"),
        ("model", "{model}"),
        ("mm", "{depth_mm:g}"),
        ("worst, mm", "{worst_mm:.2g}"),
        ("RMS, mm", "{rms_mm:.2g}"),
        ("force off, %", lambda r: f"{100 * r['force_error']:.2g}"),
        ("least volume of an element", "{least_volume:.2f}"),
    )
    text = [
        "Against neo-Hookean finite strain on the same mesh (P1, Newton's method), smooth patch, "
        "Poisson's ratio 0.3. An element whose volume falls below 0 is inside out. Linear models answer a pull with the "
        "negative of a push; tissue at finite strain does not."
    ]
    pictures = [
        (plots.large(rows), f"How far linear models are from finite strain: {way}.") for way, rows in both.items()
    ]
    return Section("Large strain, push and pull", text, table, pictures)


def truth_cube(inputs: ReportInputs) -> Section:
    """Facts of a measured cube, and a prediction."""
    table = shown(
        inputs.tables["truth_cube"],
        ("Poisson's ratio", "{poisson:g}"),
        ("element", "{element}"),
        ("compression, %", lambda r: f"{100 * r['strain']:g}"),
        ("mm", "{compressed_mm:g}"),
        ("bulge of a side's middle, mm", "{bulge_mm:.2f}"),
        ("mean stress / E, %", lambda r: f"{100 * r['stress_over_young']:.1f}"),
    )
    text = [
        "Public of the Truth Cube (A. E. Kerdok et al., Medical Image Analysis 7 (2003) 283; "
        "biorobotics.harvard.edu/truthcube): it is silicone rubber, RTV6166 mixed 30:70, 80 mm a side on a "
        "rigid base. Teflon balls of 1.58 mm lie every 10 mm in seven rows. Its indentation stiffness is 798 N/m without and "
        "780 N/m with balls. It was compressed by 5, 12.5 and 18.25 %. A sphere of 25.4 mm was pressed in by 22 and 36 % "
        "nominal strain.",
        "The tables of ball positions were not at hand here, so nothing is compared with them. The table below is a "
        "prediction of the compressions by linear elements, with top and bottom stuck to their plates.",
    ]
    return Section("The Truth Cube", text, table)
