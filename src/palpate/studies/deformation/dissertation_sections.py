"""Sections of the dissertation's chapter: the cube, the laws, the meshes, the sweeps, the kidney."""

from palpate.report.html_report import Section
from palpate.report.tables import Row, distinct, shown, where
from palpate.studies.deformation import chapter_plots, claims, kidney, plots
from palpate.studies.deformation.config import DEPTH, DEPTHS, MARKS, SIDE, YOUNG
from palpate.studies.deformation.report_inputs import ONE, ReportInputs


def _profile(inputs: ReportInputs, poisson: float) -> list[Row]:
    return where(inputs.tables["profiles"], poisson=poisson)


def set_up(inputs: ReportInputs) -> Section:
    """What is pushed; how stiff each contact is on each mesh."""
    s = inputs.setting
    text = [
        f"A cube of {SIDE:g} mm with {s.main}³ nodes, six tetrahedra a cell; E = {YOUNG:g} kPa (only forces depend on it). "
        "From here on it is held at its bottom, and two contacts press the centre of the top. In the first the nodes of the "
        "touched triangle all move with the tool (rigid=True, radius 0). In palpate's the mean over a smooth patch of "
        f"{s.radius:g} mm radius does. The home springs' rows are the dissertation's rings, row 1 at the contact.",
        "The first is singular: the finer the mesh, the softer it feels, by finite elements too (table). Errors under it "
        "hold for this mesh only. The patch has a limit.",
    ]
    table = shown(
        inputs.tables["stiffness"],
        ("Poisson's ratio", "{poisson:g}"),
        ("nodes", "{nodes}³"),
        ("element", "{element}"),
        ("contact", "{contact}"),
        ("force at 5 mm, N", "{force_n:.3f}"),
    )
    return Section("Set-up", text, table)


def cube(inputs: ReportInputs) -> Section:
    """The cube under three pushes."""
    rows = _profile(inputs, ONE)
    groups, any_depth = {f"pushed {d:g} mm": (rows, d) for d in DEPTHS}, {"at any depth": (rows, DEPTH)}
    text = [
        f"The dissertation's contact, Poisson's ratio {ONE:g}, equal edges, the exponential law at its best RSC0. Springs "
        "and linear elements are both linear: at 10 and 15 mm all lengths double and treble, and shares stay."
    ]
    grouped = "Greatest absolute difference to finite elements, nodes grouped by 2.5 mm of distance; dotted: 1 mm."
    own = "Normalised by the displacement of the node itself: far from the contact springs lose the motion altogether."
    pictures = [
        *((plots.section(rows, "exponential", d), f"The middle of the cube, pushed {d:g} mm.") for d in DEPTHS),
        (plots.displacement(rows, "exponential"), "Displacement of each node over its distance to the contact."),
        (plots.difference(groups, "mm", 1.0), grouped),
        (plots.difference(any_depth, "push", 0.2), "The same, normalised by the push; dotted: 1 mm in 5 mm."),
        (plots.difference(any_depth, "own", None), own),
    ]
    return Section("The cube at 5, 10 and 15 mm", text, pictures=pictures)


def laws(inputs: ReportInputs) -> Section:
    """All laws, by Poisson's ratio."""
    ratios = distinct(inputs.tables["profiles"], "poisson")
    groups = {f"Poisson's ratio {p:g}": (_profile(inputs, p), DEPTH) for p in ratios}
    text = [
        "Uniform RSC, low and high, against the linear and the exponential law, each at its best for the ratio; equal edges."
    ]
    marks = plots.binned_difference(inputs.tables["mark_profiles"], "law", "rsc")
    pictures = [
        (plots.difference(groups, "mm", 1.0), "Greatest difference to finite elements at 5 mm, dotted: 1 mm."),
        (marks, f"The same at the chapter's RSC0, one for both laws, Poisson's ratio {ONE:g}."),
    ]
    return Section("Uniform and adaptive RSC", text, pictures=pictures)


def optimum(inputs: ReportInputs) -> Section:
    """Error over RSC0 and the table of the best."""
    best = inputs.tables["optimum"]

    def signed(row: Row, least: str) -> str:
        (one,) = where(best, least=least, **{k: row[k] for k in ("contact", "weights", "law", "poisson")})
        return f"{-one['rsc'] if row['law'] == 'exponential' else one['rsc']:.3g}"

    table = shown(
        where(best, least="worst_mm"),
        ("contact", "{contact}"),
        ("edges", "{weights}"),
        ("law", "{law}"),
        ("Poisson's ratio", "{poisson:g}"),
        ("best RSC0", lambda r: signed(r, "worst_mm")),
        ("worst, mm", "{worst_mm:.2f}"),
        ("RMS, mm", "{rms_mm:.2f}"),
        ("worst, % of the push", lambda r: f"{100 * r['worst_share']:.0f}"),
        ("best RSC0 by RMS", lambda r: signed(r, "rms_mm")),
    )
    marks = ", ".join(f"{m:g}" for m in MARKS)
    pictures = [
        (
            plots.over_rsc(inputs.tables["rsc"], best, contact, column),
            f"Exponential law, {contact}: {what} at 5 mm over RSC0 (log axis), a line a Poisson's ratio, its least a dot; "
            f"dotted: {marks}.",
        )
        for contact in ("triangle", "patch")
        for column, what in (("worst_mm", "worst error"), ("rms_mm", "RMS error"))
    ]
    text = [
        "The chapter's table of the best RSC0 by Poisson's ratio, for all laws, edges and both contacts. "
        "Where it stands at 0.001 the best lies at the end of the search: no home springs at all."
    ]
    return Section("Error against RSC0", text, table, pictures)


