"""The demos by name: each leaves every intermediate file and report.html in a folder."""

from collections.abc import Callable, Mapping
from pathlib import Path

from palpate.demos.breast import breast
from palpate.demos.head import head
from palpate.demos.kidney import kidney
from palpate.errors import DataError
from palpate.report.stages import Progress, Stages, silent
from palpate.tissue.tissue import Tissue

DEMOS: Mapping[str, Callable[[Stages], Mapping[str, Tissue]]] = {"breast": breast, "kidney": kidney, "head": head}


def run_demo(
    which: str,
    folder: str | Path,
    *,
    resume: bool = False,
    progress: Progress = silent,
) -> Mapping[str, Tissue]:
    """Run a demo and return its tissues.

    Parameters
    ----------
    which : {"breast", "kidney", "head"}
        The demo.
    folder : str or Path
        Receives every intermediate file and report.html.
    resume : bool, optional
        Go on from the files of an earlier run.
    progress : callable, optional
        Called with what is done and the share done.

    Returns
    -------
    mapping of str to Tissue
        The tissues to touch, by name.

    Raises
    ------
    DataError
        If there is no such demo.
    FileError
        If the folder cannot be written, or holds another demo.

    Examples
    --------
    >>> tissues = pp.run_demo("breast", "demo")  # doctest: +SKIP
    >>> try:
    ...     pp.run_demo("heart", "demo")
    ... except pp.errors.DataError:
    ...     print("no such demo")
    no such demo
    """
    if which not in DEMOS:
        raise DataError(f"demo: there is no {which!r}; choose from {', '.join(DEMOS)}")
    stages = Stages(Path(folder), resume, progress)
    stages.claim("demo", which)
    return DEMOS[which](stages)
