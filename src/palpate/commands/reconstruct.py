"""`palpate reconstruct`."""

import typer

from palpate.commands.missing import missing


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("reconstruct")(reconstruct_command)


def reconstruct_command() -> None:
    """Not built yet."""
    missing("reconstruct")
