"""`palpate mesh`."""

from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.progress import progress


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("mesh", short_help="Fills a label with well-shaped tetrahedra.")(mesh_command)


def mesh_command(
    labels: Annotated[Path, typer.Argument(help="Labels: .nii, .nii.gz, .nrrd, .mha.", show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", help="Mesh to write: .vtu or .msh.", show_default=False)],
    label: Annotated[str, typer.Option(help="The organ, by name or number.", show_default=False)],
    edge: Annotated[float, typer.Option(help="Mean edge of the tetrahedra, mm.")] = 4.0,
    inclusion: Annotated[list[str] | None, typer.Option(help="A label inside it, kept as a region.")] = None,
    fine: Annotated[
        list[str] | None, typer.Option(help="Shorter edge at an inclusion, mm: lump=1.5.", metavar="LABEL=MM")
    ] = None,
    interior: Annotated[float | None, typer.Option(help="Longer edge deep inside the organ, mm.")] = None,
    names: Annotated[
        Path | None, typer.Option(help="JSON of value to name. Default: label_names.json beside the labels.")
    ] = None,
    keep_all: Annotated[bool, typer.Option("--keep-all", help="Mesh all parts of the label.")] = False,
    keep_voids: Annotated[bool, typer.Option("--keep-voids", help="Keep closed voids hollow.")] = False,
    closed_at_border: Annotated[
        bool, typer.Option("--closed-at-border", help="Close an organ that the volume's edge cuts.")
    ] = False,
    smooth: Annotated[
        float | None, typer.Option(help="Smoothing of the label, mm. Default: by voxel and edge.")
    ] = None,
    finer_where_thin: Annotated[
        bool, typer.Option(help="Smaller elements where these would miss the surface by almost half an edge.")
    ] = True,
    mesher: Annotated[
        str, typer.Option(help="stuffing, or tetwild (pip install 'palpate[tetwild]'; slow).")
    ] = "stuffing",
    most_lost: Annotated[float, typer.Option(help="Part of the volume that thin places may lose.")] = 0.05,
) -> None:
    """Example: [bold]palpate mesh labels.nii.gz --label kidney_left --edge 4 -o kidney.vtu[/bold]

    Fills a label with well-shaped tetrahedra.

    An organ with a lump as a region of its own:
    palpate mesh labels.nii.gz --label organ --inclusion lump -o both.vtu
    """
    import warnings

    from palpate.atomic import writable
    from palpate.meshes.files import mesh_format
    from palpate.volumes.names import with_names

    writable(output)
    mesh_format(output)
    finer: dict[int | str, float] = dict(_label_and_edge(text) for text in fine or [])
    stored = with_names(pp.read_labels(labels), labels, names)
    with warnings.catch_warnings(record=True) as said, progress() as say:
        say(f"meshing {label}", 0.0)
        warnings.simplefilter("always", UserWarning)
        mesh = pp.tetrahedralize(
            stored,
            label,
            edge,
            inclusions=inclusion or [],
            fine=finer,
            interior=interior,
            keep="all" if keep_all else "largest",
            fill_holes=not keep_voids,
            closed_at_border=closed_at_border,
            smooth=smooth,
            most_lost=most_lost,
            finer_where_thin=finer_where_thin,
            mesher=mesher,
        )
    for warning in said:
        typer.echo(f"note: {warning.message}", err=True)
    pp.write_mesh(output, mesh)
    typer.echo(str(pp.mesh_quality(mesh, stored)))
    typer.echo(f"wrote {output}")


def _label_and_edge(text: str) -> tuple[str, float]:
    name, _, length = text.rpartition("=")
    try:
        return name, float(length)
    except ValueError:
        raise typer.BadParameter(f"--fine {text}: expected a label and a length in mm, such as lump=1.5") from None
