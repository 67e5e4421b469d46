"""One HTML file that shows an experiment: text, tables and pictures, nothing fetched from elsewhere."""

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from palpate.atomic_write import replacing
from palpate.version import __version__


@dataclass(frozen=True)
class Section:
    """A heading, paragraphs, a table whose first row is its head, and pictures (figures or PNG) with their captions."""

    title: str
    text: Sequence[str] = ()
    table: Sequence[Sequence[object]] = ()
    pictures: Sequence[tuple[Figure | bytes, str]] = ()


def write_report(path: str | Path, title: str, command: str, sections: Sequence[Section]) -> None:
    """Writes the sections as one HTML file. `command` is what the reader types to make it again.

    Raises `FileError` when the file cannot be written.
    """
    pages = templates()
    pages.filters["base64"] = lambda png: base64.b64encode(png).decode()
    drawn = [with_png(section) for section in sections]
    page = pages.get_template("report.html").render(title=title, command=command, sections=drawn, version=__version__)
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def templates() -> Environment:
    """The templates of reports; a name that a template misses is an error, and only HTML is escaped."""
    return Environment(
        loader=PackageLoader("palpate.report"),
        autoescape=lambda name: name is not None and name.endswith(".html"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


def with_png(section: Section) -> Section:
    """The section with each of its figures drawn."""
    return replace(section, pictures=[(png_of(figure), caption) for figure, caption in section.pictures])


def png_of(figure: Figure | bytes) -> bytes:
    """The PNG of a figure, as the report shows it."""
    if isinstance(figure, bytes):
        return figure
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=110, bbox_inches="tight")
    return png.getvalue()
