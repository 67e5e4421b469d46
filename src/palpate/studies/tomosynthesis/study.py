"""The whole study: one folder with runs, tables, figures, and one report."""

import io
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from PIL import Image

from palpate.atomic import output_folder, replacing
from palpate.studies.report import Section, png_of, write_report
from palpate.studies.stages import Stages
from palpate.studies.tomosynthesis.conclusions import factors
from palpate.studies.tomosynthesis.page import Page
from palpate.studies.tomosynthesis.runs import run_all
from palpate.studies.tomosynthesis.setting import FULL, QUICK
from palpate.studies.tomosynthesis.tables import make_tables, write_tables

TITLE = "Multi-resolution MAP tomosynthesis, measured"
DOCS_WIDTH, DOCS_COLOURS = 800, 40  # keep the pictures of the docs small


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
    stages = Stages(Path(folder), resume)
    pictured = output_folder(Path(docs) / "images" / "tomosynthesis") if docs is not None else None
    records, judge = run_all(stages, setting, progress)
    tables, found = make_tables(records, setting), factors(records, setting)
    tables["factors"] = [f.row for f in found]
    write_tables(stages.folder / "tables", tables)
    command = "palpate study tomosynthesis" + (" --quick" if quick else "")
    progress("report", 0.0)
    sections = [_drawn(s) for s in Page(stages.folder, command, judge, records, tables, found).sections()]
    pictures = {_name(s, i): png_of(picture) for s in sections for i, (picture, _) in enumerate(s.pictures)}
    for name, png in pictures.items():
        with replacing(stages.folder / "figures" / name) as temporary:
            temporary.write_bytes(png)
    report = stages.folder / "report.html"
    write_report(report, TITLE, command, sections)
    if docs is not None and pictured is not None:
        for name, png in pictures.items():
            _write_small(pictured / name, png)
        _write_page(Path(docs) / "tomosynthesis.md", command, sections)
    progress("report", 1.0)
    return report


def _drawn(section: Section) -> Section:
    """With each figure drawn once, for all that show it."""
    return replace(section, pictures=[(png_of(figure), caption) for figure, caption in section.pictures])


def _name(section: Section, i: int) -> str:
    return f"{re.sub('[^a-z]+', '-', section.title.lower())}-{i + 1}.png"


def _write_small(path: Path, png: bytes) -> None:
    """Few pixels and few colours, for a repository."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    picture.thumbnail((DOCS_WIDTH, 10 * DOCS_WIDTH), Image.Resampling.LANCZOS)
    with replacing(path) as temporary:
        picture.quantize(DOCS_COLOURS).save(temporary, format="PNG", optimize=True)


def _write_page(path: Path, command: str, sections: Sequence[Section]) -> None:
    """The report as Markdown with links to its pictures."""
    lines = [f"# {TITLE}", "", f"Made by `{command} --docs docs`; the report itself has the same content.", ""]
    for section in sections:
        lines += [f"## {section.title}", ""]
        listed = section.title == "Conclusions"
        lines += [
            line for text in section.text for line in (f"- {text}" if listed else text, *([] if listed else [""]))
        ]
        if listed:
            lines.append("")
        if section.table:
            head, *body = section.table
            lines += [_cells(head), "|" + "---|" * len(head), *map(_cells, body), ""]
        for i, (_, caption) in enumerate(section.pictures):
            words = caption.replace(command, f"`{command}`")
            lines += [f"![{caption}](images/tomosynthesis/{_name(section, i)})", "", f"*{words}*", ""]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines), encoding="utf-8")


def _cells(row: Sequence[object]) -> str:
    return "| " + " | ".join(str(cell).replace("|", "/") for cell in row) + " |"
