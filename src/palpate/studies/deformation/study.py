"""The whole study: one folder with runs, tables, figures, and one report."""

from pathlib import Path

from palpate.report.stages import Progress, Stages, silent
from palpate.studies.deformation.config import FULL, QUICK
from palpate.studies.deformation.report_inputs import ReportInputs
from palpate.studies.deformation.report_sections import sections
from palpate.studies.deformation.run_store import run_all
from palpate.studies.study import Study
from palpate.tissue.models.registry import names

TITLE = "Springs, finite elements and the ladder between, measured"


def deformation_study(
    folder: str | Path,
    *,
    quick: bool = False,
    resume: bool = False,
    docs: str | Path | None = None,
    progress: Progress = silent,
) -> Path:
    """Run the experiments of chapter 3 of Chen's dissertation, and more, on a cube and a kidney.

    Parameters
    ----------
    folder : str or Path
        Receives report.html, and the folders tables, figures and runs.
    quick : bool, optional
        Use small meshes, for tests.
    resume : bool, optional
        Go on from the experiments that are there.
    docs : str or Path, optional
        A folder that receives the page deformation.md and its pictures.
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
    >>> pp.deformation_study("deformation", quick=True)  # doctest: +SKIP
    """
    setting = QUICK if quick else FULL
    models = f", models {' '.join(names())}"
    study = Study("deformation", TITLE, Stages(Path(folder), resume), quick, docs, models)
    tables = run_all(study.stages, setting, progress)
    progress("report", 0.0)
    report = study.publish(tables, sections(ReportInputs(setting, tables)))
    progress("report", 1.0)
    return report
