"""A report of a store of sessions: learning, groups, reliability, each session among the experts."""

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from palpate.arrays import Float64
from palpate.atomic_write import writable
from palpate.errors import DataError
from palpate.report.html_report import Section, write_report
from palpate.report.plot_axes import finish
from palpate.report.session_statistics import (
    composite,
    group_difference,
    learning_slope,
    mean_interval,
    reliability,
)
from palpate.report.session_store import StoredSession, read_sessions
from palpate.volumes.notebook_figure import line_style

# Of which less is better: title, unit, and what a row has of it.
MEASURES: Mapping[str, tuple[str, Callable[[StoredSession], float]]] = {
    "time": ("s", lambda row: row.seconds),
    "way of the tools": ("cm", lambda row: row.path / 10),
    "greatest force": ("N", lambda row: row.max_force),
    "time above the force": ("s", lambda row: row.over_force),
    "greatest strain": ("%", lambda row: 100 * row.max_strain),
    "wrong claims": ("", lambda row: float(row.wrong)),
    "lumps missed": ("", lambda row: float(row.sought - row.found)),
}
DRAWN = ("time", "greatest force", "wrong claims")
EXPERTS = "expert"
Key = tuple[str, str, str]


def session_report(path: str | Path, store: str | Path, *, command: str = "") -> Path:
    """Write a report of a store of sessions, as HTML.

    Sessions with another task, tissue or channel of the force are never pooled. People are the unit where groups are
    compared: of each the mean over the sessions.

    Parameters
    ----------
    path : str or Path
        The HTML file.
    store : str or Path
        The store. A group named expert is what the others are compared with.
    command : str, optional
        The command that the report names.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    FileError
        If a file cannot be read or written, or is no store.
    DataError
        If the store is empty.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 200)
    >>> pp.write_record("session.h5", session.record())
    >>> row = pp.add_session("class.db", "session.h5", pp.score(session.record(), tissue), "organ", "P07", "novice")
    >>> pp.session_report("class.html", "class.db").name
    'class.html'
    """
    path = writable(path)
    kept: dict[Key, list[StoredSession]] = {}
    for row in read_sessions(store):
        kept.setdefault((row.task, row.tissue, row.channel), []).append(row)
    if not kept:
        raise DataError(f"{store}: holds no session; palpate sessions add puts one in")
    sections = [section for key, rows in kept.items() for section in _sections(key, rows, len(kept) > 1)]
    write_report(path, "Sessions", command, [*sections, Section("How it is counted", MEANING)])
    return path


MEANING = [
    "Less is better in every measure. Sessions with another task, tissue or channel of the force are never pooled.",
    "Groups: of each person the mean over their sessions counts once. g is Hedges' standardized difference of the means "
    "with the exact 95 % interval; p is of the Mann-Whitney test, not corrected for the number of measures.",
    "Learning: Theil and Sen's slope over the logarithm of the attempt, a doubling of practice, with its 95 % interval.",
    "Reliability: intraclass correlation ICC(2,1) of the last two sessions of each person, with its 95 % interval.",
    "Among the experts: the mean over the measures of (experts' mean - value) / experts' deviation. 0 is an expert's "
    "mean, -1 a deviation worse. The interval is that of the experts' mean and deviation. Measures in which experts are "
    "alike are left out.",
    "These are statistics of a simulator. Nobody has shown that they say how a person treats patients.",
]


def _sections(key: Key, rows: Sequence[StoredSession], many: bool) -> list[Section]:
    title = f": {key[0]}, tissue {key[1][:8]}, {key[2]}" if many else ""
    groups = {g: [row for row in rows if row.group == g] for g in sorted({row.group for row in rows})}
    people = [[g, len({row.person for row in of}), len(of)] for g, of in groups.items()]
    out = [Section(f"Sessions{title}", [], [["group", "people", "sessions"], *people])]
    out.append(Section(f"Learning{title}", [], _learning(groups), [(_curves(groups), CAPTION)]))
    if len(groups) > 1:
        out.append(Section(f"Groups{title}", [], _differences(groups)))
    out.append(Section(f"Reliability{title}", [], _reliability(rows)))
    if standing := _standings(groups):
        out.append(Section(f"Among the experts{title}", [], standing))
    return out


def _values(rows: Sequence[StoredSession], name: str) -> Float64:
    return np.array([MEASURES[name][1](row) for row in rows])


def _titled(name: str) -> str:
    unit = MEASURES[name][0]
    return f"{name}, {unit}" if unit else name