def meshes(inputs: ReportInputs) -> Section:
    """What another mesh changes."""
    table = shown(
        inputs.tables["meshes"],
        ("mesh", "{mesh}"),
        ("nodes", "{nodes}³"),
        ("truth", "{element}"),
        ("contact", "{contact}"),
        ("edges", "{weights}"),
        ("RSC0", lambda r: f"{-r['rsc']:.3g}"),
        ("is", "{choice}"),
        ("worst, mm", "{worst_mm:.2f}"),
        ("RMS, mm", "{rms_mm:.2f}"),
    )
    text = [
        f"Exponential law, Poisson's ratio {ONE:g}, 5 mm. An RSC0 found on one mesh does not suit a finer one. Irregular: "
        "nodes moved at random by up to a fifth of a cell, faces kept flat. Readings of the set-up on these meshes stand "
        "in the claims and in tables/mesh_readings.csv; the truth on the finer one is P1."
    ]
    curves = plots.binned_difference(inputs.tables["mesh_profiles"], "mesh", "choice")
    words = "Greatest difference to finite elements over the distance, triangle, equal edges; dotted: 1 mm."
    return Section("A finer mesh, an irregular mesh", text, table, [(curves, words)])


def sweeps(inputs: ReportInputs) -> Section:
    """Convergence and stability."""
    convergence = inputs.tables["convergence"]

    def count(row: Row, error: float) -> object:
        reached = claims.reached(where(convergence, nodes=row["nodes"], model=row["model"]), error)
        return "not in 512" if reached is None else reached

    table = shown(
        inputs.tables["stability"],
        ("nodes", "{nodes}³"),
        ("model", "{model}"),
        ("sweeps to 1 %", lambda r: count(r, 0.01)),
        ("to 0.1 %", lambda r: count(r, 0.001)),
        ("thrown 100 mm: left after 64 sweeps, mm", "{after_64_mm:.2g}"),
        ("after 1024, mm", "{after_1024_mm:.1g}"),
        ("shaken by 15 mm a tick: most, mm", "{shaken_mm:.0f}"),
    )
    text = [
        "Springs: exponential law, RSC0 -0.14, cotangent edges, judged by conjugate gradients on springs assembled by other "
        "means; other models by a direct solution of P1 elements. Patch, Poisson's ratio 0.3. 41³: springs only."
    ]
    words = (
        "Greatest error over the sweeps (full) and the bound that each answer certifies, in the energy norm (dotted)."
    )
    return Section("Convergence and stability", text, table, [(plots.convergence(convergence), words)])


def kidneys(inputs: ReportInputs) -> Section:
    """What a deformation of an organ costs."""
    rows = inputs.tables["kidneys"]
    table = shown(
        rows,
        ("resolution", "{resolution}"),
        ("edge, mm", "{edge_mm:g}"),
        ("nodes", "{nodes:,}"),
        ("tetrahedra", "{tets:,}"),
        ("model", "{model}"),
        ("a push to 10 %, ms", lambda r: f"{1e3 * r['push_s_0.1']:.3g}"),
        ("to 1 %", lambda r: f"{1e3 * r['push_s_0.01']:.3g}"),
        ("to 0.1 %", lambda r: f"{1e3 * r['push_s_0.001']:.3g}"),
        ("a pull to 1 %", lambda r: f"{1e3 * r['pull_s_0.01']:.3g}"),
        ("pushes a second, 1 %", lambda r: f"{1 / r['push_s_0.01']:.0f}"),
        ("a sweep, ms", lambda r: f"{1e3 * r['sweep_s']:.3g}" if r["sweep_s"] else "-"),
        ("making, s", "{making_s:.2g}"),
    )
    text = [
        "The left kidney of the sample CT has its rear held. Pushes of 5 mm start from rest at six points along the inward "
        "normal, with a patch of two edges. The table shows medians. Everything that push does is counted, its certificate "
        "too. A running session goes on "
        "from the last tick and needs a few sweeps a tick."
    ]
    picture = plots.kidneys(rows), "Processor time; dotted: 30 a second and 1000 a second."
    return Section("Kidney at several resolutions", text, table, [picture])


def kidney_shapes(inputs: ReportInputs) -> Section:
    """The kidney, pushed and pulled."""
    rows = inputs.tables["kidney_shapes"]
    triangles = {name: kidney.kidney(edge).mesh.surface for name, edge in inputs.setting.kidneys}
    text = [
        f"Springs move the kidney by {kidney.SHOWN:g} mm at the foremost surface node, inwards and outwards, to 1 %. "
        "palpate touch draws it so in the browser, as a wireframe or shaded; the frames a second of either are in the "
        "study realtime."
    ]
    picture = chapter_plots.kidney_shapes(rows, triangles), "Pushed, as a wireframe, and pulled, shaded."
    return Section("The kidney pushed and pulled", text, pictures=[picture])
