"""Whether a recorded session has passed its lesson."""

import json
from collections.abc import Callable
from dataclasses import dataclass

from palpate.errors import DataError
from palpate.simulation.lesson import Lesson
from palpate.simulation.lesson_case import lesson_case
from palpate.simulation.recording import Record
from palpate.simulation.scoring import Score, score
from palpate.tissue.io import read_tissue


@dataclass(frozen=True, eq=False)
class LessonResult:
    """What a session in a lesson came to.

    Parameters
    ----------
    score : Score
        Its score.
    seed : int
        Which case it was.
    channel : str
        How the force came to the trainee. Scores of different channels are not compared.
    failed : tuple of str
        What was not passed; empty if it was.

    Attributes
    ----------
    passed : bool
        Whether it was.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 200)
    >>> pp.LessonResult(pp.score(session.record(), tissue), 7, "screen", ()).passed
    True
    """

    score: Score
    seed: int
    channel: str
    failed: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether it was passed."""
        return not self.failed

    def text(self) -> str:
        """Return the result in a few lines.

        Returns
        -------
        str
            The lines.
        """
        verdict = "passed" if self.passed else f"not passed: {'; '.join(self.failed)}"
        return f"{self.score.text()}\ncase {self.seed}, force by {self.channel}: {verdict}"


def lesson_result(
    record: Record, lesson: Lesson, *, progress: Callable[[float], None] = lambda share: None
) -> LessonResult:
    """Judge a recorded session by its lesson: the case is drawn again, and the session replayed on it.

    Parameters
    ----------
    record : Record
        The session.
    lesson : Lesson
        The lesson.
    progress : callable, optional
        Called with the share done.

    Returns
    -------
    LessonResult
        The result.

    Raises
    ------
    DataError
        If the session was recorded in no lesson, or in another one.
    FileError
        If the organ cannot be read.

    Examples
    --------
    >>> lesson = pp.Lesson("One lump", Path("tissue.vtu"), "finding a lump with a pointer", "the feel of a glove")
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([None] * 200)
    >>> try:
    ...     pp.lesson_result(session.record(), lesson)
    ... except pp.errors.DataError:
    ...     print("made in no lesson")
    made in no lesson
    """
    try:
        taken = json.loads(record.lesson)
        digest, seed, channel = str(taken["digest"]), int(taken["seed"]), str(taken["channel"])
    except (ValueError, TypeError, KeyError):
        raise DataError("record: was made in no lesson; take one: palpate lesson start lesson.yaml --seed 1") from None
    if digest != lesson.digest:
        raise DataError(
            f"record: was made in lesson {digest} ({taken.get('title')}), not in {lesson.digest}; the file may have "
            "been changed since"
        )
    found = score(record, lesson_case(lesson, read_tissue(lesson.organ), seed), lesson.limits, progress=progress)
    return LessonResult(found, seed, channel, _failed(lesson, found))


def _failed(lesson: Lesson, found: Score) -> tuple[str, ...]:
    rule = lesson.rule
    reasons = []
    if found.found < rule.found * found.sought - 1e-9:
        reasons.append(f"{found.found} of {found.sought} found")
    if found.wrong > rule.wrong:
        reasons.append(f"{found.wrong} wrong claims, {rule.wrong} allowed")
    if found.over_force > rule.over_force:
        reasons.append(f"{found.over_force:.1f} s above {lesson.limits.force:g} N, {rule.over_force:g} s allowed")
    return tuple(reasons)
