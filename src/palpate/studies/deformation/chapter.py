"""Sections of the dissertation's chapter: the cube, the laws, the meshes, the sweeps, the kidney."""

from palpate.studies.deformation import claims, plots
from palpate.studies.deformation.setting import DEPTH, MARKS, SIDE, YOUNG
from palpate.studies.deformation.told import ONE, Told
from palpate.studies.report import Section
from palpate.studies.tables import Row, where


def _profile(told: Told, poisson: float) -> list[Row]:
    return where(told.tables["profiles"], poisson=poisson)


def set_up(told: Told) -> Section:
    """What is pushed; how stiff each contact is on each mesh."""
    s = told.setting
    text = [
        f"A cube of {SIDE:g} mm with {s.main}³ nodes, six tetrahedra a cell, held at its bottom; E = "
        f"{YOUNG:g} kPa (only forces "
        "depend on it). Two contacts at the centre of the top: the dissertation's own, the nodes of the "
        "touched triangle all "
        f"moved with the tool (rigid=True, radius 0); and palpate's, the mean over a smooth patch of {s.radius:g} mm "
        f"radius. The home springs' rows are the dissertation's rings, row 1 at the contact.",
        "The first is singular: the finer the mesh, the softer it feels, by finite elements too (table). Errors under it "
        "hold for this mesh only. The patch has a limit.",
    ]
    head = ["Poisson's ratio", "nodes", "element", "contact", "force at 5 mm, N"]
    body = [
        [f"{r['poisson']:g}", f"{r['nodes']}³", r["element"], r["contact"], f"{r['force_n']:.3f}"]
        for r in told.tables["stiffness"]
    ]
    return Section("Set-up", text, [head, *body])


def cube(told: Told) -> Section:
    """The cube under three pushes."""
    rows = _profile(told, ONE)
    groups = {f"pushed {d:g} mm": (rows, d) for d in (5.0, 10.0, 15.0)}
    text = [
        f"The dissertation's contact, Poisson's ratio {ONE:g}, equal edges, the exponential law at its "
        "best RSC0. Springs and "
        "linear elements are both linear: at 10 and 15 mm all lengths double and treble, and shares stay."
    ]
    pictures = [
        (plots.section(rows, "exponential", 5.0), told.caption("The middle of the cube, pushed 5 mm.")),
        (
            plots.displacement(rows, "exponential"),
            told.caption("Displacement of each node over its distance to the contact."),
        ),
        (
            plots.difference(groups, "mm", 1.0),
            told.caption(
                "Greatest absolute difference to finite elements, nodes grouped by 2.5 mm of distance; dotted: 1 mm."
            ),
        ),
        (
            plots.difference({"at any depth": (rows, DEPTH)}, "push", 0.2),
            told.caption("The same, normalised by the push; dotted: 1 mm in 5 mm."),
        ),
        (
            plots.difference({"at any depth": (rows, DEPTH)}, "own", None),
            told.caption(
                "Normalised by the displacement of the node itself: far from the contact springs lose the motion altogether."
            ),
        ),
    ]
    return Section("The cube at 5, 10 and 15 mm", text, (), pictures)


def laws(told: Told) -> Section:
    """All laws, by Poisson's ratio."""
    ratios = list(dict.fromkeys(r["poisson"] for r in told.tables["profiles"]))
    groups = {f"Poisson's ratio {p:g}": (_profile(told, p), DEPTH) for p in ratios}
    text = [
        "Uniform RSC, low and high, against the linear and the exponential law, each at its best for the ratio; equal edges."
    ]
    return Section(
        "Uniform and adaptive RSC",
        text,
        (),
        [
            (
                plots.difference(groups, "mm", 1.0),
                told.caption("Greatest difference to finite elements at 5 mm, dotted: 1 mm."),
            )
        ],
    )


