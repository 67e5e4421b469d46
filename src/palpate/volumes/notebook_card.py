"""A small picture beside the figures that matter, as HTML for a notebook, in light and dark."""

import base64
import html
from collections.abc import Sequence

# The text keeps the notebook's own colors, and the picture has no ground.
CARD = "display:flex;flex-wrap:wrap;gap:8px 20px;align-items:center"


def notebook_card(title: str, rows: Sequence[tuple[str, str]], png: bytes | None = None) -> str:
    """A heading above rows of a name and a value, and a picture."""
    image = ""
    if png is not None:
        data = base64.b64encode(png).decode()
        image = (
            f"<img alt='{html.escape(title)}' style='max-width:100%;height:170px' src='data:image/png;base64,{data}'>"
        )
    lines = "".join(
        f"<tr><th style='text-align:left;font-weight:normal;opacity:.75;padding:1px 14px 1px 0'>{html.escape(name)}</th>"
        f"<td style='text-align:left;padding:1px 0'>{html.escape(value)}</td></tr>"
        for name, value in rows
    )
    return (
        f"<div style='{CARD}'>{image}<div><b>{html.escape(title)}</b>"
        f"<table style='margin:4px 0 0'><tbody>{lines}</tbody></table></div></div>"
    )
