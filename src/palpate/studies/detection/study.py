"""The detection study: one folder with runs, tables, figures, and one report."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from palpate.arrays import Float32
from palpate.cluster.connection import check_on
from palpate.cluster.file_tasks import FileTask
from palpate.errors import DataError
from palpate.report.stages import Progress, Stages, silent
from palpate.studies.detection.acquisition import scatter_of
from palpate.studies.detection.config import FULL, QUICK, Kind, Setting
from palpate.studies.detection.judgement import Judgement
from palpate.studies.detection.report_sections import TITLE, sections, shown_images, shown_kind
from palpate.studies.detection.run import Record, scan_breast
from palpate.studies.run_store import write_arrays
from palpate.studies.spread import spread
from palpate.studies.study import Study

FEWEST, MOST = 2, 1000


def detection_study(
    folder: str | Path,
    *,
    quick: bool = False,
    seeds: int | None = None,
    resume: bool = False,
    docs: str | Path | None = None,
    progress: Progress = silent,
    on: int | str | None = None,
) -> Path:
    """Ask model observers which masses and calcifications they find in each method's images of random breasts.

    Breasts of three kinds are scanned with a polychromatic beam, scatter and quantum noise, at three doses, once with
    signals and once without, under the same noise. MAP, SART, SIRT, filtered backprojection and total variation
    reconstruct them, and the Reconstruction Toolkit where it is installed, each rival in several settings. A
    channelised Hotelling observer, taught on other breasts, rates every place.

    Parameters
    ----------
    folder : str or Path
        Receives report.html, and the folders tables, figures and runs.
    quick : bool, optional
        Use small breasts of one kind, for tests.
    seeds : int, optional
        Breasts of each kind, instead of 7 (of 3 with `quick`).
    resume : bool, optional
        Go on from the breasts that are there.
    docs : str or Path, optional
        A folder that receives the page detection.md and its pictures.
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
        If there are too few seeds for an observer to learn on other breasts.
    FileError
        If a folder cannot be written, or holds another study.
    ClusterError
        If no scheduler answers, or workers die again and again.

    References
    ----------
    Barrett, Yao, Rolland & Myers, PNAS 90:9758, 1993. Burgess, Jacobson & Judy, Med. Phys. 28:419, 2001.

    Examples
    --------
    >>> pp.detection_study("detection", quick=True)  # doctest: +SKIP
    """
    setting, option = (QUICK if quick else FULL), ""
    if seeds is not None:
        if not FEWEST <= seeds <= MOST:
            raise DataError(f"seeds: expected {FEWEST} to {MOST} breasts of each kind, got {seeds}")
        setting, option = replace(setting, seeds=seeds), f" --seeds {seeds}"
    if on is not None:
        check_on(on)
    study = Study("detection", TITLE, Stages(Path(folder), resume, progress), quick, docs, option=option)
    stages = study.stages
    if on is not None:
        stages = spread(stages, scatter_tasks(stages.folder, setting), on)
    scatter = {kind.name: _scatter(stages, kind, k, setting) for k, kind in enumerate(setting.kinds)}
    if on is not None:
        stages = spread(study.stages, breast_tasks(stages.folder, setting), on)
    records = run_all(stages, setting, scatter, progress)
    make = partial(shown_images, setting, scatter[shown_kind(setting).name])
    images = study.stages("shown.npz", make, write_arrays, _read)
    progress("report", 0.0)
    judgement = Judgement(records, setting)
    tables = {"measures": judgement.rows, "claims": [vars(claim) | {"met": claim.met} for claim in judgement.claims]}
    report = study.publish(tables, sections(judgement, images))
    progress("report", 1.0)
    return report


def run_all(
    stages: Stages, setting: Setting, scatter: Mapping[str, Float32], progress: Progress
) -> dict[tuple[str, int], Record]:
    """The record of every breast, each its own file, so that an interrupted study goes on."""
    found = {}
    for kind in setting.kinds:
        for seed in range(setting.seeds):
            tell = partial(progress, f"{kind.name} breast {seed + 1} of {setting.seeds}")
            make = partial(scan_breast, kind, seed, setting, scatter[kind.name], tell)
            found[kind.name, seed] = stages(_breast_file(kind, seed), make, write_arrays, _read)
    return found


def scatter_tasks(folder: Path, setting: Setting) -> list[FileTask]:
    """The scatter of each kind of breast."""
    return [
        FileTask(folder / _scatter_file(kind), partial(_write_scatter, kind, k, setting))
        for k, kind in enumerate(setting.kinds)
    ]


def breast_tasks(folder: Path, setting: Setting) -> list[FileTask]:
    """Every breast, after its scatter."""
    return [
        FileTask(folder / _breast_file(kind, seed), partial(_write_breast, kind, seed, setting))
        for kind in setting.kinds
        for seed in range(setting.seeds)
    ]


def _write_scatter(kind: Kind, number: int, setting: Setting, path: Path) -> None:
    write_arrays(path, _scatter_arrays(kind, number, setting))


def _write_breast(kind: Kind, seed: int, setting: Setting, path: Path) -> None:
    scatter = np.asarray(_read(path.parents[1] / _scatter_file(kind))["scatter"], np.float32)
    write_arrays(path, scan_breast(kind, seed, setting, scatter, lambda share: None))


def _scatter_file(kind: Kind) -> str:
    return f"runs/scatter-{kind.name}.npz"


def _breast_file(kind: Kind, seed: int) -> str:
    return f"runs/{kind.name}-{seed}.npz"


def _scatter(stages: Stages, kind: Kind, number: int, setting: Setting) -> Float32:
    make = partial(_scatter_arrays, kind, number, setting)
    return np.asarray(stages(_scatter_file(kind), make, write_arrays, _read)["scatter"], np.float32)


def _scatter_arrays(kind: Kind, number: int, setting: Setting) -> Mapping[str, Float32]:
    return {"scatter": scatter_of(kind, setting, 1000 * number)}


def _read(path: Path) -> Record:
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}
