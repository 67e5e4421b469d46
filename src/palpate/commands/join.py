"""`palpate join`."""

from pathlib import Path
from typing import Annotated

import typer

import palpate as pp


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("join", short_help="Joins a room with a haptic device.")(join_command)


def join_command(
    invitation: Annotated[
        str,
        typer.Argument(help="The address that `palpate serve` or `palpate invite` has printed.", show_default=False),
    ],
    device: Annotated[str, typer.Option(help="open-haptics, force-dimension or haply; see: doctor.")] = "haply",
    certificate: Annotated[
        Path | None, typer.Option(help="A certificate to trust (.pem), if the server's is signed by nobody known.")
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the room's page here too, to see the organ.")] = True,
) -> None:
    """Example: [bold]palpate join 'http://127.0.0.1:8765/?token=...'[/bold]

    Joins a room with the haptic device of this machine. The force is
    computed here, so that it is felt at once however far the room is; it
    goes when the room is silent, and comes back with it. Quote the
    address. A server of your own certificate, a device elsewhere:
    palpate join 'https://simulator.example.org/?token=...'
    --certificate cert.pem --device haply:localhost:10001
    Ctrl-C leaves the room.
    """
    pp.join(invitation, device, certificate=certificate, open_browser=browser)
