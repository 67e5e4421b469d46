"""The whole study: one folder with runs, tables, figures, and one report."""

from collections.abc import Callable
from pathlib import Path

from palpate.studies.publish import publish
from palpate.studies.stages import begun
from palpate.studies.tables import write_tables
from palpate.studies.tomosynthesis.conclusions import factors
from palpate.studies.tomosynthesis.page import Page
from palpate.studies.tomosynthesis.runs import run_all
from palpate.studies.tomosynthesis.setting import FULL, QUICK
from palpate.studies.tomosynthesis.tables import make_tables

TITLE = "Multi-resolution MAP tomosynthesis, measured"


def tomosynthesis_study(
    folder: str | Path,
    *,
    quick: bool = False,
    resume: bool = False,
    docs: str | Path | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Path:
    """Every experiment of Chen's dissertation (Delaware, 2006), chapter 2, and beyond: gives the path of report.html.

    folder: made if need be; gets report.html, tables/*.csv, figures/*.png, volumes/*.nii.gz, runs/*.json. quick: a small
    grid and two seeds, for tests. resume: go on from the runs that are there. docs: a folder that gets the page
    tomosynthesis.md with its pictures. progress(what, share): told how far it is. Raises `FileError` when a folder
    cannot be written, or holds another study.
    """
    setting = QUICK if quick else FULL
    stages = begun(folder, resume, docs)
    records, judge = run_all(stages, setting, progress)
    tables, found = make_tables(records, setting), factors(records, setting)
    tables["factors"] = [f.row for f in found]
    write_tables(stages.folder / "tables", tables)
    command = "palpate study tomosynthesis" + (" --quick" if quick else "")
    progress("report", 0.0)
    sections = Page(stages.folder, command, judge, records, tables, found).sections()
    report = publish(stages.folder, "tomosynthesis", TITLE, command, sections, docs)
    progress("report", 1.0)
    return report
