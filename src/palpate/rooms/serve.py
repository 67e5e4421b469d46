"""Serves rooms until Ctrl-C, and makes invitations to them."""

import asyncio
import contextlib
import json
import secrets
import ssl
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import SplitResult, urlsplit

from palpate.atomic_write import replacing, writable
from palpate.errors import DataError, FileError, PortError
from palpate.rooms.gateway import GatewayConnection, gateway
from palpate.rooms.invitation import HOURS, invitation, sign
from palpate.rooms.open_registry import open_registry
from palpate.rooms.registry import RegistryLost, without_password
from palpate.rooms.room_claim import Host
from palpate.rooms.room_process import RoomProcess
from palpate.rooms.rooms_file import RoomFile
from palpate.server.access_control import check_page
from palpate.server.access_token import kept_secret, state_folder
from palpate.server.loopback_server import HOST, loopback_socket, running, show, shutdown_requests
from palpate.server.message_kinds import Role
from palpate.server.touch_routes import MESSAGE_BYTES

SECRET, ADDRESS = "rooms-secret", "rooms-address"  # files in the state folder
OPENING = 120.0  # s for all rooms to open
PING = 4.0  # s; a page that vanished leaves its room within twice that, and its tools let go


def serve(
    rooms: Sequence[RoomFile],
    *,
    host: str = HOST,
    port: int | None = None,
    address: str | None = None,
    certificate: tuple[str | Path, str | Path] | None = None,
    hours: float = HOURS,
    open_browser: bool = False,
    registry: str | None = None,
    peer: str | None = None,
) -> None:
    """Open rooms in which several people touch one organ, each in a browser of their own, and wait for Ctrl-C.

    Each room is a process. The printed invitations say who may watch, touch and lead.

    Parameters
    ----------
    rooms : sequence of RoomFile
        The rooms.
    host : str, optional
        Address of this machine to listen at. Others than loopback need a certificate, or an `address` with https that
        another server in front of this one answers.
    port : int, optional
        Port. The default is the first free one from 8765 on.
    address : str, optional
        How people reach this server, such as "https://simulator.example.org". The default is host and port.
    certificate : tuple of str or Path, optional
        Files of the certificate and of its key (PEM).
    hours : float, optional
        How long the printed invitations last.
    open_browser : bool, optional
        Whether to open the first room here, as its teacher.
    registry : str, optional
        Redis or NATS, such as "redis://:password@host:6379", if several hosts serve the same rooms. Each room is open on one
        of them, and all let people in. When a host is lost, another goes on with its rooms, their cuts and their notes.
    peer : str, optional
        How the other hosts reach this one, such as "http://10.0.0.7:8765". The default is host and port, if the registry is
        on this machine.

    Raises
    ------
    DataError
        If two rooms have one name, or the address cannot be.
    FileError
        If a file is missing, or a record cannot be written.
    PortError
        If the port is taken, or the registry does not answer. All of these are raised before anything starts.
    ExtraError
        If the package for the registry is not installed.

    Examples
    --------
    >>> pp.serve([pp.RoomFile("anatomy", (Path("kidney.vtu"),))])  # doctest: +SKIP
    >>> try:
    ...     pp.serve([])
    ... except pp.errors.DataError:
    ...     print("no room")
    no room
    """
    with contextlib.closing(loopback_socket(port, host)) as listener, contextlib.ExitStack() as after:
        number = listener.getsockname()[1]
        base = checked_address(address, host, number, certificate is not None)
        pair = None if certificate is None else checked_certificate(*certificate)
        folder = Path(after.enter_context(tempfile.TemporaryDirectory(prefix="palpate-rooms-")))
        processes = checked_rooms(rooms, folder)
        invitations = {name: {role.name: invitation(name, role.name, "", hours) for role in Role} for name in processes}
        secret, others = kept_secret(SECRET), None
        if registry is not None:
            opened = open_registry(registry)
            link = checked_peer(peer, registry, host, number, certificate is not None)
            others, secret = Host(opened, link, secrets.token_hex(4)), shared_secret(registry, secret)
        names = {host_of(base), *(() if others is None else (host_of(others.address),))}
        app = gateway(processes, secret, frozenset(names), others)
        with (
            shutdown_requests() as ended,
            running(app, listener, MESSAGE_BYTES, GatewayConnection, pair, PING) as own,
            known_address(base, list(processes), secret),
        ):
            wait_for(processes)
            for name, roles in invitations.items():
                print(f"palpate: room {name}, invitations for {hours:g} h")
                for role in reversed(Role):
                    print(f"         {role.name:8s} {base}?token={sign(roles[role.name], secret)}")
            print(
                "         one with a name or for another time: palpate invite ROOM --role trainee --name Ada --hours 2"
            )
            print("         Ctrl-C closes all rooms. Research software, not a medical device.", flush=True)
            first = next(iter(invitations.values()))["teacher"]
            show(f"{own}?token={sign(first, secret)}", ended, open_browser)
        print("\npalpate: closed")


def invite(room: str, role: str = "trainee", name: str = "", hours: float = HOURS) -> str:
    """Invite somebody to a room that this user serves on this machine.

    Parameters
    ----------
    room : str
        Name of the room.
    role : {"viewer", "trainee", "teacher"}, optional
        What the person may do: watch, touch, lead.
    name : str, optional
        How all in the room see the person.
    hours : float, optional
        Until when the person may enter, from now on.

    Returns
    -------
    str
        The address to open.

    Raises
    ------
    DataError
        If no rooms are served, this one is not there, or the role, the name or the time cannot be.

    Examples
    --------
    >>> pp.invite("anatomy", "trainee", "Ada", hours=2)  # doctest: +SKIP
    'https://simulator.example.org/?token=...'
    >>> try:
    ...     pp.invite("anatomy", "surgeon")
    ... except pp.errors.DataError:
    ...     print("no such role")
    no such role
    """
    one = invitation(room, role, name, hours)
    try:
        served = json.loads((state_folder() / ADDRESS).read_text(encoding="utf-8"))
        base, rooms, secret = str(served["address"]), list(served["rooms"]), str(served["secret"])
    except (OSError, ValueError, KeyError, TypeError):
        raise DataError("no rooms are served here; start them with: palpate serve tissue.vtu") from None
    if room not in rooms:
        raise DataError(f"room {room}: not there; rooms: {', '.join(map(str, rooms))}")
    return f"{base}?token={sign(one, secret)}"


