"""`palpate export`."""

from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.by_region import by_region


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("export", short_help="Writes an organ as one page, to touch anywhere.")(export_command)


def export_command(
    tissue: Annotated[
        Path, typer.Argument(help="What `palpate fit` or `palpate demo` wrote: .vtu.", show_default=False)
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Page to write: .html; or the folder.", show_default=False)
    ],
    title: Annotated[str | None, typer.Option(help="Name that the page shows. Default: organ.")] = None,
    radius: Annotated[float | None, typer.Option(help="Of the contact, mm. Default: two edge lengths.")] = None,
    toughness: Annotated[
        float | None, typer.Option(help="Energy of a cut, J/m². Default: of the tissues that were fitted by name.")
    ] = None,
    region_toughness: Annotated[
        list[str] | None, typer.Option(help="Another one for a region, by name or number: lump=900")
    ] = None,
    task: Annotated[
        str, typer.Option(help="Set a trainee a task: lump or biopsy; the page saves the session.")
    ] = "touch",
    folder: Annotated[
        bool, typer.Option("--folder", help="Write separate files into a folder, for a web host.")
    ] = False,
) -> None:
    """Example: [bold]palpate export tissue.vtu -o organ.html --title Kidney[/bold]

    Writes an organ as one page, to touch anywhere.

    The page holds the organ and the engine of the real-time loop. It works
    from a disk or any web host, without a server and offline. It names no
    patient and no file: the title is what you give. "Save session" in the
    page writes what was done there, for a score:
    palpate score session.json tissue.vtu
    """
    asked = pp.Task(task)
    solid = pp.read_tissue(tissue)
    tough = by_region(solid.mesh, "--region-toughness", float, toughness, region_toughness) or None
    written = pp.export(solid, output, title=title, radius=radius, toughness=tough, task=asked, folder=folder)
    if folder:
        typer.echo(f"{written.parent}: put it on a web host; a browser does not open these files from a disk")
    else:
        typer.echo(f"{written}: {written.stat().st_size / 1e6:.1f} MB; open it in a browser")
