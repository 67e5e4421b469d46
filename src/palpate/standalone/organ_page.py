"""A page with everything in it: it works from a disk, offline, and asks nobody for anything."""

from pathlib import Path

from palpate.atomic_write import new_folder, replacing, replacing_folder, writable
from palpate.errors import FileError
from palpate.server.access_control import check_page
from palpate.simulation.training_task import Task, target_of
from palpate.standalone.embedded_page import LICENCES, embedded_page, head, inline, licences, packed, static
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
STYLES, MAIN, WORKER = ("style.css", "touch.css"), "main.js", "worker.js"
NOTE = (
    "palpate, Apache-2.0. The engine holds parts of LLVM's libc++ (Apache-2.0 WITH LLVM-exception) and wasi-libc (MIT)."
)


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


def one_file(data: bytes, title: str, host: str = "") -> str:
    """A page with all in it, around the data of `organ_data`. host: as in `embedded_page`. Raises `FileError`."""
    parts = {
        "worker-code": inline(static(WORKER)),
        "engine-module": packed(engine_module()),
        "organ-data": packed(data),
    }
    return embedded_page("index.html", title, FILE_POLICY, MAIN, parts, NOTE, host)


def separate_files(data: bytes, title: str) -> dict[str, bytes]:
    """The same as files by name, index.html among them. Raises `FileError` if the engine is missing."""
    named = {"worker-code": WORKER, "engine-module": MODULE.name, "organ-data": "organ.bin"}
    parts = [f'<script type="text/plain" id="{part}" data-file="{name}"></script>' for part, name in named.items()]
    page = head("index.html", title, FOLDER_POLICY)
    page = page.replace("static/", "").replace("</body>", "\n".join([*parts, "</body>"]))
    texts = {name: static(name) for name in (*STYLES, MAIN, WORKER)} | {"index.html": page, LICENCES: licences(NOTE)}
    return {name: text.encode() for name, text in texts.items()} | {"organ.bin": data, MODULE.name: engine_module()}


def engine_module() -> bytes:
    """The engine as WebAssembly. Raises `FileError` if it is missing."""
    if not MODULE.is_file():
        raise FileError(f"{MODULE}: the engine is missing; install the wheel, or build it with: make wasm")
    return MODULE.read_bytes()
