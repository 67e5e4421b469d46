"""A page of the server as one text with everything in it: styles, code, and what it shows."""

import base64
import gzip
import html
import re
from importlib.metadata import distribution

from palpate.server.access_control import STATIC, check_page

STYLE_LINK = re.compile(r'<link rel="stylesheet" href="static/([\w.-]+)" />')
MAIN_SCRIPT = re.compile(r'<script type="module" src="static/[\w.-]+"></script>\n?')
LICENCES, LICENCES_LINK = "LICENSES.txt", '<a href="static/LICENSES.txt">Licences</a>'


def embedded_page(
    name: str, title: str, policy: str, script: str, parts: dict[str, str], note: str, host: str = ""
) -> str:
    """The page of file `name` with its styles, the code of file `script`, and `parts` by id.

    note: of what is in the page, above the licences. host: what shows the page in a frame and exchanges values with it,
    "notebook" or nothing.
    """
    page = head(name, title, policy)
    if host:
        page = page.replace('<html lang="en">', f'<html lang="en" data-host="{host}">', 1)
    page = STYLE_LINK.sub(lambda link: f"<style>{static(link[1])}</style>", page)
    folded = f"<details><summary>Licences</summary><pre>{html.escape(licences(note))}</pre></details>"
    page = MAIN_SCRIPT.sub("", page).replace(LICENCES_LINK, folded)
    inert = [f'<script type="text/plain" id="{part}">{text}</script>' for part, text in parts.items()]
    return page.replace(
        "</body>", "\n".join([*inert, f'<script type="module">{inline(static(script))}</script>', "</body>"])
    )


def head(name: str, title: str, policy: str) -> str:
    """The page of file `name` with a title and a content security policy. Raises `FileError` if there is none."""
    check_page()
    page = static(name).replace("<title>palpate</title>", f"<title>{html.escape(title)} – palpate</title>")
    rule = f'<meta http-equiv="Content-Security-Policy" content="{policy}" />'
    return page.replace('<meta charset="utf-8" />', f'<meta charset="utf-8" />\n    {rule}', 1)


def static(name: str) -> str:
    """The text of a file of the pages."""
    return (STATIC / name).read_text(encoding="utf-8")


def packed(data: bytes, level: int = 9) -> str:
    """Bytes as base64 of gzip."""
    return base64.b64encode(gzip.compress(data, level, mtime=0)).decode()


def inline(code: str) -> str:
    """Code that no HTML parser ends early."""
    return re.sub(r"</(script)", r"<\\/\1", code, flags=re.IGNORECASE).replace("<!--", r"<\!--")


def licences(note: str) -> str:
    """Of all that is in a page, after a note."""
    text = distribution("palpate").read_text("licenses/LICENSE") or ""
    return "\n\n----\n\n".join([note, static(LICENCES), text])
