"""What a study keeps of its runs, so that an interrupted one goes on."""

import json
from pathlib import Path
from typing import Any

from palpate.atomic import replacing
from palpate.errors import FileError
from palpate.studies.stages import Stages
from palpate.version import __version__


def same_study(stages: Stages, name: str) -> None:
    """Marks the folder with the study that is run there: another would be resumed from files of the same names.

    Raises `FileError` where another one left its mark.
    """
    mark = stages.folder / "study.txt"
    now = f"{name}, palpate {__version__}\n"
    if mark.exists() and mark.read_text() != now:
        raise FileError(
            f"{stages.folder}: holds the study {mark.read_text().strip()!r}, not {now.strip()!r}; "
            f"choose another folder with -o, or remove that one"
        )
    with replacing(mark) as temporary:
        temporary.write_text(now)


def write_json(path: Path, record: Any) -> None:
    """One record, whole or not at all; numbers that are none are refused."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(record, allow_nan=False), encoding="utf-8")


def read_json(path: Path) -> Any:
    """What `write_json` wrote."""
    return json.loads(path.read_text(encoding="utf-8"))
