"""`palpate touch`."""

import typer

from palpate.commands.missing import missing


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("touch")(touch_command)


def touch_command() -> None:
    """Not built yet."""
    missing("touch")
