"""The whole study: one folder with runs, tables, figures, and one report."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from palpate.studies.publish import publish
from palpate.studies.realtime import browser, loops
from palpate.studies.realtime.page import sections
from palpate.studies.realtime.setting import FULL, QUICK
from palpate.studies.records import read_json, same_study, write_json
from palpate.studies.stages import begun
from palpate.studies.tables import Row, write_tables

TITLE = "The simulator in real time, measured"


def realtime_study(
    folder: str | Path,
    *,
    quick: bool = False,
    resume: bool = False,
    docs: str | Path | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Path:
    """The real-time tables of Chen's dissertation (Delaware, 2006), chapter 3: gives the path of report.html.

    A kidney at several resolutions: time of a deformation by every model, rate of the loop and late ticks beside the
    machine's own jitter, steps of the force while sliding, memory, frame rate by drawing mode, delay from hand to
    picture. Wall time: run it on an otherwise idle machine. folder: made if need be; gets report.html, tables/*.csv,
    figures/*.png, runs/*.json. quick: small, for tests. resume: go on from what is there. docs: a folder that gets the
    page realtime.md with its pictures. Raises `FileError` when a folder cannot be written, or holds another study.
    """
    setting = QUICK if quick else FULL
    stages = begun(folder, resume, docs)
    for name in ("runs", "figures", "tables"):
        (stages.folder / name).mkdir(exist_ok=True)
    same_study(stages, f"{setting.name}, models {' '.join(setting.models)}")
    parts = [(f"{what}-{k[0]}", partial(work, setting, *k)) for k in setting.kidneys for what, work in WORKS]
    tables: dict[str, list[Row]] = {}
    for done, (name, make) in enumerate(parts):
        progress(f"{done + 1} of {len(parts)}: {name}", done / len(parts))
        for table, rows in stages(f"runs/{name}.json", make, write_json, read_json).items():
            tables.setdefault(table, []).extend(rows)
    write_tables(stages.folder / "tables", {name: rows for name, rows in tables.items() if rows})
    command = f"palpate study {setting.name}"
    report = publish(stages.folder, "realtime", TITLE, command, sections(tables, setting, command), docs)
    progress("report", 1.0)
    return report


WORKS: tuple[tuple[str, Callable[..., dict[str, list[Row]]]], ...] = (("loop", loops.measured), ("page", browser.pages))
