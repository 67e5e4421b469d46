"""The demos by name: each leaves every intermediate file and report.html in a folder."""

from collections.abc import Callable, Mapping
from pathlib import Path

from palpate.atomic import replacing
from palpate.errors import DataError, FileError
from palpate.studies.breast import breast
from palpate.studies.head import head
from palpate.studies.kidney import kidney
from palpate.studies.stages import Stages
from palpate.tissue.tissue import Tissue
from palpate.version import __version__

DEMOS: Mapping[str, Callable[[Stages], Mapping[str, Tissue]]] = {"breast": breast, "kidney": kidney, "head": head}


def demonstrate(
    which: str,
    folder: str | Path,
    *,
    resume: bool = False,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Mapping[str, Tissue]:
    """Runs demo "breast", "kidney" or "head" and gives the tissues there are to touch, by name.

    folder: made if need be; gets every intermediate file and report.html. resume: go on from files of an earlier run.
    progress(what, share): told how far it is. Raises `DataError` for another name, `FileError` when the folder cannot be
    written, or holds what another demo left.
    """
    if which not in DEMOS:
        raise DataError(f"demo: there is no {which!r}; choose from {', '.join(DEMOS)}")
    stages = Stages(Path(folder), resume, progress)
    _same_demo(stages, which)
    return DEMOS[which](stages)


def _same_demo(stages: Stages, which: str) -> None:
    """Marks the folder with the demo that is run there: the files of another bear the same names, and would be resumed."""
    mark, now = stages.folder / "demo.txt", f"{which}, palpate {__version__}\n"
    if mark.exists() and mark.read_text() != now:
        raise FileError(
            f"{stages.folder}: holds the demo {mark.read_text().strip()!r}, not {now.strip()!r}; "
            f"choose another folder with -o, or remove that one"
        )
    with replacing(mark) as temporary:
        temporary.write_text(now)
