"""Lessons: a file that says which organ, what is sought, how, how long, and when it is passed."""

import hashlib
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from palpate.bounded_read import read_text
from palpate.errors import DataError
from palpate.scans.bounded_yaml import yaml_in
from palpate.simulation.training_task import ASKED, Task

VERSION = 1
TOOLS = ("press", "pull", "grasp", "needle")
VIEWS = ("plain", "displacement", "strain", "wireframe")  # what a display may show without telling what is inside
KEYS = (
    "title", "organ", "trains", "cannot", "task", "text", "tools", "views", "time", "claims", "limits", "lumps", "pass",
)  # fmt: skip
EXAM_LENGTH, EXAM_FORCE, EXAM_WORK = 0.05, 0.01, 0.1  # mm, N, N mm: steps in which an exam tells them
MOST_LUMPS = 5
Range = tuple[float, float]


@dataclass(frozen=True)
class Lumps:
    """Limits between which a case's lumps are drawn.

    count: how many. radius, depth: mm, depth from the organ's skin to the lump's. young: kPa.
    """

    count: tuple[int, int] = (1, 1)
    radius: Range = (6.0, 9.0)
    depth: Range = (3.0, 12.0)
    young: Range = (40.0, 80.0)


@dataclass(frozen=True)
class PassRule:
    """When a session is passed. found: share of the lumps. wrong: claims that may be wrong. over_force: s above the limit."""

    found: float = 1.0
    wrong: int = 1
    over_force: float = 5.0


@dataclass(frozen=True)
class Lesson:
    """A lesson, as its file says. Without a name in it, a case is the organ, the lesson and a seed.

    Parameters
    ----------
    title : str
        What the page shows.
    organ : Path
        The tissue without lumps (.vtu).
    trains, cannot : str
        Which skill it trains, and which it cannot.
    task : {"lump", "biopsy"}, optional
        What is asked.
    text : str, optional
        What the page tells the trainee; a sentence about the task if it is empty.
    tools : tuple of str, optional
        Tools that may be used: press, pull, grasp, needle.
    views : tuple of str, optional
        What may be seen: plain, displacement, strain, wireframe.
    time : float, optional
        Seconds from the first touch to the end; 0: no limit.
    claims : int, optional
        How many claims may be made.
    limits : Task, optional
        Force, strain, and how far a claim may be off.
    lumps : Lumps, optional
        Between which limits cases are drawn.
    rule : PassRule, optional
        When it is passed.
    digest : str, optional
        A hash of the file.

    Examples
    --------
    >>> lesson = pp.Lesson("One lump", Path("tissue.vtu"), "finding a lump with a pointer", "the feel of a glove")
    >>> lesson.tools
    ('press', 'pull', 'grasp', 'needle')
    """

    title: str
    organ: Path
    trains: str
    cannot: str
    task: str = "lump"
    text: str = ""
    tools: tuple[str, ...] = TOOLS
    views: tuple[str, ...] = ("plain",)
    time: float = 180.0
    claims: int = 3
    limits: Task = field(default_factory=lambda: Task("lump"))
    lumps: Lumps = field(default_factory=Lumps)
    rule: PassRule = field(default_factory=PassRule)
    digest: str = ""

    @property
    def asked(self) -> str:
        """What the page tells the trainee."""
        return self.text or ASKED[self.task]


def read_lesson(path: str | Path) -> Lesson:
    """Read a lesson.

    Parameters
    ----------
    path : str or Path
        A YAML file, such as `palpate lesson new` writes. The organ's path is relative to it.

    Returns
    -------
    Lesson
        The lesson.

    Raises
    ------
    FileError
        If the file is missing, or is no YAML.
    DataError
        If a key is unknown or missing, or a value is not what the lesson can have.

    Examples
    --------
    >>> _ = Path("lesson.yaml").write_text(pp.lesson_template("tissue.vtu"))
    >>> pp.read_lesson("lesson.yaml").claims
    3
    """
    path = Path(path)
    text = read_text(path)
    content = yaml_in(path, text, f"write one: palpate lesson new {path}")
    if not isinstance(content, dict) or content.get("palpate lesson") != VERSION:
        raise DataError(f"{path}: expected `palpate lesson: {VERSION}` in it; write one: palpate lesson new {path}")
    given = {str(key): value for key, value in content.items() if key != "palpate lesson"}
    try:
        return _lesson(given, path.parent, hashlib.sha256(text.encode()).hexdigest()[:16])
    except DataError as problem:
        raise DataError(f"{path}: {problem}") from None


