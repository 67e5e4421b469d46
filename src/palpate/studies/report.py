"""One HTML file that shows an experiment: text, tables and pictures, nothing fetched from elsewhere."""

import base64
import html
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from palpate.atomic import replacing
from palpate.version import __version__

_STYLE = """
:root { color-scheme: light dark; --ink: #1c2530; --soft: #5b6775; --line: #d9dfe6; --paper: #fbfcfd; --card: #fff;
  --accent: #0b6e99; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e9ef; --soft: #9aa7b4; --line: #313b46; --paper: #12171d;
  --card: #1a2129; --accent: #6fc3e8; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2rem 1.2rem 4rem; max-width: 62rem; background: var(--paper); color: var(--ink);
  font: 16px/1.55 system-ui, sans-serif; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .6rem; padding-top: 1rem; border-top: 1px solid var(--line); }
p { max-width: 46rem; margin: .5rem 0; }
.made { color: var(--soft); font-size: .9rem; }
code { font: .88em ui-monospace, monospace; background: var(--line); border-radius: 4px; padding: .1em .35em;
  overflow-wrap: anywhere; }
figure { margin: 1.2rem 0; background: #fff; border: 1px solid var(--line); border-radius: 10px;
  overflow: hidden; }
figure img { display: block; max-width: 100%; height: auto; margin: 0 auto; }
figcaption { padding: .6rem .9rem; background: var(--card); color: var(--soft); font-size: .9rem; }
.scroll { overflow-x: auto; }
@media (max-width: 40rem) { figure img { max-width: none; width: 40rem; } }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; font-size: .93rem; }
th, td { text-align: left; padding: .35rem .9rem .35rem 0; border-bottom: 1px solid var(--line); vertical-align: top; }
th { color: var(--soft); font-weight: 600; }
"""


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
    body = [
        f"<h1>{html.escape(title)}</h1>",
        f"<p class=made>palpate {__version__}. Made by <code>{html.escape(command)}</code>. "
        "Research software, not a medical device.</p>",
    ]
    for section in sections:
        body.append(f"<h2>{html.escape(section.title)}</h2>")
        body += [f"<p>{html.escape(paragraph)}</p>" for paragraph in section.text]
        if section.table:
            body.append(_table(section.table))
        body += [_figure(figure, caption) for figure, caption in section.pictures]
    page = (
        "<!doctype html><html lang=en><head><meta charset=utf-8>"
        "<meta name=viewport content='width=device-width, initial-scale=1'>"
        f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>"
        + "\n".join(body)
        + "</body></html>\n"
    )
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _table(rows: Sequence[Sequence[object]]) -> str:
    def line(cells: Sequence[object], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

    return f"<div class=scroll><table>{line(rows[0], 'th')}{''.join(line(row, 'td') for row in rows[1:])}</table></div>"


def png_of(figure: Figure | bytes) -> bytes:
    """As the report shows it."""
    if isinstance(figure, bytes):
        return figure
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=110, bbox_inches="tight")
    return png.getvalue()


def _figure(figure: Figure | bytes, caption: str) -> str:
    data = base64.b64encode(png_of(figure)).decode()
    return (
        f"<figure><div class=scroll><img alt='{html.escape(caption, quote=True)}' src='data:image/png;base64,{data}'></div>"
        f"<figcaption>{html.escape(caption)}</figcaption></figure>"
    )
