"""A page with everything in it: it works from a disk, offline, and asks nobody for anything."""

from collections.abc import Mapping
from pathlib import Path

from palpate.atomic_write import new_folder, replacing, replacing_folder, writable
from palpate.errors import DataError, FileError
from palpate.server.access_control import check_page
from palpate.server.exam import Exam
from palpate.simulation.forced_choice import CHANNELS
from palpate.simulation.lesson import Lesson
from palpate.simulation.training_task import Task, target_of
from palpate.standalone.embedded_page import LICENCES, embedded_page, head, inline, licences, packed, static
from palpate.standalone.organ_data import case_data, case_session, organ_data, session_of
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
    toughness: float | Mapping[int | str, float] | None = None,
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
    toughness : float or dict, optional
        Energy that a cut takes for each area, J/m², as `cutting_work` takes it. The default is that of the named tissues.
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
    path = _writable_page(Path(path), folder)
    asked, title = task or Task(), title or "organ"
    target_of(asked, tissue)
    check_page()
    return _write(path, folder, organ_data(session_of(tissue, radius, toughness), title, asked.text), title)


def export_case(lesson: Lesson, seed: int, path: str | Path, *, channel: str = "screen", folder: bool = False) -> Path:
    """Write a case of a lesson as one file that is taken as an exam in any browser, without a server.

    The page allows what the lesson does: tools, views, claims and time. It saves the session, which `lesson_result`
    judges. It draws nothing of what is inside, but the file holds it, since its engine answers the hand: who takes the file
    apart finds the lump. Where that matters, serve the case with `take_lesson`.

    Parameters
    ----------
    lesson : Lesson
        The lesson.
    seed : int
        Which case.
    path : str or Path
        File to write: .html; or the folder.
    channel : {"screen", "sound", "gamepad"}, optional
        How the force comes to the trainee.
    folder : bool, optional
        Whether to write separate files into a new folder, for a web host, instead.

    Returns
    -------
    Path
        The page that was written.

    Raises
    ------
    FileError
        If the organ cannot be read, the file cannot be written, or the page or the engine is missing.
    MaterialError
        If the engine does not follow the tissue.
    DataError
        If the channel is none, or the case cannot be drawn.

    Examples
    --------
    >>> plain = pp.tetrahedralize(labels, "organ", edge=6)
    >>> pp.write_tissue("organ.vtu", pp.Tissue(plain, 5, poisson=0.4, fixed=pp.resting_on(plain, (0, 0, -1))))
    >>> lesson = pp.Lesson("One lump", Path("organ.vtu"), "finding a lump with a pointer", "the feel of a glove")
    >>> pp.export_case(lesson, 7, "case-7.html").name
    'case-7.html'
    """
    if channel not in CHANNELS or channel == "device":
        others = ", ".join(name for name in CHANNELS if name != "device")
        raise DataError(f"channel: {channel!r} is none in a page by itself; choose one of {others}")
    path = _writable_page(Path(path), folder)
    check_page()
    exam = Exam(lesson, seed, channel)
    return _write(path, folder, case_data(case_session(exam), exam), lesson.title)


def _writable_page(path: Path, folder: bool) -> Path:
    """Where the page may be written. Raises `FileError`."""
    if folder:
        new_folder(path)
        return path
    if path.suffix not in (".html", ".htm"):
        raise FileError(f"{path}: a page ends in .html; name it organ.html, for example")
    return writable(path)


def _write(path: Path, folder: bool, data: bytes, title: str) -> Path:
    """Writes the page around its data, whole or not at all, and returns its name."""
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
