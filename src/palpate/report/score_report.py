"""A session's scores as a report that a teacher can read, alone or beside a reference session."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from palpate.atomic_write import replacing, writable
from palpate.report.html_report import Section, write_report
from palpate.report.plot_axes import finish
from palpate.report.tables import write_table
from palpate.simulation.scoring import Claim, Score
from palpate.volumes.notebook_figure import line_style

TITLES = {"touch": "A session", "lump": "Finding the lump", "biopsy": "Taking a sample"}
MISSING = "–"


def score_report(path: str | Path, score: Score, reference: Score | None = None, *, command: str = "") -> list[Path]:
    """Write a score as HTML, and next to it its values (.json), its table and its curves (.csv).

    Parameters
    ----------
    path : str or Path
        The HTML file.
    score : Score
        The score.
    reference : Score, optional
        Another session on the same task, for comparison.
    command : str, optional
        The command that the report names.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    FileError
        If a file cannot be written.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 200)
    >>> files = pp.score_report("score.html", pp.score(session.record(), tissue))
    >>> sorted(file.name for file in files)
    ['score-curves.csv', 'score.csv', 'score.html', 'score.json']
    """
    path = writable(path)
    sessions = {"this session": score} | ({} if reference is None else {"reference": reference})
    figures = [
        (_force(sessions), "The greatest force that any tool felt in each hundredth of a second; dashed: the limit."),
        (_strain(sessions), "The greatest stretch of any piece of tissue, ten times a second; dashed: the limit."),
    ]
    sections = [
        Section("Result", _result(score), _table(sessions)),
        Section("Force and strain over time", pictures=figures),
        Section("What was claimed", _claims_text(score), _claims(sessions)),
        Section("How it is counted", _meaning(score)),
    ]
    write_report(path, TITLES[score.task.kind], command, sections)
    values = path.with_suffix(".json")
    with replacing(values) as part:
        whole = {name: one.values() for name, one in sessions.items()}
        part.write_text(json.dumps(whole, indent=1) + "\n", encoding="utf-8")
    table, curves = path.with_suffix(".csv"), path.with_name(f"{path.stem}-curves.csv")
    head, *rows = _table(sessions)
    write_table(table, [dict(zip(head, row, strict=True)) for row in rows])
    write_table(curves, _curves(sessions))
    return [path, values, table, curves]


def compared(score: Score, reference: Score) -> list[list[str]]:
    """The table of both: a head, then a row a measure with the difference."""
    return _table({"this session": score, "reference": reference})


def _result(score: Score) -> list[str]:
    text = [score.task.text] if score.task.text else ["No task was set: what was done, and what the tissue bore."]
    if score.sought:
        met = "was" if score.found == score.sought else "was not"
        found = "" if score.sought == 1 else f" ({score.found} of {score.sought})"
        text.append(f"The target ({score.target}) {met} found{found}, with {score.wrong} wrong claims.")
    return text


def _measures(score: Score) -> list[tuple[str, str, float]]:
    """Name, unit, value of each line of the table."""
    limit = score.task
    lines = [
        ("time", "s", score.seconds),
        *((f"way of tool {k + 1}", "cm", way / 10) for k, way in enumerate(score.path) if way or k == 0),
        ("touches", "", float(score.touches)),
        ("punctures by the needle", "", float(score.punctures)),
        ("mean force", "N", score.mean_force),
        ("greatest force", "N", score.max_force),
        (f"time above {limit.force:g} N", "s", score.over_force),
        ("work done on the tissue", "mJ", score.work),
        ("greatest strain", "%", 100 * score.max_strain),
        (f"time with strain above {limit.strain:.0%}", "s", score.over_strain),
        (f"tissue ever strained above {limit.strain:.0%}", "ml", score.strained / 1000),
    ]
    if score.sought:
        lines += [("lumps found", f"of {score.sought}", float(score.found)), ("wrong claims", "", float(score.wrong))]
    return lines


def _table(sessions: Mapping[str, Score]) -> list[list[str]]:
    each = {name: {(line, unit): value for line, unit, value in _measures(one)} for name, one in sessions.items()}
    lines = list(dict.fromkeys(key for values in each.values() for key in values))
    rows = [["measure", "unit", *each, *(["difference"] if len(each) > 1 else [])]]
    for key in lines:
        values = [each[name].get(key) for name in each]
        cells = [MISSING if value is None else f"{value:.4g}" for value in values]
        if len(values) > 1:
            mine, other = values
            cells.append(MISSING if mine is None or other is None else f"{mine - other:+.4g}")
        rows.append([*key, *cells])
    return rows


def _claims(sessions: Mapping[str, Score]) -> list[list[str]]:
    rows = [
        [name, f"{c.seconds:.1f} s", c.what, "right" if c.right else "wrong", *_where(c)]
        for name, one in sessions.items()
        for c in one.claims
    ]
    return (
        [["session", "when", "claim", "", "mm from the lump", "at best", "mm from its middle"], *rows] if rows else []
    )


def _where(claim: Claim) -> list[str]:
    return [MISSING if x is None else f"{x:.1f}" for x in (claim.distance, claim.nearest, claim.centre)]


def _claims_text(score: Score) -> list[str]:
    if not score.claims:
        return ["Nothing was claimed."]
    return [
        "A lump is claimed under a tool: the distance is from the place touched, on the skin at rest, to the lump's "
        "nearest point, and at best that of the skin nearest to it. A sample is claimed at a needle's tip: the distance "
        "is 0 inside the lump, in the tissue as it was deformed at that moment."
    ]


def _meaning(score: Score) -> list[str]:
    task = score.task
    return [
        "Every number comes from replaying the recorded commands in lockstep on the same tissue: the replay has the "
        "session's own forces, to the bit where it runs on the same kind of processor.",
        "Time runs from the first touch to the moment when the last lump was found, or to the last touch.",
        "Mean force is over the thousandths of a second in which a tool felt any. Work is what the tools put into the "
        "tissue less what it gave back.",
        f"Strain is the greatest principal stretch of a piece of tissue, less one. The limits, {task.force:g} N and "
        f"{task.strain:.0%}, and the {task.within:g} mm by which a mark may miss, are the teacher's choice and no "
        f"clinical thresholds.",
        "A needle meets the tissue's stiffness until it pierces the surface, then cutting at its tip and friction along "
        "its shaft, the parts of A. M. Okamura, C. Simone and M. D. O'Leary, IEEE Trans. Biomed. Eng. 51 (2004) 1707.",
    ]


def _force(sessions: Mapping[str, Score]) -> Figure:
    return _overlaid("force, N", {name: (s.time, s.force) for name, s in sessions.items()}, _first(sessions).task.force)


def _strain(sessions: Mapping[str, Score]) -> Figure:
    curves = {name: (s.strain_time, 100 * s.strain) for name, s in sessions.items()}
    return _overlaid("greatest strain, %", curves, 100 * _first(sessions).task.strain)


def _first(sessions: Mapping[str, Score]) -> Score:
    return next(iter(sessions.values()))


def _overlaid(what: str, curves: Mapping[str, tuple[np.ndarray, np.ndarray]], limit: float) -> Figure:
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    axes = figure.subplots()
    for i, (name, (time, values)) in enumerate(curves.items()):
        axes.plot(time, values, lw=1.2, label=name, **line_style(i))
    axes.axhline(limit, color="#5b6775", lw=1.0, ls="--")
    axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    finish(axes, "", "time, s", what)
    if len(curves) > 1:
        axes.legend(frameon=False, fontsize=8)
    return figure


def _curves(sessions: Mapping[str, Score]) -> list[dict[str, object]]:
    force = [
        {"session": name, "seconds": t, "force_n": f, "strain": ""}
        for name, one in sessions.items()
        for t, f in zip(one.time.tolist(), one.force.tolist(), strict=True)
    ]
    strain = {
        (name, t): s
        for name, one in sessions.items()
        for t, s in zip(one.strain_time.tolist(), one.strain.tolist(), strict=True)
    }
    return [row | {"strain": strain.get((row["session"], row["seconds"]), "")} for row in force]
