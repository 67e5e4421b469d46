"""`palpate demo`."""

import typer

from palpate.commands.missing import missing


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("demo")(demo_command)


def demo_command() -> None:
    """Not built yet."""
    missing("demo")
