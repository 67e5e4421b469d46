"""`palpate scan`."""

import typer

from palpate.commands.missing import missing


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("scan")(scan_command)


def scan_command() -> None:
    """Not built yet."""
    missing("scan")
