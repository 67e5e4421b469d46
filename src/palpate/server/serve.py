"""Opens the simulator: a session, a server on loopback, a page."""

import contextlib
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from palpate.atomic import writable
from palpate.errors import DataError
from palpate.server.app import MESSAGE_BYTES, application
from palpate.server.guard import check_page
from palpate.server.listen import announce, end_asked, loopback_socket, new_token, running, show
from palpate.server.room import Room
from palpate.server.viewing import images as pictures
from palpate.simulation.devices.find import open_device
from palpate.simulation.devices.pointer import Pointer
from palpate.simulation.devices.replay import Replay
from palpate.simulation.record import Record, write_record
from palpate.simulation.replaying import like
from palpate.simulation.session import RATE, Session
from palpate.tissue.models import model as build
from palpate.tissue.tissue import Tissue
from palpate.volumes.volume import Volume

MOST_IMAGES = 2


def touch(
    tissue: Tissue | Mapping[str, Tissue],
    model: str = "blocks",
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
) -> None:
    """Opens the simulator in a browser and stays until Ctrl-C.

    tissue: a `Tissue`, or several of one organ by name (its resolutions; the first one is opened, the page chooses).
    model: a name that `pp.model` knows. radius: of the contact, mm (default: two edge lengths). port: on loopback
    (default: the first free one from 8765 on). record: a file for the session, written when it ends (what follows
    another resolution goes to files of its own, -2, -3, ...). replay: a recorded session to look at instead of a
    pointer; model and radius are then the record's. images: up to two volumes whose slices are shown beside. task: what
    a trainee is asked to do. device: "open-haptics", "force-dimension" or "haply", whose hand then touches while the page
    looks on. Raises `DataError` for more images, `DeviceError` if the device does not answer, `PortError` if the port is
    taken, `FileError` if `record` cannot be written, before anything starts.
    """
    if record is not None:
        writable(record)
    if len(images) > MOST_IMAGES:
        raise DataError(f"images: {len(images)}, at most {MOST_IMAGES} fit beside the organ")
    organs = {title: tissue} if isinstance(tissue, Tissue) else dict(tissue)
    listener = loopback_socket(port)
    with contextlib.closing(listener):
        check_page()
        shown = pictures(images, [f"image {i + 1}" for i in range(len(images))])
        first = next(iter(organs.values()))
        session = Session(build(first, model), radius=radius) if replay is None else like(replay, first)
        hand = None if device is None or replay is not None else open_device(device, session.mesh)
        room = Room(session, hand or (Pointer() if replay is None else Replay(replay)), title, organs, shown, task)
        # Listened for before anyone can know the address: whoever sees it may press Ctrl-C at once.
        with end_asked() as ended, opened(room, listener) as address, hand or contextlib.nullcontext():
            announce(address, "touch it", keeps_up(session))
            show(address, ended, open_browser)
    print("\npalpate: closed")
    if record is not None:
        keep(Path(record), [*room.past, room.session])


def keep(path: Path, sessions: Sequence[Session]) -> None:
    """Records of sessions that followed each other: `path`, then -2, -3, ..."""
    for number, session in enumerate(sessions, 1):
        name = path if number == 1 else path.with_stem(f"{path.stem}-{number}")
        write_record(name, session.record())
        print(f"palpate: session recorded in {name}")


def check_ready(port: int | None) -> None:
    """Is there a page to serve and a port for it? Asked before long work. Raises `FileError`, `PortError`."""
    loopback_socket(port).close()
    check_page()


def serving(
    session: Session, listener: socket.socket, *, title: str = "organ", replay: Record | None = None
) -> AbstractContextManager[str]:
    """Runs `session` by the clock and its server, in threads, while the block lasts. Gives the address of the page."""
    return opened(Room(session, Pointer() if replay is None else Replay(replay), title), listener)


@contextlib.contextmanager
def opened(room: Room, listener: socket.socket) -> Iterator[str]:
    """Runs a room's session and its server while the block lasts. Gives the address of the page."""
    app = application(room, new_token())
    if not room.replayed:
        room.session.start(room.device)  # a replay begins when somebody looks
    try:
        with running(app, listener, MESSAGE_BYTES) as address:
            yield address
    finally:
        room.session.stop()


def keeps_up(session: Session) -> list[str]:
    """What to say of a machine that is too slow for the mesh."""
    if session.sweep_seconds <= 1 / RATE:
        return []
    return [
        f"one sweep of this mesh takes {1e3 * session.sweep_seconds:.1f} ms here: the loop cannot keep "
        f"{RATE} ticks a second; a coarser mesh can (palpate mesh --edge)"
    ]