def _lesson(given: dict[str, Any], folder: Path, digest: str) -> Lesson:
    known = {each.name for each in fields(Lesson)} - {"rule", "digest"} | {"pass"}
    if unknown := sorted(set(given) - known):
        raise DataError(f"{unknown[0]}: no such key; there are {', '.join(sorted(known))}")
    for name in ("title", "organ", "trains", "cannot"):
        if not (isinstance(given.get(name), str) and given[name].strip()):
            raise DataError(f"{name}: missing, or no text; say {_meaning(name)}")
    task = given.get("task", "lump")
    if task not in ("lump", "biopsy"):
        raise DataError(f"task: {task!r}; a lesson asks for lump or biopsy")
    limits = _numbers(given.get("limits", {}), "limits", ("force", "strain", "within"))
    rule = _numbers(given.get("pass", {}), "pass", ("found", "wrong", "over_force"))
    if not 0 < rule.get("found", 1) <= 1 or rule.get("wrong", 0) < 0 or rule.get("over_force", 0) < 0:
        raise DataError("pass: found is a share above 0, up to 1; wrong and over_force are 0 or more")
    return Lesson(
        title=given["title"].strip(),
        organ=folder / given["organ"],
        trains=given["trains"].strip(),
        cannot=given["cannot"].strip(),
        task=task,
        text=str(given.get("text", "")).strip(),
        tools=_words(given.get("tools", list(TOOLS)), "tools", TOOLS),
        views=_words(given.get("views", ["plain"]), "views", VIEWS),
        time=_number(given.get("time", 180), "time", 0, 36_000),
        claims=int(_number(given.get("claims", 3), "claims", 1, 100)),
        limits=Task(task, "", limits.get("within", 5.0), limits.get("force", 5.0), limits.get("strain", 0.3)),
        lumps=_lumps(given.get("lumps", {})),
        rule=PassRule(rule.get("found", 1.0), int(rule.get("wrong", 1)), rule.get("over_force", 5.0)),
        digest=digest,
    )


def _meaning(name: str) -> str:
    return {
        "title": "what the page shows",
        "organ": "the tissue's file, such as tissue.vtu",
        "trains": "which skill the lesson trains",
        "cannot": "which skill it cannot train",
    }[name]


def _lumps(given: Any) -> Lumps:
    if not isinstance(given, dict):
        raise DataError("lumps: expected count, radius, depth and young, each [least, most]")
    names = {each.name for each in fields(Lumps)}
    if unknown := sorted(set(given) - names):
        raise DataError(f"lumps: {unknown[0]} is no key; there are {', '.join(sorted(names))}")
    made: dict[str, Any] = {}
    for name, value in given.items():
        low, high = value if isinstance(value, list) and len(value) == 2 else (value, value)
        ends = _number(low, f"lumps: {name}", 0, 1e4), _number(high, f"lumps: {name}", 0, 1e4)
        if ends[0] > ends[1] or (ends[0] <= 0 and name != "depth"):
            raise DataError(f"lumps: {name}: {value}; expected [least, most], above 0")
        made[name] = (int(ends[0]), int(ends[1])) if name == "count" else ends
    if made.get("count", (1, 1))[1] > MOST_LUMPS:
        raise DataError(f"lumps: count: {made['count'][1]}; at most {MOST_LUMPS}")
    return Lumps(**made)


def _words(given: Any, name: str, known: tuple[str, ...]) -> tuple[str, ...]:
    words = given if isinstance(given, list) else [given]
    for word in words:
        if word not in known:
            raise DataError(f"{name}: {word!r} is none; choose from {', '.join(known)}")
    if not words:
        raise DataError(f"{name}: none given; choose from {', '.join(known)}")
    return tuple(word for word in known if word in words)


def _numbers(given: Any, name: str, known: tuple[str, ...]) -> dict[str, float]:
    if not isinstance(given, dict):
        raise DataError(f"{name}: {given!r}; expected {', '.join(known)}")
    if unknown := sorted(set(given) - set(known)):
        raise DataError(f"{name}: {unknown[0]} is no key; there are {', '.join(known)}")
    return {key: _number(value, f"{name}: {key}", 0, 1e4) for key, value in given.items()}


def _number(value: Any, name: str, low: float, high: float) -> float:
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not (np.isfinite(value) and low <= value <= high)
    ):
        raise DataError(f"{name}: {value!r}; expected a number from {low:g} to {high:g}")
    return float(value)


def lesson_template(organ: str) -> str:
    """Return the text of a lesson that can be changed by hand.

    Parameters
    ----------
    organ : str
        The tissue's file, relative to where the lesson will lie.

    Returns
    -------
    str
        YAML.

    Examples
    --------
    >>> "palpate lesson: 1" in pp.lesson_template("tissue.vtu")
    True
    """
    return f"""palpate lesson: {VERSION}
title: Find the lump
organ: {organ}                     # without lumps; relative to this file
task: lump                            # lump, or biopsy
trains: searching an organ's surface for a stiff place, by pressing and by what is read and heard
cannot: the feel of a hand; a pointer gives no force
tools: [press, pull]                  # of press, pull, grasp, needle
views: [plain]                        # of plain, displacement, strain, wireframe
time: 180                             # s from the first touch; 0: no limit
claims: 3
lumps:                                # drawn by the seed of a case, each between two limits
  count: [1, 1]
  radius: [6, 9]                      # mm
  depth: [3, 12]                      # mm below the skin
  young: [40, 80]                     # kPa
limits: {{force: 5, strain: 0.3, within: 5}}    # N, share, mm beside a lump that a claim may be
pass: {{found: 1, wrong: 1, over_force: 5}}     # share of the lumps, claims, s above the force
"""
