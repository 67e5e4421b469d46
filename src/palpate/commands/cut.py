"""`palpate cut`."""

from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.fit import numbers


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("cut", short_help="Cuts a tissue along a path on its surface.")(cut_command)


def cut_command(
    tissue: Annotated[Path, typer.Argument(help="Tissue, cut before or not: .vtu.", show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", help="Cut tissue to write: .vtu.", show_default=False)],
    start: Annotated[str, typer.Option("--from", help="Where the cut begins, on the surface: x,y,z mm.")],
    end: Annotated[str, typer.Option("--to", help="Where it ends: x,y,z mm.")],
    depth: Annotated[float, typer.Option(help="Of the blade's tip below the surface, mm.")],
    via: Annotated[list[str] | None, typer.Option(help="A point between them, for a cut that turns; in order.")] = None,
    direction: Annotated[
        str | None, typer.Option(help="Way of the blade into the tissue: x,y,z. Default: against the surface's normal.")
    ] = None,
    loose: Annotated[
        str, typer.Option(help="A piece that comes free and is not held: refuse, or remove it.")
    ] = "refuse",
    tension: Annotated[
        float, typer.Option(help="For the picture: tension of the tissue at rest, kPa, under which the cut gapes.")
    ] = 0.0,
    picture: Annotated[Path | None, typer.Option(help="Picture of the cut: .png, .svg.", show_default=False)] = None,
) -> None:
    """Example: [bold]palpate cut tissue.vtu --from 76,-159,325 --to 76,-159,345 --depth 12 -o cut.vtu[/bold]

    Cuts a tissue along a path on its surface.

    A cut that turns, with its picture:
    palpate cut tissue.vtu --from 76,-159,325 --via 72,-158,335 --to 76,-159,345 --depth 12 --picture cut.png -o cut.vtu

    One across the other:
    palpate cut cut.vtu --from 66,-157,335 --to 86,-157,335 --depth 12 -o cross.vtu

    Instead of refusing to free a piece, take it away: --loose remove
    """
    from palpate.atomic_write import replacing, writable
    from palpate.meshes.cutting.cut_mesh import CutMesh

    writable(output)
    if picture is not None:
        writable(picture)
    elif tension:
        raise typer.BadParameter("is for the picture; give --picture too", param_hint="--tension")
    path = [numbers("--from", start), *(numbers("--via", text) for text in via or ()), numbers("--to", end)]
    way = None if direction is None else numbers("--direction", direction)
    whole = pp.read_tissue(tissue)
    opened = pp.cut(whole, pp.incision(whole, path, depth, way), loose)
    pp.write_tissue(output, opened)
    if isinstance(opened.mesh, CutMesh):
        typer.echo(opened.mesh.text())
    if picture is not None:
        figure = pp.plot_cut(opened, pp.gape(opened, tension) if tension else None)
        with replacing(picture) as temporary:
            figure.savefig(temporary, format=picture.suffix.lstrip(".").lower() or "png", dpi=150)
        typer.echo(f"wrote {picture}")
    typer.echo(f"wrote {output}")
