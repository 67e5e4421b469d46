"""A page with everything in it: it works from a disk, offline, and asks nobody for anything."""

import base64
import gzip
import html
import re
from importlib.metadata import distribution
from pathlib import Path

from palpate.atomic_write import replacing, writable
from palpate.errors import FileError
from palpate.server.access_control import STATIC, check_page
from palpate.simulation.training_task import Task, target_of
from palpate.standalone.organ_data import organ_data, session_of
from palpate.tissue.tissue import Tissue

MODULE = Path(__file__).with_name("engine.wasm")
# All is in the page; the worker's code and what the page unpacks get addresses of their own within it (blob:).
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; worker-src blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; base-uri 'none'; form-action 'none'"
)


def export(
    tissue: Tissue,
    path: str | Path,
    *,
    title: str | None = None,
    radius: float | None = None,
    task: Task | None = None,
) -> Path:
    """Write an organ as one file that can be touched in any browser, without a server.

    The file holds the page, the engine as WebAssembly and the tissue. It holds no name of a patient, user, file or
    machine but the title.

    Parameters
    ----------
    tissue : Tissue
        The solid, of smoothed elements, without relaxation and inertia.
    path : str or Path
        File to write: .html.
    title : str, optional
        What the page shows as the organ's name. The default is "organ".
    radius : float, optional
        Radius of the contact, mm. The default is two mean edges of the surface.
    task : Task, optional
        What the page asks of a trainee. The page saves the session for `palpate score`.

    Returns
    -------
    Path
        The file that was written.

    Raises
    ------
    FileError
        If the file cannot be written, or the page or the engine is missing.
    MaterialError
        If the engine does not follow the tissue.
    DataError
        If the radius is not valid, or the tissue has no target for the task.

    Examples
    --------
    >>> pp.export(tissue, "organ.html", title="Kidney").name
    'organ.html'
    """
    path = Path(path)
    if path.suffix not in (".html", ".htm"):
        raise FileError(f"{path}: a page ends in .html; name it organ.html, for example")
    path = writable(path)
    asked = task or Task()
    target_of(asked, tissue)
    title = title or "organ"
    page = organ_page(organ_data(session_of(tissue, radius), title, asked.text), title)
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path


def organ_page(data: bytes, title: str) -> str:
    """The page around the data of `organ_data`. Raises `FileError` if the page or the engine is missing."""
    check_page()
    page = _static("index.html")
    page = page.replace("<title>palpate</title>", f"<title>{html.escape(title)} – palpate</title>")
    page = page.replace('<meta charset="utf-8" />', f'<meta charset="utf-8" />\n{_policy()}', 1)
    page = re.sub(r'<link rel="stylesheet" href="static/(.*?)" />', lambda m: f"<style>{_static(m[1])}</style>", page)
    page = page.replace('<a href="static/LICENSES.txt">Licences</a>', _licences())
    parts = [
        _part("worker-code", _script(_static("worker.js"))),
        _part("engine-module", _packed(_engine())),
        _part("organ-data", _packed(data)),
        f'<script type="module">{_script(_static("main.js"))}</script>',
    ]
    page = page.replace('<script type="module" src="static/main.js"></script>\n', "")
    return page.replace("</body>", "\n".join([*parts, "</body>"]))


def _policy() -> str:
    return f'    <meta http-equiv="Content-Security-Policy" content="{POLICY}" />'


def _static(name: str) -> str:
    return (STATIC / name).read_text(encoding="utf-8")


def _engine() -> bytes:
    if not MODULE.is_file():
        raise FileError(f"{MODULE}: the engine is missing; install the wheel, or build it with: make wasm")
    return MODULE.read_bytes()


def _packed(data: bytes) -> str:
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode()


def _part(name: str, text: str) -> str:
    """An element that the browser keeps and does not run."""
    return f'<script type="text/plain" id="{name}">{text}</script>'


def _script(code: str) -> str:
    """Code that no HTML parser ends early."""
    return re.sub(r"</(script)", r"<\\/\1", code, flags=re.IGNORECASE).replace("<!--", r"<\!--")


def _licences() -> str:
    own = "palpate, Apache-2.0. The engine holds parts of LLVM's libc++ (Apache-2.0 WITH LLVM-exception) and wasi-libc (MIT)."
    text = "\n\n----\n\n".join([own, _static("LICENSES.txt"), license_text()])
    return f"<details><summary>Licences</summary><pre>{html.escape(text)}</pre></details>"


def license_text() -> str:
    """The text of palpate's own licence, which the package carries."""
    return distribution("palpate").read_text("licenses/LICENSE") or ""
