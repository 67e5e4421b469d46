"""A study's sections as one HTML report, as pictures, and as a page of the documentation."""

import io
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from PIL import Image

from palpate.atomic import output_folder, replacing
from palpate.studies.report import Section, png_of, write_report

DOCS_WIDTH, DOCS_COLOURS = 800, 40  # keep the pictures of the docs small


def publish(
    folder: Path, name: str, title: str, command: str, sections: Sequence[Section], docs: str | Path | None
) -> Path:
    """Writes report.html and figures/*.png below `folder`, and NAME.md with images/NAME/*.png below `docs`.

    Gives the path of the report. command: what makes it. Raises `FileError`.
    """
    sections = [_drawn(section) for section in sections]
    pictures = {_name(s, i): png_of(picture) for s in sections for i, (picture, _) in enumerate(s.pictures)}
    for file, png in pictures.items():
        with replacing(folder / "figures" / file) as temporary:
            temporary.write_bytes(png)
    report = folder / "report.html"
    write_report(report, title, command, sections)
    if docs is not None:
        pictured = output_folder(Path(docs) / "images" / name)
        for file, png in pictures.items():
            _write_small(pictured / file, png)
        _write_page(Path(docs) / f"{name}.md", title, command, sections)
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


def _write_page(path: Path, title: str, command: str, sections: Sequence[Section]) -> None:
    """The report as Markdown with links to its pictures."""
    lines = [f"# {title}", "", f"Made by `{command} --docs docs`; the report itself has the same content.", ""]
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
            lines += [f"![{caption}](images/{path.stem}/{_name(section, i)})", "", f"*{words}*", ""]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines), encoding="utf-8")


def _cells(row: Sequence[object]) -> str:
    return "| " + " | ".join(str(cell).replace("|", "/") for cell in row) + " |"
