"""What a command says that does not exist yet."""

import typer


def missing(name: str) -> None:
    """Says so and exits with 1."""
    typer.echo(f"palpate {name}: not built yet; see docs/status.md for what is", err=True)
    raise typer.Exit(1)
