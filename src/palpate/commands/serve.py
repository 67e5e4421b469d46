"""`palpate serve` and `palpate invite`."""

from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.touch import stems


def add(app: typer.Typer) -> None:
    """Adds the commands to `app`."""
    app.command("serve", short_help="Opens rooms in which several people touch one organ.")(serve_command)
    app.command("invite", short_help="Invites somebody to a room that is served here.")(invite_command)


def serve_command(
    what: Annotated[
        list[Path],
        typer.Argument(help="Tissues (.vtu), each a room, or one list of rooms (.yaml).", show_default=False),
    ],
    host: Annotated[str, typer.Option(help="Address of this machine to listen at; 0.0.0.0: all.")] = "127.0.0.1",
    port: Annotated[int | None, typer.Option(help="Default: the first free one from 8765 on.")] = None,
    address: Annotated[str | None, typer.Option(help="How people reach it: https://simulator.example.org")] = None,
    certificate: Annotated[Path | None, typer.Option(help="For https: the certificate (.pem).")] = None,
    key: Annotated[Path | None, typer.Option(help="For https: its key (.pem).")] = None,
    hours: Annotated[float, typer.Option(help="How long the printed invitations last.")] = 12.0,
    browser: Annotated[bool, typer.Option(help="Open the first room here as its teacher.")] = True,
    registry: Annotated[
        str | None, typer.Option(help="If several hosts serve these rooms: redis://HOST:6379 or nats://HOST:4222")
    ] = None,
    peer: Annotated[str | None, typer.Option(help="How the other hosts reach this one: http://10.0.0.7:8765")] = None,
) -> None:
    """Example: [bold]palpate serve kidney.vtu[/bold]

    Opens rooms in which several people touch one organ, each in a browser
    of their own. The printed invitations let people watch, touch or lead.
    From another machine over TLS:
    palpate serve kidney.vtu --host 0.0.0.0 --certificate cert.pem
    --key key.pem --address https://simulator.example.org:8765
    On several hosts, of which one may be lost: the same on each, with
    --registry redis://host:6379 --peer http://10.0.0.7:8765
    """
    if (certificate is None) != (key is None):
        raise pp.errors.DataError("certificate, key: one without the other; give both")
    rooms: list[pp.RoomFile] = []
    for path, name in zip(what, stems(what), strict=True):
        if path.suffix in (".yaml", ".yml"):
            rooms += pp.read_rooms(path)
        else:
            rooms.append(pp.RoomFile(room_name(name), (path,)))
    pair = None if certificate is None or key is None else (certificate, key)
    pp.serve(
        rooms,
        host=host,
        port=port,
        address=address,
        certificate=pair,
        hours=hours,
        open_browser=browser,
        registry=registry,
        peer=peer,
    )


def room_name(text: str) -> str:
    """A name that a room can have."""
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in text)[-40:] or "room"


def invite_command(
    room: Annotated[str, typer.Argument(help="Name of the room.", show_default=False)],
    role: Annotated[str, typer.Option(help="viewer, trainee or teacher: may watch, touch, lead.")] = "trainee",
    name: Annotated[str, typer.Option(help="How all in the room see the person.", show_default=False)] = "",
    hours: Annotated[float, typer.Option(help="Until when the person may enter.")] = 12.0,
) -> None:
    """Example: [bold]palpate invite kidney --name Ada --hours 2[/bold]

    Prints an address that lets somebody into a room which this user
    serves on this machine, in a role, until the invitation is over.
    """
    typer.echo(pp.invite(room, role, name, hours))
