"""A study's sections as one HTML report, as pictures, and as a page of the documentation."""

import io
import re
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from palpate.atomic_write import output_folder, replacing
from palpate.report.html_report import Section, png_of, templates, with_png, write_report
from palpate.report.wrap_markdown import wrap_markdown

DOCS_WIDTH = 800  # pixels; of all colours, or curves would share one


def publish(
    folder: Path, name: str, title: str, command: str, sections: Sequence[Section], docs: str | Path | None
) -> Path:
    """Writes report.html and figures/*.png below `folder`, and NAME.md with images/NAME/*.png below `docs`.

    Gives the path of the report. command: what makes it. Raises `FileError`.
    """
    sections = [with_png(section) for section in sections]
    pictures = {_name(s, i): png_of(picture) for s in sections for i, (picture, _) in enumerate(s.pictures, 1)}
    for file, png in pictures.items():
        with replacing(folder / "figures" / file) as temporary:
            temporary.write_bytes(png)
    report = folder / "report.html"
    write_report(report, title, command, sections)
    if docs is not None:
        pictures_folder = output_folder(Path(docs) / "images" / name)
        for file, png in pictures.items():
            _write_small(pictures_folder / file, png)
        _write_page(Path(docs) / f"{name}.md", title, command, sections)
    return report


def _name(section: Section, number: int) -> str:
    """File name of the picture of that number, from 1, in a section."""
    return f"{re.sub('[^a-z]+', '-', section.title.lower())}-{number}.png"


def _write_small(path: Path, png: bytes) -> None:
    """Few pixels, for a repository."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    picture.thumbnail((DOCS_WIDTH, 10 * DOCS_WIDTH), Image.Resampling.LANCZOS)
    gray = picture.convert("L")
    if gray.convert("RGB").tobytes() == picture.tobytes():
        picture = gray
    with replacing(path) as temporary:
        picture.save(temporary, format="PNG", optimize=True)


def _write_page(path: Path, title: str, command: str, sections: Sequence[Section]) -> None:
    """The report as Markdown with links to its pictures, its paragraphs wrapped."""
    pages = templates()
    pages.filters |= {"cells": _cells, "picture_name": _name}
    page = pages.get_template("page.md").render(title=title, command=command, sections=sections, name=path.stem)
    with replacing(path) as temporary:
        temporary.write_text(wrap_markdown(page).rstrip("\n") + "\n", encoding="utf-8")


def _cells(row: Sequence[object]) -> str:
    return "| " + " | ".join(str(cell).replace("|", "/") for cell in row) + " |"
