"""The doubt study: one folder with runs, tables, figures, and one report."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from palpate.cluster.connection import check_on
from palpate.errors import DataError
from palpate.report.stages import Progress, Stages, silent
from palpate.studies.doubt.config import FULL, QUICK
from palpate.studies.doubt.judgement import Judgement
from palpate.studies.doubt.report_sections import TITLE, sections
from palpate.studies.doubt.run import all_breasts, breast_tasks, read_arrays
from palpate.studies.doubt.shown_breast import shown_breast
from palpate.studies.run_store import write_arrays
from palpate.studies.spread import spread
from palpate.studies.study import Study

FEWEST, MOST = 2, 10_000


def doubt_study(
    folder: str | Path,
    *,
    quick: bool = False,
    seeds: int | None = None,
    resume: bool = False,
    docs: str | Path | None = None,
    progress: Progress = silent,
    on: int | str | None = None,
) -> Path:
    """Ask how often intervals of a lump hold the truth, and whether probabilities that a hand feels it are calibrated.

    Random breasts with one stiff lump are scanned. Samples of the posterior give intervals of the lump's diameter, of its
    depth and of the force that it adds to a push, and the probability that it is felt. Breasts whose truth is known teach
    corrections; others judge. The true force is that of finite elements on a mesh of the true labels.

    Parameters
    ----------
    folder : str or Path
        Receives report.html, and the folders tables, figures and runs.
    quick : bool, optional
        Use few breasts on coarse grids, for tests.
    seeds : int, optional
        Breasts that judge, instead of 200 (of 2 with `quick`). As many teach as before, 100 (3).
    resume : bool, optional
        Go on from the breasts that are there.
    docs : str or Path, optional
        A folder that receives the page doubt.md and its pictures.
    progress : callable, optional
        Called with what is done and the share done.
    on : int or str, optional
        Make the breasts on so many workers here, or on those of a scheduler, as `run_archive` takes it. Each has
        the same bits as without.

    Returns
    -------
    Path
        The report.

    Raises
    ------
    DataError
        If there are too few breasts to judge.
    FileError
        If a folder cannot be written, or holds another study.
    ClusterError
        If no scheduler answers, or workers die again and again.

    References
    ----------
    Brier, Mon. Weather Rev. 78:1, 1950. Spiegelhalter, Stat. Med. 5:421, 1986.

    Examples
    --------
    >>> pp.doubt_study("doubt", quick=True)  # doctest: +SKIP
    """
    setting, option = (QUICK if quick else FULL), ""
    if seeds is not None:
        if not FEWEST <= seeds <= MOST:
            raise DataError(f"seeds: expected {FEWEST} to {MOST} breasts that judge, got {seeds}")
        setting, option = replace(setting, judge=seeds), f" --seeds {seeds}"
    if on is not None:
        check_on(on)
    study = Study("doubt", TITLE, Stages(Path(folder), resume, progress), quick, docs, option=option)
    stages = study.stages
    if on is not None:
        stages = spread(stages, breast_tasks(stages.folder, setting), on)
    records = all_breasts(stages, setting, progress)
    shown = study.stages("shown.npz", partial(shown_breast, setting), write_arrays, read_arrays)
    progress("report", 0.0)
    judgement = Judgement(records[: setting.train], records[setting.train :])
    tables = {
        "intervals": judgement.rows,
        "felt": judgement.felt_rows,
        "claims": [vars(claim) for claim in judgement.claims],
    }
    report = study.publish(tables, sections(judgement, setting, shown))
    progress("report", 1.0)
    return report