def optimum(told: Told) -> Section:
    """Error over RSC0 and the table of the best."""
    best = told.tables["optimum"]
    head = [
        "contact",
        "edges",
        "law",
        "Poisson's ratio",
        "best RSC0",
        "worst, mm",
        "RMS, mm",
        "worst, % of the push",
        "best RSC0 by RMS",
    ]
    body = []
    for r in (r for r in best if r["least"] == "worst_mm"):
        (other,) = where(best, least="rms_mm", **{k: r[k] for k in ("contact", "weights", "law", "poisson")})
        sign = -1 if r["law"] == "exponential" else 1
        body.append(
            [
                r["contact"],
                r["weights"],
                r["law"],
                f"{r['poisson']:g}",
                f"{sign * r['rsc']:.3g}",
                f"{r['worst_mm']:.2f}",
                f"{r['rms_mm']:.2f}",
                f"{100 * r['worst_share']:.0f}",
                f"{sign * other['rsc']:.3g}",
            ]
        )
    marks = ", ".join(f"{m:g}" for m in MARKS)
    pictures = [
        (
            plots.over_rsc(told.tables["rsc"], best, contact, column),
            told.caption(
                f"Exponential law, {contact}: {what} at 5 mm over RSC0 (log axis), a line a Poisson's ratio, its "
                f"least a dot; dotted: {marks}."
            ),
        )
        for contact in ("triangle", "patch")
        for column, what in (("worst_mm", "worst error"), ("rms_mm", "RMS error"))
    ]
    text = [
        "The chapter's table of the best RSC0 by Poisson's ratio, for all laws, edges and both contacts. "
        "Where it stands at 0.001 the best lies at the end of the search: no home springs at all."
    ]
    return Section("Error against RSC0", text, [head, *body], pictures)


def meshes(told: Told) -> Section:
    """What another mesh changes."""
    head = ["mesh", "nodes", "truth", "contact", "edges", "RSC0", "is", "worst, mm", "RMS, mm"]
    body = [
        [
            r["mesh"],
            f"{r['nodes']}³",
            r["element"],
            r["contact"],
            r["weights"],
            f"{-r['rsc']:.3g}",
            r["choice"],
            f"{r['worst_mm']:.2f}",
            f"{r['rms_mm']:.2f}",
        ]
        for r in told.tables["meshes"]
    ]
    text = [
        f"Exponential law, Poisson's ratio {ONE:g}, 5 mm. An RSC0 found on one mesh does not suit a finer "
        "one. Irregular: nodes moved at random by up to a fifth of a cell, faces kept flat."
    ]
    return Section("A finer mesh, an irregular mesh", text, [head, *body])


def sweeps(told: Told) -> Section:
    """Convergence and stability."""
    head = [
        "nodes",
        "model",
        "sweeps to 1 %",
        "to 0.1 %",
        "thrown 100 mm: left after 64 sweeps, mm",
        "after 1024, mm",
        "shaken by 15 mm a tick: most, mm",
    ]
    body = []
    for r in told.tables["stability"]:
        line = where(told.tables["convergence"], nodes=r["nodes"], model=r["model"])
        counts = [claims.reached(line, e) for e in (0.01, 0.001)]
        body.append(
            [
                f"{r['nodes']}³",
                r["model"],
                *(c if c is not None else "not in 512" for c in counts),
                f"{r['after_64_mm']:.2g}",
                f"{r['after_1024_mm']:.1g}",
                f"{r['shaken_mm']:.0f}",
            ]
        )
    text = [
        "Springs: exponential law, RSC0 -0.14, cotangent edges, judged by conjugate gradients on springs "
        "assembled by other means; other models by a direct solution of P1 elements. Patch, Poisson's "
        "ratio 0.3. 41³: springs only."
    ]
    picture = (
        plots.convergence(told.tables["convergence"]),
        told.caption(
            "Greatest error over the sweeps (full) and the bound that each answer certifies, in the energy norm (dotted)."
        ),
    )
    return Section("Convergence and stability", text, [head, *body], [picture])


def kidneys(told: Told) -> Section:
    """What a deformation of an organ costs."""
    rows = told.tables["kidneys"]
    head = [
        "resolution",
        "edge, mm",
        "nodes",
        "tetrahedra",
        "model",
        "a push to 10 %, ms",
        "to 1 %",
        "to 0.1 %",
        "pushes a second, 1 %",
        "a sweep, ms",
        "making, s",
    ]
    body = [
        [
            r["resolution"],
            f"{r['edge_mm']:g}",
            f"{r['nodes']:,}",
            f"{r['tets']:,}",
            r["model"],
            *(f"{1e3 * r[f'push_s_{t}']:.3g}" for t in ("0.1", "0.01", "0.001")),
            f"{1 / r['push_s_0.01']:.0f}",
            f"{1e3 * r['sweep_s']:.3g}" if r["sweep_s"] else "-",
            f"{r['making_s']:.2g}",
        ]
        for r in rows
    ]
    text = [
        "The left kidney of the sample CT, its rear held; pushes of 5 mm from rest at six points along "
        "the inward normal, patch of two edges, median; everything that push does is counted, its "
        "certificate too. A running session goes on from the last tick and needs a few sweeps a tick."
    ]
    return Section(
        "Kidney at several resolutions",
        text,
        [head, *body],
        [(plots.kidneys(rows), told.caption("Processor time; dotted: 30 a second and 1000 a second."))],
    )
