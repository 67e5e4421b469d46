"""`palpate segment`."""

import typer

from palpate.commands.missing import missing


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("segment")(segment_command)


def segment_command() -> None:
    """Not built yet."""
    missing("segment")
