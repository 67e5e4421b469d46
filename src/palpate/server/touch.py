"""Opens the simulator: a session, a server on the loopback interface, a page."""

import contextlib
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from palpate.atomic_write import writable
from palpate.errors import DataError, PalpateError
from palpate.haptics.discovery import open_device
from palpate.server.access_control import check_page
from palpate.server.access_token import access_token
from palpate.server.live_session import LiveSession, record_name
from palpate.server.loopback_server import announce, loopback_socket, running, show, shutdown_requests
from palpate.server.touch_routes import MESSAGE_BYTES, application
from palpate.server.view import image_payloads
from palpate.simulation.pointer import Pointer
from palpate.simulation.recorded_session import session_like
from palpate.simulation.recording import Record, write_record
from palpate.simulation.replay import Replay
from palpate.simulation.session import RATE, Session
from palpate.simulation.starting_model import starting_model
from palpate.tissue.io import write_tissue
from palpate.tissue.models.registry import model as build
from palpate.tissue.tissue import Tissue
from palpate.volumes.volume import Volume

MOST_IMAGES = 2


def touch(
    tissue: Tissue | Mapping[str, Tissue],
    model: str | None = None,
    *,
    radius: float | None = None,
    port: int | None = None,
    open_browser: bool = True,
    record: str | Path | None = None,
    replay: Record | None = None,
    title: str = "organ",
    images: Sequence[Volume] = (),
    task: str = "",
    device: str | None = None,
    tension: float = 0.0,
    save: str | Path | None = None,
) -> None:
    """Open the simulator in a browser and wait for Ctrl-C.

    Parameters
    ----------
    tissue : Tissue or mapping of str to Tissue
        One tissue, or several resolutions of one organ by name. The first one is opened; the page can choose.
    model : str, optional
        A name that `pp.model` knows. The default is the most exact model that keeps 1000 ticks a second on this machine.
        If that takes long to make, a less exact one serves until it is made.
    radius : float, optional
        Radius of the contact, mm. The default is two edge lengths.
    port : int, optional
        Port on loopback. The default is the first free one from 8765 on.
    open_browser : bool, optional
        Whether to open the browser.
    record : str or Path, optional
        File for the session, written at the end. Other resolutions go to files with -2, -3, … in the name. Until then
        a journal grows beside it (`session.h5.journal`); `read_record` reads a session from there that was cut short.
    replay : Record, optional
        A recorded session to show. Model and radius are then the record's.
    title : str, optional
        Title of the page.
    images : sequence of Volume, optional
        Up to two volumes whose slices are shown.
    task : str, optional
        What a trainee is asked to do.
    device : str, optional
        "open-haptics", "force-dimension" or "haply"; it then moves the tool, and the page only shows it.
    tension : float, optional
        Of the tissue at rest, kPa: cuts gape by it in the picture.
    save : str or Path, optional
        File (.vtu) for the tissue with its cuts, written at the end.

    Raises
    ------
    DataError
        If there are too many images.
    DeviceError
        If the device does not answer.
    PortError
        If the port is taken.
    FileError
        If `record` or `save` cannot be written. All of these are raised before anything starts.

    Examples
    --------
    >>> pp.touch(tissue, record="session.h5")  # doctest: +SKIP
    >>> try:
    ...     pp.touch(tissue, images=[volume] * 3, open_browser=False)
    ... except pp.errors.DataError:
    ...     print("too many images")
    too many images
    """
    for output in (record, save):
        if output is not None:
            writable(output)
    if len(images) > MOST_IMAGES:
        raise DataError(f"images: {len(images)} given, at most {MOST_IMAGES} can be shown; leave the others out")
    organs = {title: tissue} if isinstance(tissue, Tissue) else dict(tissue)
    listener = loopback_socket(port)
    with contextlib.closing(listener):
        check_page()
        payloads = image_payloads(images, [f"image {i + 1}" for i in range(len(images))])
        first = next(iter(organs.values()))
        reason = successor = ""
        if replay is not None:
            session = session_like(replay, first, tension)
        elif model is not None:
            session = Session(build(first, model), radius=radius, tension=tension)
        else:
            found = starting_model(first, radius)
            session, reason, successor = (
                Session(found.model, radius=radius, tension=tension),
                found.reason,
                found.successor,
            )
        haptic = None if device is None or replay is not None else open_device(device, session.mesh)
        pointer = Pointer() if replay is None else Replay(replay)
        where = None if record is None else Path(record)
        live = LiveSession(session, haptic or pointer, title, organs, payloads, task, reason, successor, record=where)
        lines = [f"it begins with {reason}"] if reason else speed_warning(session)
        serve_until_closed(live, listener, haptic or contextlib.nullcontext(), lines, open_browser)
    if save is not None:
        write_tissue(save, live.session.tissue)
        print(f"palpate: tissue with {live.session.cuts} new cut{'s' * (live.session.cuts != 1)} in {save}")


def serve_until_closed(
    live: LiveSession,
    listener: socket.socket,
    device: AbstractContextManager[object],
    lines: Sequence[str],
    open_browser: bool,
) -> None:
    """Serves until Ctrl-C, then writes the records. lines: what is printed below the address."""
    # Signals are handled before the address is printed: the user may press Ctrl-C as soon as it is.
    with shutdown_requests() as ended, running_session(live, listener) as address, device:
        announce(address, "touch it", list(lines))
        show(address, ended, open_browser)
    print("\npalpate: closed")
    if live.record is not None:
        write_records(live.record, [*live.finished, live.session])


def write_records(path: Path, sessions: Sequence[Session]) -> None:
    """Writes the records of successive sessions to `path`, then -2, -3, ..., and removes their journals."""
    for before, session in enumerate(sessions):
        name, journal = record_name(path, before), session.journal
        try:
            write_record(name, session.record())
        except PalpateError as problem:
            if journal is None:
                raise
            raise type(problem)(
                f"{problem}; {journal.path} holds what there was room for: read {name} as ever"
            ) from None
        if journal is not None:
            journal.remove()
        print(f"palpate: session recorded in {name}")


def check_ready(port: int | None) -> None:
    """Checks the port and the page before a long computation. Raises `FileError`, `PortError`."""
    loopback_socket(port).close()
    check_page()


def serving(
    session: Session, listener: socket.socket, *, title: str = "organ", replay: Record | None = None
) -> AbstractContextManager[str]:
    """Runs `session` by the clock and its server, in threads, during the block. Yields the address of the page."""
    return running_session(LiveSession(session, Pointer() if replay is None else Replay(replay), title), listener)


@contextlib.contextmanager
def running_session(live: LiveSession, listener: socket.socket) -> Iterator[str]:
    """Runs a live session and its server during the block. Yields the address of the page."""
    app = application(live, access_token())
    if not live.is_replay:
        live.session.start(live.device)  # a replay starts with the first page
    try:
        with running(app, listener, MESSAGE_BYTES) as address:
            yield address
    finally:
        live.session.stop()


def speed_warning(session: Session) -> list[str]:
    """A warning if this machine is too slow for the mesh, otherwise nothing."""
    if session.sweep_seconds <= 1 / RATE:
        return []
    return [
        f"one sweep of this mesh takes {1e3 * session.sweep_seconds:.1f} ms here: the loop cannot keep "
        f"{RATE} ticks a second; a coarser mesh can (palpate mesh --edge)"
    ]
