"""The whole study: one folder with runs, tables, figures, and one report."""

from dataclasses import replace
from pathlib import Path

from palpate.errors import DataError
from palpate.report.stages import Progress, Stages, silent
from palpate.studies.study import Study
from palpate.studies.tomosynthesis.config import FULL, QUICK
from palpate.studies.tomosynthesis.pairs import pair_rows, subset_rows
from palpate.studies.tomosynthesis.report_inputs import ReportInputs
from palpate.studies.tomosynthesis.report_sections import sections
from palpate.studies.tomosynthesis.run_store import run_all
from palpate.studies.tomosynthesis.tables import make_tables

MOST_SEEDS = 1000
TITLE = "Multi-resolution MAP tomosynthesis, measured"


def tomosynthesis_study(
    folder: str | Path,
    *,
    quick: bool = False,
    seeds: int | None = None,
    resume: bool = False,
    docs: str | Path | None = None,
    progress: Progress = silent,
) -> Path:
    """Run the experiments of chapter 2 of Chen's dissertation, and more.

    Parameters
    ----------
    folder : str or Path
        Receives report.html, and the folders tables, figures, volumes and runs.
    quick : bool, optional
        Use a small grid and two seeds, for tests.
    seeds : int, optional
        Scans of each dose behind the chapter's claims, in place of 20; what goes beyond it has at most three. From five on
        the report tells intervals and standard deviations.
    resume : bool, optional
        Go on from the runs that are there.
    docs : str or Path, optional
        A folder that receives the page tomosynthesis.md and its pictures.
    progress : callable, optional
        Called with what is done and the share done.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    DataError
        If there are less than one seeds.
    FileError
        If a folder cannot be written, or holds another study.

    References
    ----------
    Chen, PhD dissertation, University of Delaware, 2006.

    Examples
    --------
    >>> pp.tomosynthesis_study("tomosynthesis", quick=True)  # doctest: +SKIP
    """
    setting, option = (QUICK if quick else FULL), ""
    if seeds is not None:
        if not 1 <= seeds <= MOST_SEEDS:
            raise DataError(f"seeds: expected 1 to {MOST_SEEDS} scans of each dose, got {seeds}")
        setting, option = replace(setting, seeds=seeds, few=min(seeds, setting.few)), f" --seeds {seeds}"
    study = Study("tomosynthesis", TITLE, Stages(Path(folder), resume), quick, docs, option=option)
    records, image_quality = run_all(study.stages, setting, progress)
    tables = make_tables(records, setting)
    tables |= {"pairs": pair_rows(records), "subsets": subset_rows(records, setting.passes)}
    progress("report", 0.0)
    inputs = ReportInputs(study.stages.folder, image_quality, records, tables)
    report = study.publish(tables, sections(inputs))
    progress("report", 1.0)
    return report