def _by_person(rows: Sequence[StoredSession], name: str) -> Float64:
    people = sorted({row.person for row in rows})
    return np.array([_values([row for row in rows if row.person == p], name).mean() for p in people])


def _interval(value: float, ends: tuple[float, float], digits: int = 2) -> str:
    return f"{value:.{digits}f} ({ends[0]:.{digits}f} to {ends[1]:.{digits}f})"


def _learning(groups: Mapping[str, Sequence[StoredSession]]) -> list[list[str]]:
    table = [["measure", *(f"{group}, a doubling of practice" for group in groups)]]
    for name in MEASURES:
        cells = []
        for rows in groups.values():
            try:
                cells.append(_interval(*learning_slope([row.attempt for row in rows], _values(rows, name))))
            except DataError:
                cells.append("too few sessions, or all alike")
        table.append([_titled(name), *cells])
    return table


def _differences(groups: Mapping[str, Sequence[StoredSession]]) -> list[list[str]]:
    table = [["measure", "groups", "means", "g (95 %)", "p", "chance that the first is larger"]]
    for first, second in combinations(groups, 2):
        for name in MEASURES:
            a, b = (_by_person(groups[group], name) for group in (first, second))
            pair, means = f"{first} - {second}", f"{a.mean():.3g}, {b.mean():.3g}"
            try:
                found = group_difference(a, b)
            except DataError:
                table.append([_titled(name), pair, means, "too few people, or all alike", "", ""])
                continue
            said = [_interval(found.g, found.interval), f"{found.p:.3g}", f"{found.better:.2f}"]
            table.append([_titled(name), pair, means, *said])
    return table


def _reliability(rows: Sequence[StoredSession]) -> list[list[str]]:
    people = {p: [row for row in rows if row.person == p] for p in sorted({row.person for row in rows})}
    twice = [of[-2:] for of in people.values() if len(of) > 1]
    table = [["measure", f"ICC(2,1) of {len(twice)} people (95 %)"]]
    for name in MEASURES:
        pairs = np.array([_values(two, name) for two in twice])
        if len(twice) < 2 or np.ptp(pairs) == 0:
            table.append([_titled(name), "too few people with two sessions, or all alike"])
        else:
            table.append([_titled(name), _interval(*reliability(pairs))])
    return table


def _standings(groups: Mapping[str, Sequence[StoredSession]]) -> list[list[str]]:
    experts = groups.get(EXPERTS, ())
    if len(experts) < 3:
        return []
    known = np.column_stack([_values(experts, name) for name in MEASURES])
    table = [["person", "group", "attempt", "deviations from the experts (95 %)"]]
    for group, rows in groups.items():
        for row in rows if group != EXPERTS else ():
            value, ends = composite([of(row) for _, of in MEASURES.values()], known)
            table.append([row.person, group, str(row.attempt), _interval(value, ends)])
    return table if len(table) > 1 else []


CAPTION = (
    "Mean of each attempt with its 95 % interval; faint: each person. Grey: mean and deviation of the experts' sessions. "
    "Dashes tell the groups apart."
)


def _curves(groups: Mapping[str, Sequence[StoredSession]]) -> Figure:
    figure = Figure(figsize=(12.8, 3.6), layout="constrained")
    for axes, name in zip(figure.subplots(1, len(DRAWN)), DRAWN, strict=True):
        if len(groups.get(EXPERTS, ())) > 1:
            values = _values(groups[EXPERTS], name)
            axes.axhspan(values.mean() - values.std(ddof=1), values.mean() + values.std(ddof=1), color="#d9dee3", lw=0)
        for i, (group, rows) in enumerate(groups.items()):
            style = line_style(i)
            for person in {row.person for row in rows}:
                own = [row for row in rows if row.person == person]
                axes.plot([row.attempt for row in own], _values(own, name), lw=0.7, alpha=0.3, **style)
            attempts = sorted({row.attempt for row in rows})
            at = [_values([row for row in rows if row.attempt == n], name) for n in attempts]
            means = np.array([mean_interval(values) for values in at])
            axes.errorbar(attempts, means[:, 0], np.nan_to_num(means[:, 1]), label=group, capsize=3, **style)
        finish(axes, "", "attempt", _titled(name))
        axes.set_ylim(bottom=0)
        axes.xaxis.get_major_locator().set_params(integer=True)
    figure.axes[0].legend(frameon=False, fontsize=8)
    return figure
