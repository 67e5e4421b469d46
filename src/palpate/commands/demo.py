"""`palpate demo`: the whole way on data that ships with the package."""

import shlex
import tempfile
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.progress import progress

DemoName = StrEnum("DemoName", "breast kidney head")


IMAGES = {DemoName.breast: "volume.nii.gz", DemoName.kidney: "ct.nii.gz"}  # what the organ was made from


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("demo", short_help="From projections to an organ you can touch, on samples.")(demo)


def demo(
    which: Annotated[DemoName, typer.Argument(help="What to show.")] = DemoName.breast,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for every file and report.html. Default: a new one.")
    ] = None,
    browser: Annotated[bool, typer.Option(help="End with the organ in the browser, or with the report.")] = True,
    resume: Annotated[bool, typer.Option(help="Go on from the files that an earlier run left in -o.")] = False,
    training: Annotated[bool, typer.Option(help="Breast: touch the one with an added training lump.")] = False,
    port: Annotated[int | None, typer.Option(help="Of the page, on this machine's loopback.")] = None,
) -> None:
    """Example: [bold]palpate demo --no-browser -o demo[/bold]

    From X-ray projections to an organ you can touch, on data that ships
    with palpate.

    breast: photon counts of seven views to a volume, the breast with its
    stiff lesion, and what a hand would feel. kidney: a CT with labels to a
    kidney. head: real portal images to a volume (nothing to touch).

    Takes a few minutes at most; Ctrl-C stops it, and --resume goes on.
    """
    from palpate.server.touch import check_ready

    if training and which is not DemoName.breast:
        raise typer.BadParameter(f"{which.value} has no training lump; only the breast has", param_hint="--training")
    if browser and which is not DemoName.head:
        check_ready(port)
    folder = output or Path(tempfile.mkdtemp(prefix=f"palpate-{which.value}-"))
    try:
        with progress() as say:
            tissues = pp.run_demo(which.value, folder, resume=resume, progress=say)
    except KeyboardInterrupt:
        words = ["palpate", "demo", which.value, "--resume", "-o", str(folder)]
        words += (
            ["--training"] * training
            + ["--no-browser"] * (not browser)
            + ([] if port is None else ["--port", str(port)])
        )
        raise KeyboardInterrupt(f"go on with: {shlex.join(words)}") from None
    typer.echo(f"report: {(folder / 'report.html').resolve()}")
    if browser and tissues:
        name = "training" if training else next(iter(tissues))
        pp.touch(tissues[name], port=port, title=name, images=[pp.read_volume(folder / IMAGES[which])])