def checked_address(address: str | None, host: str, port: int, encrypted: bool) -> str:
    """How people reach the server, with a slash at its end. Raises `DataError`."""
    if address is None:
        if host in ("0.0.0.0", "::"):
            raise DataError(
                f"host {host}: people cannot open that; give the name of this machine: --address https://..."
            )
        address = f"http{'s' if encrypted else ''}://{host}:{port}"
    parts = server_parts("address", address, "https://NAME or https://NAME:PORT")
    if parts.scheme == "http" and parts.hostname not in ("localhost", "127.0.0.1"):
        raise DataError(
            f"address {address}: over http anybody on the way can read the invitations; give --certificate and --key, or an "
            "https address that a server in front of this one answers"
        )
    return f"{parts.scheme}://{parts.netloc}/"


def checked_peer(peer: str | None, registry: str, host: str, port: int, encrypted: bool) -> str:
    """How other hosts reach this one, without a slash at its end. Raises `DataError`."""
    if peer is None:
        if host == "0.0.0.0" or (host == HOST and (urlsplit(registry).hostname or HOST) not in ("localhost", HOST)):
            raise DataError(
                f"peer: the other hosts cannot reach {host}; give this one's address: --peer http://10.0.0.7:{port}"
            )
        peer = f"http{'s' if encrypted else ''}://{host}:{port}"
    parts = server_parts("peer", peer, "http://HOST:PORT or https://HOST:PORT")
    return f"{parts.scheme}://{parts.netloc}"


def server_parts(what: str, address: str, expected: str) -> SplitResult:
    """The parts of a server's address, which names no page. Raises `DataError`."""
    parts = urlsplit(address)
    if parts.scheme not in ("http", "https") or not parts.hostname or parts.path.strip("/") or parts.query:
        raise DataError(f"{what} {address}: expected {expected}")
    return parts


def shared_secret(address: str, own: str) -> str:
    """The secret of all hosts, so that each lets in whom another has invited. Raises `PortError`."""

    async def ask() -> str:
        registry = open_registry(address)
        try:
            return await registry.secret(own)
        finally:
            await registry.close()

    try:
        return asyncio.run(ask())
    except RegistryLost as problem:
        raise PortError(
            f"registry {without_password(address)}: no answer ({problem}); start it, or correct the address"
        ) from None


def host_of(address: str) -> str:
    """The name of the host in an address."""
    return (urlsplit(address).hostname or "").lower()


def checked_certificate(certificate: str | Path, key: str | Path) -> tuple[Path, Path]:
    """The files, if they are a certificate and its key. Raises `FileError`."""
    pair = Path(certificate), Path(key)
    for path in pair:
        if not path.is_file():
            raise FileError(f"{path}: no such file; one to try with: openssl req -x509 -newkey rsa:2048 -nodes")
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(*pair)
    except (ssl.SSLError, OSError) as problem:
        raise FileError(f"{pair[0]}, {pair[1]}: no certificate and its key without a password ({problem})") from None
    return pair


def checked_rooms(rooms: Sequence[RoomFile], folder: Path) -> dict[str, RoomProcess]:
    """The rooms by name. folder: for journals of those that are not recorded. Raises `DataError` and `FileError`."""
    check_page()
    if not rooms:
        raise DataError("rooms: none; give a tissue (.vtu) or a list of rooms (.yaml)")
    names = [room.name for room in rooms]
    if len(set(names)) < len(names):
        raise DataError(f"rooms: two are called {max(names, key=names.count)}; give each a name of its own")
    for room in rooms:
        for path in (*room.organs, *room.replay, *([room.lesson] if room.lesson else [])):
            if not path.is_file():
                raise FileError(f"{path}: no such file; room {room.name} needs it")
        if room.record is not None:
            writable(room.record)
    return {room.name: RoomProcess(room, room.record or folder / f"{room.name}.h5") for room in rooms}


def wait_for(rooms: dict[str, RoomProcess]) -> None:
    """Until all rooms are open. Raises `DataError` with what is wrong with one, and `PortError` if it takes too long."""
    end = time.monotonic() + OPENING
    while missing := [name for name, room in rooms.items() if not room.place]:
        for room in rooms.values():
            if room.problem:
                raise DataError(room.problem)
        if time.monotonic() > end:
            raise PortError(f"rooms {', '.join(missing)}: not open after {OPENING:g} s; open fewer, or smaller organs")
        time.sleep(0.02)


@contextlib.contextmanager
def known_address(address: str, rooms: list[str], secret: str) -> Iterator[None]:
    """Keeps the address and the secret for `invite` during the block, in a file that only this user can read."""
    path = state_folder() / ADDRESS
    text = json.dumps({"address": address, "rooms": rooms, "secret": secret})
    with contextlib.suppress(OSError):  # without it `invite` says that no rooms are served
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with replacing(path) as temporary:
            temporary.touch(0o600)
            temporary.write_text(text, encoding="utf-8")
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            if path.read_text(encoding="utf-8") == text:  # else it is a later server's
                path.unlink()
