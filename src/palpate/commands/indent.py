"""`palpate indent`."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.progress import doing


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("indent", short_help="Fits a tissue's stiffness to the force of an indenter.")(indent_command)


def indent_command(
    curve: Annotated[
        Path, typer.Argument(help="Table whose first line names depth and force: depth mm,force N", show_default=False)
    ],
    tissue: Annotated[Path, typer.Argument(help="What `palpate fit` wrote (.vtu).", show_default=False)],
    at: Annotated[str, typer.Option(help="Where the indenter touched, mm: x,y,z.", show_default=False)],
    sphere: Annotated[
        float | None, typer.Option(help="Radius of a round indenter, mm; or --punch.", show_default=False)
    ] = None,
    punch: Annotated[
        float | None, typer.Option(help="Radius of a flat cylinder, mm; or --sphere.", show_default=False)
    ] = None,
    find_onset: Annotated[
        bool, typer.Option("--find-onset", help="Find where the force begins to rise, and what it is before that.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Tissue with that stiffness to write: .vtu.", show_default=False),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of curve and fit: .png, .svg.", show_default=False)] = None,
) -> None:
    """Example: [bold]palpate indent curve.csv tissue.vtu --at 0,0,30 --sphere 5 -o measured.vtu[/bold]

    Fits Young's modulus to a measured curve of force over depth, with its
    95 % interval: of a device, a robot, or the literature. Regions keep the
    ratio of their stiffness.

    A curve that begins before the contact, and a picture of the fit:
    palpate indent curve.csv tissue.vtu --at 0,0,30 --punch 4 --find-onset --plot fit.png
    """
    from palpate.atomic_write import replacing, writable
    from palpate.commands.fit import numbers
    from palpate.errors import FileError

    for path in (output, plot):
        if path is not None:
            writable(path)
    if output is not None and output.suffix.lower() != ".vtu":
        raise FileError(f"{output}: tissue is written as .vtu; name it so")
    place = numbers("--at", at)
    measured, solid = pp.read_indentation(curve), pp.read_tissue(tissue)
    with doing("pressing the tissue"):
        found = pp.fit_indentation(solid, measured, place, sphere=sphere, punch=punch, find_onset=find_onset)
    typer.echo(found.text)
    if plot is not None:
        with replacing(plot) as temporary:
            figure = pp.plot_indentation(found, f"{curve.name}: E = {found.young:.3g} kPa")
            figure.savefig(temporary, format=plot.suffix.lstrip(".").lower() or "png", dpi=150)
    if output is not None:
        pp.write_tissue(output, found.tissue)
        typer.echo(f"wrote {output}; touch it: palpate touch {shlex.quote(str(output))}")
