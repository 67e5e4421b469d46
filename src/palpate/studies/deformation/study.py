"""The whole study: one folder with runs, tables, figures, and one report."""

from collections.abc import Callable
from pathlib import Path

from palpate.studies.deformation.page import sections
from palpate.studies.deformation.runs import run_all
from palpate.studies.deformation.setting import FULL, QUICK
from palpate.studies.deformation.told import Told
from palpate.studies.publish import publish
from palpate.studies.stages import begun
from palpate.studies.tables import write_tables

TITLE = "Springs, finite elements and the ladder between, measured"


def deformation_study(
    folder: str | Path,
    *,
    quick: bool = False,
    resume: bool = False,
    docs: str | Path | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Path:
    """Every experiment of Chen's dissertation (Delaware, 2006), chapter 3, and beyond: gives the path of report.html.

    folder: made if need be; gets report.html, tables/*.csv, figures/*.png, runs/*.json. quick: small meshes, for tests.
    resume: go on from the experiments that are there. docs: a folder that gets the page deformation.md with its
    pictures. progress(what, share): told how far it is. Raises `FileError` when a folder cannot be written, or holds
    another study.
    """
    setting = QUICK if quick else FULL
    stages = begun(folder, resume, docs)
    tables = run_all(stages, setting, progress)
    write_tables(stages.folder / "tables", {name: rows for name, rows in tables.items() if rows})
    progress("report", 0.0)
    command = f"palpate study {setting.name}"
    report = publish(stages.folder, "deformation", TITLE, command, sections(Told(command, setting, tables)), docs)
    progress("report", 1.0)
    return report
