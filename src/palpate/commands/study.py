"""`palpate study`: experiments, each one command and one report."""

import shlex
from collections.abc import Callable
from functools import partial
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
SEEDS = {  # the studies that draw their data by seed, and what a number of seeds means there
    "tomosynthesis": "Scans of each dose behind each claim.",
    "detection": "Breasts of each kind.",
    "doubt": "Breasts that judge.",
}
SPREADING = ("detection", "doubt")  # the others time what they do, or are soon done
STUDIES = {  # name: in the list of studies; what --quick runs; what the study measures
    "tomosynthesis": (
        "Multi-resolution MAP beside fixed resolution and baselines.",
        "A small grid and two seeds: for tests, not for reading.",
        """A phantom simulated in closed form, eight views, 200k, 20k and 2k
        photons: how much sooner and how well multi-resolution MAP
        reconstructs it, beside fixed resolution and other methods. The
        dissertation's claims are judged on 20 scans of each dose.

        Takes most of an hour; Ctrl-C stops it, and --resume goes on.""",
    ),
    "detection": (
        "Masses and calcifications in random breasts: who finds them?",
        "Small breasts of one kind: for tests, not for reading.",
        """Random breasts under a polychromatic beam with scatter, at three
        doses: what model observers find in the images of MAP, SART, SIRT,
        filtered backprojection and total variation.

        Takes hours on 2 cores; Ctrl-C stops it, and --resume goes on.""",
    ),
    "doubt": (
        "Do intervals of a lump hold its truth, and is it felt?",
        "Few breasts on coarse grids: for tests, not for reading.",
        """Random breasts with one stiff lump: how often intervals of its diameter,
        its depth and the force that it adds hold the truth, before and after a
        correction that other breasts teach, and whether the probabilities that
        a hand feels it are calibrated.

        Takes half an hour and more; Ctrl-C stops it, and --resume goes on.""",
    ),
    "head": (
        "Real portal images: which method best predicts the view left out?",
        "Four views, voxels of 8 and 16 mm: for tests, not for reading.",
        """Eleven real portal images of a head phantom. Each is left out in turn
        and predicted from the others by every method, with all settings, gains
        and shifts chosen without it.

        Takes more than an hour on 2 cores; Ctrl-C stops it, and --resume goes on.""",
    ),
    "deformation": (
        "Springs against finite elements, and the models between.",
        "Small meshes: for tests, not for reading.",
        """A cube and a kidney under a finger: how near springs come to finite
        elements, by every law and Poisson's ratio; how soon each model
        answers; which force the hand feels.

        Takes minutes; Ctrl-C stops it, and --resume goes on.""",
    ),
    "realtime": (
        "Ticks, late ticks, frames, latency: the simulator on this machine.",
        "One small kidney: for tests, not for reading.",
        """A kidney at several resolutions under a sliding finger: how long each
        model takes, whether the loop keeps 1000 ticks a second, how smooth the
        force is, how many frames Chromium draws and how late they are.

        On an otherwise idle machine. Ctrl-C stops it, and --resume goes on.""",
    ),
}


def add(app: typer.Typer) -> None:
    """Adds the commands to `app`."""
    app.add_typer(study_app, name="study", short_help=MEANING)
    for name, (short, quick, text) in STUDIES.items():
        example = f"Example: [bold]palpate study {name} -o study[/bold]"
        study_app.command(name, short_help=short, help=f"{example}\n\n        {text}")(_command(name, quick))


def _command(name: str, quick_help: str) -> Callable[..., None]:
    def study(
        output: Annotated[Path, typer.Option("-o", "--output", help="Folder for report, figures, tables.")] = Path(
            name
        ),
        quick: Annotated[bool, typer.Option("--quick", help=quick_help)] = False,
        resume: Annotated[bool, typer.Option("--resume", help="Go on from what an earlier run left in -o.")] = False,
        docs: Annotated[Path | None, typer.Option(help="Write the study's page and its pictures there too.")] = None,
        seeds: Annotated[int | None, typer.Option(hidden=name not in SEEDS, help=SEEDS.get(name))] = None,
        on: Annotated[
            str | None,
            typer.Option(hidden=name not in SPREADING, help="So many workers here, tcp://host:8786, or slurm:N."),
        ] = None,
    ) -> None:
        more: dict[str, int | str] = {} if seeds is None else {"seeds": seeds}
        if on is not None:
            if name not in SPREADING:
                raise typer.BadParameter(
                    f"the {name} study runs in one process, since it times what it does; {' and '.join(SPREADING)} spread",
                    param_hint="--on",
                )
            more["on"] = on
        if seeds is not None and name not in SEEDS:
            raise typer.BadParameter(
                f"the {name} study draws nothing by seed; only {' and '.join(SEEDS)} do", param_hint="--seeds"
            )
        run = partial(getattr(pp, f"{name}_study"), **more)
        try:
            with progress() as say:
                report = run(output, quick=quick, resume=resume, docs=docs, progress=say)
        except KeyboardInterrupt:
            words = ["palpate", "study", name, "--resume", *["--quick"] * quick, "-o", str(output)]
            words += [] if docs is None else ["--docs", str(docs)]
            words += [] if seeds is None else ["--seeds", str(seeds)]
            words += [] if on is None else ["--on", on]
            raise KeyboardInterrupt(f"go on with: {shlex.join(words)}") from None
        typer.echo(f"report: {report.resolve()}")

    return study
