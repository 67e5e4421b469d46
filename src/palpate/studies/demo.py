"""The demos by name: each leaves every intermediate file and report.html in a folder."""

from collections.abc import Callable, Mapping
from pathlib import Path

from palpate.errors import DataError
from palpate.studies.breast import breast
from palpate.studies.head import head
from palpate.studies.kidney import kidney
from palpate.studies.stages import Stages
from palpate.tissue.tissue import Tissue

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
    written.
    """
    if which not in DEMOS:
        raise DataError(f"demo: there is no {which!r}; choose from {', '.join(DEMOS)}")
    return DEMOS[which](Stages(Path(folder), resume, progress))
