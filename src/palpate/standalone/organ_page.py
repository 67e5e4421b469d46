"""A page with everything in it: it works from a disk, offline, and asks nobody for anything."""

import base64
import gzip
import html
import re
from importlib.metadata import distribution
from pathlib import Path

from palpate.atomic_write import new_folder, replacing, replacing_folder, writable
from palpate.errors import FileError
from palpate.server.access_control import STATIC, check_page
from palpate.simulation.training_task import Task, target_of
from palpate.standalone.organ_data import organ_data, session_of
from palpate.tissue.tissue import Tissue

MODULE = Path(__file__).with_name("engine.wasm")
# Of one file: the worker's code and what the page unpacks get addresses of their own within it (blob:).
FILE_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; worker-src blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; base-uri 'none'; form-action 'none'"
)
FOLDER_POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data: blob:; base-uri 'none'; form-action 'none'"
)
STYLES, MAIN, WORKER, LICENCES = ("style.css", "touch.css"), "main.js", "worker.js", "LICENSES.txt"
STYLE_LINK = '<link rel="stylesheet" href="static/{}" />'
MAIN_SCRIPT = '<script type="module" src="static/main.js"></script>'
LICENCES_LINK = '<a href="static/LICENSES.txt">Licences</a>'


def export(
    tissue: Tissue,
    path: str | Path,
    *,
    title: str | None = None,
    radius: float | None = None,
    task: Task | None = None,
    folder: bool = False,
) -> Path:
    """Write an organ as one file that can be touched in any browser, without a server.

    The file holds the page, the engine as WebAssembly and the tissue. It holds no name of a patient, user, file or
    machine but the title.

    Parameters
    ----------
    tissue : Tissue
        The solid, of smoothed elements, without relaxation and inertia.
    path : str or Path
        File to write: .html; or the folder.
    title : str, optional
        What the page shows as the organ's name. The default is "organ".
    radius : float, optional
        Radius of the contact, mm. The default is two mean edges of the surface.
    task : Task, optional
        What the page asks of a trainee. The page saves the session for `palpate score`.
    folder : bool, optional
        Whether to write separate files into a new folder, for a web host, instead.

    Returns
    -------
    Path
        The page that was written.

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
    if folder:
        new_folder(path)
    elif path.suffix not in (".html", ".htm"):
        raise FileError(f"{path}: a page ends in .html; name it organ.html, for example")
    else:
        path = writable(path)
    asked, title = task or Task(), title or "organ"
    target_of(asked, tissue)
    check_page()
    data = organ_data(session_of(tissue, radius), title, asked.text)
    if not folder:
        with replacing(path) as temporary:
            temporary.write_text(one_file(data, title), encoding="utf-8")
        return path
    with replacing_folder(path) as made:
        for name, content in separate_files(data, title).items():
            (made / name).write_bytes(content)
    return path / "index.html"


def one_file(data: bytes, title: str) -> str:
    """A page with all in it, around the data of `organ_data`. Raises `FileError` if the engine is missing."""
    page = _page(title, FILE_POLICY)
    for name in STYLES:
        page = page.replace(STYLE_LINK.format(name), f"<style>{_static(name)}</style>")
    page = page.replace(
        LICENCES_LINK, f"<details><summary>Licences</summary><pre>{html.escape(licences())}</pre></details>"
    )
    parts = [
        _part("worker-code", _script(_static(WORKER))),
        _part("engine-module", _packed(_engine())),
        _part("organ-data", _packed(data)),
        f'<script type="module">{_script(_static(MAIN))}</script>',
    ]
    return page.replace(MAIN_SCRIPT, "").replace("</body>", "\n".join([*parts, "</body>"]))


def separate_files(data: bytes, title: str) -> dict[str, bytes]:
    """The same as files by name, index.html among them. Raises `FileError` if the engine is missing."""
    named = {"worker-code": WORKER, "engine-module": MODULE.name, "organ-data": "organ.bin"}
    parts = [f'<script type="text/plain" id="{part}" data-file="{name}"></script>' for part, name in named.items()]
    page = _page(title, FOLDER_POLICY).replace("static/", "").replace("</body>", "\n".join([*parts, "</body>"]))
    texts = {name: _static(name) for name in (*STYLES, MAIN, WORKER)} | {"index.html": page, LICENCES: licences()}
    return {name: text.encode() for name, text in texts.items()} | {"organ.bin": data, MODULE.name: _engine()}


def _page(title: str, policy: str) -> str:
    page = _static("index.html").replace("<title>palpate</title>", f"<title>{html.escape(title)} – palpate</title>")
    rule = f'<meta http-equiv="Content-Security-Policy" content="{policy}" />'
    return page.replace('<meta charset="utf-8" />', f'<meta charset="utf-8" />\n    {rule}', 1)


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


def licences() -> str:
    """Of all that is in the page."""
    own = "palpate, Apache-2.0. The engine holds parts of LLVM's libc++ (Apache-2.0 WITH LLVM-exception) and wasi-libc (MIT)."
    text = distribution("palpate").read_text("licenses/LICENSE") or ""
    return "\n\n----\n\n".join([own, _static(LICENCES), text])
