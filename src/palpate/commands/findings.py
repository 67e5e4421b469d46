"""How commands say what a check found."""

from collections.abc import Sequence

import typer

import palpate as pp


def warn(found: Sequence[pp.Finding]) -> None:
    """The findings as lines on the standard error, the most likely cause first."""
    for finding in found:
        typer.echo(f"{'warning' if finding.alarm else 'note'}: {finding}", err=True)
