"""`palpate score`."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.progress import doing, progress


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("score", short_help="Scores a recorded session, for a teacher.")(score_command)


def score_command(
    session: Annotated[
        Path,
        typer.Argument(help="What `palpate touch --record` wrote (.h5), or a page saved (.json).", show_default=False),
    ],
    tissue: Annotated[Path, typer.Argument(help="The tissue that was touched (.vtu).", show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", help="Report to write; .json and .csv beside it.")] = Path(
        "report.html"
    ),
    reference: Annotated[Path | None, typer.Option(help="Another session (.h5) on this tissue, put beside it.")] = None,
    task: Annotated[str, typer.Option(help="What was asked: touch, lump or biopsy.")] = "touch",
    target: Annotated[str, typer.Option(help="Region that is sought. Default: the stiffest inside.")] = "",
    within: Annotated[float, typer.Option(help="How far beside a lump a mark may be, mm.")] = 5.0,
    force: Annotated[float, typer.Option(help="Force not to be exceeded, N.")] = 5.0,
    strain: Annotated[float, typer.Option(help="Stretch of the tissue not to be exceeded, as a share.")] = 0.3,
) -> None:
    """Example: [bold]palpate score session.h5 tissue.vtu --task lump -o report.html[/bold]

    Replays a recorded session and reports what a teacher asks of it:
    time, way, force, strain of the tissue, and what was found.

    The limits are yours to choose; the defaults are no clinical ones.
    """
    from palpate.atomic_write import writable

    writable(output)
    solid, asked = pp.read_tissue(tissue), pp.Task(task, target, within, force, strain)
    score = scored(pp.read_record(session), solid, asked, session.name)
    other = None if reference is None else scored(pp.read_record(reference), solid, asked, reference.name)
    words = ["palpate", "score", str(session), str(tissue), "-o", str(output)]
    words += [] if reference is None else ["--reference", str(reference)]
    usual = pp.Task()
    for name in ("kind", "target", "within", "force", "strain"):
        if getattr(asked, name) != getattr(usual, name):
            words += ["--task" if name == "kind" else f"--{name}", str(getattr(asked, name))]
    with doing("writing the report"):
        made = pp.score_report(output, score, other, command=shlex.join(words))
    typer.echo(score.text())
    typer.echo(f"report: {made[0].resolve()}")


def scored(record: "pp.Record", tissue: "pp.Tissue", task: "pp.Task", name: str) -> "pp.Score":
    """The score, with progress: to make the model takes a while, and a replay some of the session's own time."""
    with progress() as say:
        say(f"replaying {name}", 0.0)
        return pp.score(record, tissue, task, progress=lambda share: say(f"replaying {name}", share))
