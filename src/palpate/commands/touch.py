"""`palpate touch`."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

import palpate as pp


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("touch", short_help="Opens an organ in the browser, to touch.")(touch_command)


def touch_command(
    tissue: Annotated[
        list[Path], typer.Argument(help="What `palpate fit` or `palpate demo` wrote (.vtu); more: other resolutions.")
    ],
    model: Annotated[
        str | None,
        typer.Option(
            help="springs, blocks, multigrid, compliance or neo-hookean. Default: what keeps 1000 ticks a second here."
        ),
    ] = None,
    radius: Annotated[float | None, typer.Option(help="Of the contact, mm. Default: two edge lengths.")] = None,
    port: Annotated[
        int | None, typer.Option(help="On this machine's loopback. Default: a free one from 8765 on.")
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the page here, or only print its address.")] = True,
    record: Annotated[Path | None, typer.Option(help="Write the session here when it ends (.h5).")] = None,
    replay: Annotated[
        list[Path] | None,
        typer.Option(help="Look at a recorded session (.h5) instead of touching; twice: at two side by side."),
    ] = None,
    image: Annotated[list[Path] | None, typer.Option(help="A volume whose slices are shown beside; up to two.")] = None,
    device: Annotated[str | None, typer.Option(help="open-haptics, force-dimension or haply; see: doctor.")] = None,
    tension: Annotated[
        float, typer.Option(help="Of the tissue at rest, kPa: cuts gape by it in the picture.", show_default=False)
    ] = 0.0,
    toughness: Annotated[
        float | None, typer.Option(help="Energy of a cut, J/m². Default: of the tissues that were fitted by name.")
    ] = None,
    region_toughness: Annotated[
        list[str] | None, typer.Option(help="Another one for a region, by name or number: lump=900")
    ] = None,
    save: Annotated[
        Path | None, typer.Option(help="Write the tissue with its cuts here when the session ends (.vtu).")
    ] = None,
    task: Annotated[str, typer.Option(help="Set a trainee a task: lump or biopsy; scored if recorded.")] = "touch",
) -> None:
    """Example: [bold]palpate touch tissue.vtu --record session.h5[/bold]

    Touch an organ in the browser: press, stroke, pull, see the force.

    Hold on the organ to press it in and stroke along to feel what lies
    below; drag beside it to turn the view. Cut it: choose Cut and draw
    over it. The page is served to this machine only; the printed ssh line
    reaches it from another one. Ctrl-C ends the session.

    Two recorded sessions beside each other, on one timeline:
    palpate touch tissue.vtu --replay mine.h5 --replay hers.h5
    """
    from palpate.commands.by_region import by_region
    from palpate.commands.fit import P1_NOTE
    from palpate.commands.score import scored
    from palpate.simulation.training_task import target_of

    replays = dict(zip(stems(replay or []), map(pp.read_record, replay or []), strict=True))
    organs = {name: pp.read_tissue(path) for name, path in zip(stems(tissue), tissue, strict=True)}
    for path, organ in zip(tissue, organs.values(), strict=True):
        if organ.element == "P1":
            typer.echo(P1_NOTE.format(path))
    asked, solid = pp.Task(task), next(iter(organs.values()))
    target_of(asked, solid)  # a task that this tissue cannot set is refused before anyone tries
    pp.touch(
        organs,
        model,
        radius=radius,
        port=port,
        open_browser=browser,
        record=record,
        replay=replays or None,
        title=tissue[0].stem,
        images=[pp.read_volume(path) for path in image or ()],
        device=device,
        task=asked.text,
        tension=tension,
        toughness=by_region(solid.mesh, "--region-toughness", float, toughness, region_toughness) or None,
        save=save,
    )
    if record is not None and task != "touch":
        typer.echo(scored(pp.read_record(record), solid, asked, record.name).text())
        words = ["palpate", "score", str(record), str(tissue[0]), "--task", task, "-o", "report.html"]
        typer.echo(f"report: {shlex.join(words)}")


def stems(paths: list[Path]) -> list[str]:
    """Names of files without folder and ending; the whole paths if two of these are the same."""
    return [path.stem if len({p.stem for p in paths}) == len(paths) else str(path) for path in paths]
