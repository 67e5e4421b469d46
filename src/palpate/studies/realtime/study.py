"""The whole study: one folder with runs, tables, figures, and one report."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from palpate.report.stages import Progress, Stages, silent
from palpate.report.tables import Row
from palpate.studies.realtime import browser, loop_timing
from palpate.studies.realtime.config import FULL, QUICK
from palpate.studies.realtime.report_sections import sections
from palpate.studies.run_store import read_json, write_json
from palpate.studies.study import Study

TITLE = "The simulator in real time, measured"


def realtime_study(
    folder: str | Path,
    *,
    quick: bool = False,
    resume: bool = False,
    docs: str | Path | None = None,
    progress: Progress = silent,
) -> Path:
    """Measure the real-time tables of chapter 3 of Chen's dissertation, on a kidney.

    It measures the time of a deformation by every model, the rate of the loop, steps of the force, memory, frame rate and
    latency. Times are wall times, so leave the machine otherwise idle.

    Parameters
    ----------
    folder : str or Path
        Receives report.html, and the folders tables, figures and runs.
    quick : bool, optional
        Use small meshes, for tests.
    resume : bool, optional
        Go on from the results that are there.
    docs : str or Path, optional
        A folder that receives the page realtime.md and its pictures.
    progress : callable, optional
        Called with what is done and the share done.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    FileError
        If a folder cannot be written, or holds another study.

    References
    ----------
    Chen, PhD dissertation, University of Delaware, 2006.

    Examples
    --------
    >>> pp.realtime_study("realtime", quick=True)  # doctest: +SKIP
    """
    setting = QUICK if quick else FULL
    models = f", models {' '.join(setting.models)}"
    study = Study("realtime", TITLE, Stages(Path(folder), resume), quick, docs, models)
    parts = [(f"{what}-{k[0]}", partial(work, setting, *k)) for k in setting.kidneys for what, work in WORKS]
    tables: dict[str, list[Row]] = {}
    for done, (name, make) in enumerate(parts):
        progress(f"{done + 1} of {len(parts)}: {name}", done / len(parts))
        for table, rows in study.stages(f"runs/{name}.json", make, write_json, read_json).items():
            tables.setdefault(table, []).extend(rows)
    report = study.publish(tables, sections(tables))
    progress("report", 1.0)
    return report


WORKS: tuple[tuple[str, Callable[..., dict[str, list[Row]]]], ...] = (
    ("loop", loop_timing.measured),
    ("page", browser.pages),
)
