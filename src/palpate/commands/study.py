"""`palpate study`: experiments, each one command and one report."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.progress import progress

MEANING = "Experiments: each one command, one report."
study_app = typer.Typer(
    no_args_is_help=True,
    help=f"Example: [bold]palpate study tomosynthesis -o study[/bold]\n\n{MEANING}",
)

Resume = Annotated[bool, typer.Option("--resume", help="Go on from what an earlier run left in -o.")]
Docs = Annotated[Path | None, typer.Option(help="Write the study's page and its pictures there too.")]


def add(app: typer.Typer) -> None:
    """Adds the commands to `app`."""
    app.add_typer(study_app, name="study", short_help=MEANING)


@contextmanager
def _resumable(name: str, quick: bool, output: Path) -> Iterator[Callable[[str, float], None]]:
    """What is told how far a study is; Ctrl-C in it says how to go on."""
    try:
        with progress() as say:
            yield say
    except KeyboardInterrupt:
        again = f"palpate study {name} --resume" + (" --quick" if quick else "") + f" -o {output}"
        raise KeyboardInterrupt(f"go on with: {again}") from None


@study_app.command("tomosynthesis", short_help="Multi-resolution MAP beside fixed resolution and baselines.")
def tomosynthesis(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for report.html, figures, tables, volumes.")
    ] = Path("tomosynthesis"),
    quick: Annotated[
        bool, typer.Option("--quick", help="A small grid and two seeds: for tests, not for reading.")
    ] = False,
    resume: Resume = False,
    docs: Docs = None,
) -> None:
    """Example: [bold]palpate study tomosynthesis -o study[/bold]

    A phantom simulated in closed form, eight views, 200k, 20k and 2k
    photons: how much sooner and how well multi-resolution MAP
    reconstructs it, beside fixed resolution and what others do.

    Takes minutes; Ctrl-C stops it, and --resume goes on.
    """
    with _resumable("tomosynthesis", quick, output) as say:
        report = pp.tomosynthesis_study(output, quick=quick, resume=resume, docs=docs, progress=say)
    typer.echo(f"report: {report.resolve()}")


@study_app.command("head", short_help="Real portal images: who predicts the view that was left out?")
def head(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for report.html, scores.csv, figures, one file a fold.")
    ] = Path("head"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Four views, voxels of 8 and 16 mm: for tests, not for reading.")
    ] = False,
    resume: Resume = False,
    docs: Docs = None,
) -> None:
    """Example: [bold]palpate study head -o head[/bold]

    Eleven real portal images of a head phantom. Each is left out in turn
    and predicted from the others by every method, with all settings, gains
    and shifts chosen without it.

    Takes most of an hour on 2 cores; Ctrl-C stops it, and --resume goes on.
    """
    with _resumable("head", quick, output) as say:
        report = pp.head_study(output, quick=quick, resume=resume, docs=docs, progress=say)
    typer.echo(f"report: {report.resolve()}")


@study_app.command("deformation", short_help="Springs against finite elements, and the ladder of models between.")
def deformation(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for report.html, figures, tables.")] = Path(
        "deformation"
    ),
    quick: Annotated[bool, typer.Option("--quick", help="Small meshes: for tests, not for reading.")] = False,
    resume: Resume = False,
    docs: Docs = None,
) -> None:
    """Example: [bold]palpate study deformation -o study[/bold]

    A cube and a kidney under a finger: how near springs come to finite
    elements, by every law and Poisson's ratio; how soon each model
    answers; what a hand feels.

    Takes minutes; Ctrl-C stops it, and --resume goes on.
    """
    with _resumable("deformation", quick, output) as say:
        report = pp.deformation_study(output, quick=quick, resume=resume, docs=docs, progress=say)
    typer.echo(f"report: {report.resolve()}")


@study_app.command("realtime", short_help="Ticks, late ticks, frames, latency: the simulator on this machine.")
def realtime(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for report.html, figures, tables.")] = Path(
        "realtime"
    ),
    quick: Annotated[bool, typer.Option("--quick", help="One small kidney: for tests, not for reading.")] = False,
    resume: Resume = False,
    docs: Docs = None,
) -> None:
    """Example: [bold]palpate study realtime -o study[/bold]

    A kidney at several resolutions under a sliding finger: how long each
    model takes, whether the loop keeps 1000 ticks a second, how smooth the
    force is, how many pictures Chromium draws and how late they are.

    On an otherwise idle machine. Ctrl-C stops it, and --resume goes on.
    """
    with _resumable("realtime", quick, output) as say:
        report = pp.realtime_study(output, quick=quick, resume=resume, docs=docs, progress=say)
    typer.echo(f"report: {report.resolve()}")
