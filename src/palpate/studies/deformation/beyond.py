"""Sections beyond the chapter: the whole ladder, what a hand feels, large strain, a cube that was measured."""

import numpy as np

from palpate.meshes.mesh import TetMesh
from palpate.studies.deformation import plots
from palpate.studies.deformation.organs import kidney
from palpate.studies.deformation.told import Told
from palpate.studies.pictures import surface_map
from palpate.studies.report import Section


def ladder(told: Told) -> Section:
    """The front of all models."""
    rows = told.tables["pareto"]
    head = [
        "nodes",
        "model",
        "tolerance asked",
        "sweeps",
        "ms a push",
        "error, % of push",
        "force error, %",
        "certified bound, %",
        "error to P2, %",
        "making, s",
    ]
    body = [
        [
            f"{r['nodes']}³",
            r["model"],
            f"{r['tolerance']:g}",
            r["sweeps"],
            f"{1e3 * r['seconds']:.3g}",
            f"{100 * r['error']:.2g}",
            f"{100 * r['force_error']:.2g}",
            "-" if r["bound"] is None else f"{100 * r['bound']:.2g}",
            f"{100 * r['error_p2']:.3g}" if "error_p2" in r else "-",
            f"{r['making_s']:.2g}",
        ]
        for r in rows
        if r["tolerance"] in (0.5, 0.1, 0.01, 1e-3, 1e-5, 0.0)
    ]
    text = [
        "Every model that is built, 5 mm at the top's centre, Poisson's ratio 0.45, springs fitted as "
        "palpate fit does. Error is the worst node against P1 elements on the same mesh; that against P2 "
        "holds the elements' own error too, which no sweep mends. The direct solve has its factors at "
        "hand; making says what they took."
    ]
    pictures = [
        (
            plots.pareto(rows, "error"),
            told.caption("Accuracy against time: displacement. Dotted: one millisecond."),
        ),
        (plots.pareto(rows, "force_error"), told.caption("Accuracy against time: force.")),
    ]
    return Section("The ladder: accuracy against time", text, [head, *body], pictures)


def needed(told: Told) -> Section:
    """The model that is enough."""
    head = [
        "truth",
        "within, mm",
        "of force, %",
        "push, mm",
        "model",
        "enough",
        "sweeps",
        "worst, mm",
        "force, %",
        "ms a push",
        "needed",
    ]
    body = [
        [
            r["truth"],
            f"{r['within_mm']:g}",
            f"{100 * r['within_force']:g}",
            f"{r['depth_mm']:g}",
            r["name"],
            "yes" if r["enough"] else "no",
            r["sweeps"],
            _said(r["displacement"], 1),
            _said(r["force"], 100),
            _said(r["seconds"], 1e3),
            "needed" if r["needed"] else "",
        ]
        for r in told.tables["needed"]
    ]
    text = [
        "Pushes on random points of the cube that no fit saw, half of them 45° to the normal: the fewest "
        "sweeps from rest that keep every one within what is asked (- where some push is too deep for "
        "the model). pp.ladder and palpate fit --within "
        "do this for any tissue."
    ]
    return Section("Which model is needed", text, [head, *body])


def _said(value: float | None, unit: float) -> str:
    """None: too deep a push for the model."""
    return "-" if value is None else f"{unit * value:.2g}"


def fit(told: Told) -> Section:
    """A fit's error on the organ."""
    rows = told.tables["kidney_error"]
    points, error = np.array([[r[a] for a in "xyz"] for r in rows]), np.array([r["error_mm"] for r in rows])
    mesh: TetMesh = kidney(told.setting.kidneys[0][1]).mesh
    text = [
        "The kidney at its lowest resolution, springs fitted to finite elements, on contacts that the fit never saw.",
        *(r["line"].strip() for r in told.tables["kidney_words"]),
    ]
    caption = told.caption("Greatest difference between fitted springs and finite elements at each surface node.")
    return Section(
        "A fitted organ: where springs are wrong", text, (), [(surface_map(mesh, points, error, "mm"), caption)]
    )


def ripple(told: Told) -> Section:
    """Stiffness under a sliding contact."""
    s = told.setting
    text = [
        f"A contact slides over more than four edges of the {s.ripple}³ cube's top, {s.points} points, 1 "
        "mm deep; what is left of the stiffness when a parabola is taken out. Edges are those of the "
        "lattice; its mean edge, diagonals counted, is 1.27 times as long."
    ]
    return Section(
        "Stiffness while sliding",
        text,
        (),
        [
            (
                plots.ripple(told.tables["ripple"]),
                told.caption("Peak to peak in the titles: the greatest of the models."),
            )
        ],
    )


def loops(told: Told) -> Section:
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
    return Section(
        "Work of closed and sliding loops",
        text,
        (),
        [(plots.loops(told.tables["loops"]), told.caption("Below zero the hand gets work out; dotted: -1 %."))],
    )


def strain(told: Told) -> Section:
    """Against finite strain, where that is built."""
    rows = told.tables["large"]
    head = ["model", "push, mm", "worst, mm", "RMS, mm", "force off, %", "least volume of an element"]
    body = [
        [
            r["model"],
            f"{r['depth_mm']:g}",
            f"{r['worst_mm']:.2g}",
            f"{r['rms_mm']:.2g}",
            f"{100 * r['force_error']:.2g}",
            f"{r['least_volume']:.2f}",
        ]
        for r in rows
    ]
    text = [
        "Against neo-Hookean finite strain on the same mesh (P1, Newton's method), smooth patch, "
        "Poisson's ratio 0.3. An element whose volume falls below 0 is inside out."
    ]
    picture = (plots.large(rows), told.caption("How far linear models are from finite strain."))
    return Section("Large strain", text, [head, *body], [picture])


def truth_cube(told: Told) -> Section:
    """Facts of a measured cube, and a prediction."""
    head = [
        "Poisson's ratio",
        "element",
        "compression, %",
        "mm",
        "bulge of a side's middle, mm",
        "mean stress / E, %",
    ]
    body = [
        [
            f"{r['poisson']:g}",
            r["element"],
            f"{100 * r['strain']:g}",
            f"{r['compressed_mm']:g}",
            f"{r['bulge_mm']:.2f}",
            f"{100 * r['stress_over_young']:.1f}",
        ]
        for r in told.tables["truth_cube"]
    ]
    text = [
        "Public of the Truth Cube (A. E. Kerdok et al., Medical Image Analysis 7 (2003) 283; "
        "biorobotics.harvard.edu/truthcube): silicone rubber, RTV6166 mixed 30:70, 80 mm a side on a "
        "rigid base, Teflon balls of 1.58 mm every 10 mm in seven rows; indentation stiffness 798 N/m "
        "without and 780 N/m with balls; compressed by 5, 12.5 and 18.25 %; a sphere of 25.4 mm pressed "
        "in by 22 and 36 % nominal strain.",
        "The tables of ball positions were not at hand here, so nothing is compared with them: the table "
        "below is a prediction by linear elements for the compressions, top and bottom stuck to their "
        "plates, to hold against them.",
    ]
    return Section("The Truth Cube", text, [head, *body])
