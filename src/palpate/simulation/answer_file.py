"""The file of an experiment's answers: lines of JSON, one more for each answer, so that a death loses none.

The first line says what is asked, of which organ. No line holds a name or a date.
"""

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from palpate.bounded_read import read_text
from palpate.errors import DataError, FileError
from palpate.simulation.forced_choice import ForcedChoice, Trial

KIND = "palpate answers 1"


@dataclass(frozen=True)
class Answers:
    """What a file of answers holds.

    Parameters
    ----------
    experiment : ForcedChoice
        What is asked.
    organ : str
        A hash of the organ.
    trials : tuple of Trial
        The trials that were answered.

    Examples
    --------
    >>> answers = pp.Answers(pp.ForcedChoice(trials=2), "", ())
    >>> answers.next_level is not None
    True
    """

    experiment: ForcedChoice
    organ: str
    trials: tuple[Trial, ...] = ()

    @property
    def next_level(self) -> float | None:
        """Level of the next trial; None if the procedure is done."""
        return self.experiment.next_level([(one.level, one.right) for one in self.trials])


def read_answers(path: str | Path) -> Answers:
    """Read a file of answers.

    Parameters
    ----------
    path : str or Path
        What `ask` has written. A last line that a death cut short is left out.

    Returns
    -------
    Answers
        What was asked and answered.

    Raises
    ------
    FileError
        If the file is missing or none of this kind.

    Examples
    --------
    >>> pp.start_answers("answers.jsonl", pp.Answers(pp.ForcedChoice(seed=4), ""))
    >>> pp.read_answers("answers.jsonl").experiment.seed
    4
    """
    path = Path(path)
    lines = read_text(path).split("\n")[:-1]  # what follows the last end of a line was cut short
    try:
        head, *rest = (json.loads(line) for line in lines)
        if head.pop("kind") != KIND:
            raise ValueError
        organ = str(head.pop("organ"))
        experiment = ForcedChoice(**{**head, "levels": tuple(head["levels"])})
        trials = tuple(_trial(line) for line in rest)
    except DataError as problem:
        raise FileError(f"{path}: {problem}; give a file that palpate ask has written") from None
    except (ValueError, TypeError, KeyError, AttributeError):
        raise FileError(f"{path}: holds no answers; give a file that palpate ask has written") from None
    orders = experiment.orders
    for k, one in enumerate(trials):
        if one.trial != k + 1 or k >= len(orders) or one.order != orders[k] or one.question != experiment.question:
            raise FileError(f"{path}: line {k + 2} is not trial {k + 1} of this experiment; was it changed by hand?")
    return Answers(experiment, organ, trials)


def _trial(line: dict[str, Any]) -> Trial:
    if line.pop("right") not in (True, False):
        raise ValueError
    return Trial(**{**line, "force": tuple(line["force"])})


def start_answers(path: str | Path, answers: Answers) -> None:
    """Write the first line of a file of answers, which must not be there yet.

    Parameters
    ----------
    path : str or Path
        The file (.jsonl).
    answers : Answers
        What is asked; its trials are written too.

    Raises
    ------
    FileError
        If the file is there already or cannot be written.

    Examples
    --------
    >>> pp.start_answers("first.jsonl", pp.Answers(pp.ForcedChoice(), ""))
    >>> Path("first.jsonl").read_text().count("\\n")
    1
    """
    path = Path(path)
    head = {"kind": KIND, "organ": answers.organ, **asdict(answers.experiment)}
    _append(path, [head, *(_line(one) for one in answers.trials)], "xb")


def append_trial(path: Path, trial: Trial) -> None:
    """Adds an answer, and waits until the disk has it. A line that was cut short goes. Raises `FileError`."""
    _append(path, [_line(trial)], "r+b")


def _line(trial: Trial) -> dict[str, Any]:
    return {**asdict(trial), "right": trial.right}


def _append(path: Path, lines: list[dict[str, Any]], mode: str) -> None:
    text = "".join(json.dumps(line) + "\n" for line in lines)
    try:
        with path.open(mode) as file:
            if mode == "r+b":
                whole = file.read().rfind(b"\n") + 1
                file.seek(whole)
                file.truncate()
            file.write(text.encode())
            file.flush()
            os.fsync(file.fileno())
    except FileExistsError:
        raise FileError(f"{path}: is there already; go on with it by --resume, or choose another name") from None
    except OSError as problem:
        raise FileError(f"{path}: cannot be written ({problem.strerror}); choose another place") from None
