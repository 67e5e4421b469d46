"""`palpate fit`."""

import typer

from palpate.commands.missing import missing


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("fit")(fit_command)


def fit_command() -> None:
    """Not built yet."""
    missing("fit")
