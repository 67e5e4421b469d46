"""`palpate scene`."""

from pathlib import Path
from typing import Annotated

import typer

import palpate as pp


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("scene", short_help="Joins organs beside each other into one tissue.")(scene_command)


def scene_command(
    scene: Annotated[Path, typer.Argument(help="The organs: .yaml.", show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", help="Tissue to write: .vtu.", show_default=False)],
) -> None:
    """Example: [bold]palpate scene abdomen.yaml -o abdomen.vtu[/bold]

    Joins organs that touch each other into one tissue, for touch: palpate touch abdomen.vtu

    The file names tissues, or organs of a label map, which are meshed:

    palpate scene: 1
    labels: labels.nii.gz
    organs:
      liver: {tissue: liver, edge: 9}
      stomach: {young: 5, edge: 5}
    bones: {vertebrae_L1: {edge: 6}}
    """
    from palpate.atomic_write import writable
    from palpate.meshes.separate_organs import organs
    from palpate.tissue.organ_gaps import organ_gaps

    writable(output)
    joined = pp.read_scene(scene)
    pp.write_tissue(output, joined)
    rest = organ_gaps(joined.mesh).rest
    count = int(organs(joined.mesh).max()) + 1
    names = ", ".join(joined.mesh.names.values())
    typer.echo(f"{count} organs and bones of {len(joined.mesh.nodes):,} nodes: {names}")
    typer.echo(f"{len(rest)} gaps between them, {(rest < 0.1).sum()} of them below 0.1 mm")
    typer.echo(f"wrote {output}")
