"""`palpate mesh`."""

import typer

from palpate.commands.missing import missing


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("mesh")(mesh_command)


def mesh_command() -> None:
    """Not built yet."""
    missing("mesh")
