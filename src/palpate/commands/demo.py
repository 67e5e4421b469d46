"""`palpate demo`: the whole way on data that ships with the package."""

import tempfile
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.progress import progress


class Which(StrEnum):
    """The samples."""

    breast = "breast"
    kidney = "kidney"
    head = "head"


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("demo")(demo)


def demo(
    which: Annotated[Which, typer.Argument(help="what to show")] = Which.breast,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="folder for every file and report.html; default: a new one")
    ] = None,
    browser: Annotated[bool, typer.Option(help="end with the organ in the browser, or with the report")] = True,
    resume: Annotated[bool, typer.Option(help="go on from the files that an earlier run left in -o")] = False,
    training: Annotated[bool, typer.Option(help="breast: touch the one with an added training lump")] = False,
    port: Annotated[int | None, typer.Option(help="of the page, on this machine's loopback")] = None,
) -> None:
    """From X-ray projections to an organ you can touch, on data that ships with palpate.

    Example: palpate demo --no-browser -o demo

    breast: photon counts of seven views to a volume, the breast with its stiff lesion, and what a hand would feel.
    kidney: a CT with labels to a kidney. head: real portal images to a volume (nothing to touch). Takes a few minutes
    at most; Ctrl-C stops it, and --resume goes on.
    """
    folder = output or Path(tempfile.mkdtemp(prefix=f"palpate-{which.value}-"))
    with progress() as say:
        tissues = pp.demonstrate(which.value, folder, resume=resume, progress=say)
    typer.echo(f"report: {(folder / 'report.html').resolve()}")
    if browser and tissues:
        name = "training" if training and "training" in tissues else next(iter(tissues))
        pp.touch(tissues[name], port=port, title=name)
    elif training and "training" not in tissues:
        typer.echo("palpate demo: only the breast has a training lump", err=True)
