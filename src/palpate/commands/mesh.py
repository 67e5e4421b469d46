"""`palpate mesh`."""

from pathlib import Path
from typing import Annotated, Any

import typer

import palpate as pp
from palpate.commands.archive_option import archive_option
from palpate.commands.fit import numbers, write_error_map
from palpate.commands.option_names import option_names
from palpate.commands.progress import progress


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("mesh", short_help="Fills a label with well-shaped tetrahedra.")(mesh_command)


@archive_option((".nii.gz", ".nii", ".nrrd", ".mha", ".stl", ".ply", ".obj"), ".vtu")
def mesh_command(
    labels: Annotated[
        Path,
        typer.Argument(
            help="Labels: .nii, .nii.gz, .nrrd, .mha; a closed surface: .stl, .ply, .obj, .glb, .gltf; or a mesh, to "
            "write it anew.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            help="Mesh: .vtu, .msh; its surface: .stl, .ply, .obj, .glb. With --all a folder.",
            show_default=False,
        ),
    ],
    label: Annotated[str | None, typer.Option(help="The organ, by name or number.", show_default=False)] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Each label, by itself: -o is a folder then, and gets a scene.yaml too.")
    ] = False,
    edge: Annotated[
        float | None, typer.Option(help="Mean edge of the tetrahedra, mm. Default: 4; of a wall its thickness.")
    ] = None,
    wall: Annotated[
        float | None,
        typer.Option(help="The label is a lumen: mesh a wall of so many mm around it.", show_default=False),
    ] = None,
    inclusion: Annotated[
        list[str] | None, typer.Option(help="A label (or surface) inside it, kept as a region.")
    ] = None,
    fine: Annotated[
        list[str] | None, typer.Option(help="Shorter edge at an inclusion, mm: lump=1.5.", metavar="LABEL=MM")
    ] = None,
    interior: Annotated[float | None, typer.Option(help="Longer edge deep inside the organ, mm.")] = None,
    names: Annotated[
        Path | None, typer.Option(help="JSON of value to name. Default: label_names.json beside the labels.")
    ] = None,
    keep: Annotated[
        str,
        typer.Option(
            help="Of parts that do not touch: largest (with inclusions: theirs), all, left, right, anterior, posterior, "
            "superior, inferior, a rank by size, or x,y,z mm in it."
        ),
    ] = "largest",
    keep_all: Annotated[bool, typer.Option("--keep-all", help="The same as --keep all.")] = False,
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
    within: Annotated[
        float | None,
        typer.Option(help="Refine until the force of a contact is estimated within so many % at 95 % of the places."),
    ] = None,
    radius: Annotated[
        float | None, typer.Option(help="Of that contact, mm. Default: two of --edge.", show_default=False)
    ] = None,
    poisson: Annotated[float, typer.Option(help="For --within: Poisson's ratio.")] = 0.45,
    stiffer: Annotated[
        list[str] | None,
        typer.Option(help="For --within: how much stiffer an inclusion is: lump=10.", metavar="LABEL=RATIO"),
    ] = None,
    rest_on: Annotated[str, typer.Option(help="For --within: way to the table that holds it: x,y,z.")] = "0,0,-1",
    most_tets: Annotated[int, typer.Option(help="For --within: about how many tetrahedra at most.")] = 150_000,
    error_map: Annotated[
        Path | None,
        typer.Option("--map", help="For --within: picture of the estimated error: .png, .svg.", show_default=False),
    ] = None,
) -> None:
    """Example: [bold]palpate mesh labels.nii.gz --label kidney_left --edge 4 -o kidney.vtu[/bold]

    Fills a label with well-shaped tetrahedra.

    An organ with a lump as a region of its own:
    palpate mesh labels.nii.gz --label organ --inclusion lump -o both.vtu

    A hollow organ, to be seen from inside by touch; open where the volume's side cuts it:
    palpate mesh labels.nii.gz --label aorta --wall 2 -o aorta.vtu

    A surface of another program: palpate mesh organ.stl --edge 4 -o organ.vtu

    One of two kidneys that have one label:
    palpate mesh labels.nii.gz --label kidney --keep left -o kidney.vtu

    Every organ of a label map, and a scene of them to complete:
    palpate mesh labels.nii.gz --all -o abdomen/

    Fine enough for 3 % of the force of a contact of 8 mm radius:
    palpate mesh labels.nii.gz --label kidney --within 3 --radius 8 -o kidney.vtu
    """
    import warnings

    from palpate.atomic_write import writable
    from palpate.meshes.io import READ, mesh_format
    from palpate.meshes.surface_files import is_surface
    from palpate.volumes.label_names import with_names

    if every:
        one = [label, wall, inclusion, fine, within, radius, stiffer, error_map]
        if any(option is not None for option in one):
            raise typer.BadParameter(
                "takes --edge, --names and how to mesh, which hold for each label", param_hint="--all"
            )
        alike: dict[str, Any] = {"interior": interior, "keep": "all" if keep_all else _part(keep), "smooth": smooth}
        alike |= {"fill_holes": not keep_voids, "most_lost": most_lost, "mesher": mesher}
        return mesh_every(labels, output, edge, names, alike | {"finer_where_thin": finer_where_thin})
    writable(output)
    if error_map is not None:
        writable(error_map)
    if within is None and (radius is not None or stiffer or error_map is not None):
        raise typer.BadParameter("are for --within; give it too", param_hint="--radius, --stiffer, --map")
    mesh_format(output)
    if labels.suffix.lower() in READ:
        if within is not None:
            raise typer.BadParameter(f"{labels} is a mesh; give the labels it was made from", param_hint="--within")
        pp.write_mesh(output, pp.read_mesh(labels))
        typer.echo(f"wrote {output}")
        return
    if wall is not None and (inclusion or fine or interior or within or closed_at_border or smooth or keep_voids):
        raise typer.BadParameter("takes --label and --edge alone", param_hint="--wall")
    finer: dict[int | str, float] = dict(_label_and_number("--fine", text, "length in mm") for text in fine or [])
    ratios: dict[int | str, float] = dict(_label_and_number("--stiffer", text, "ratio") for text in stiffer or [])
    length = 4.0 if edge is None else edge
    if is_surface(labels):
        stored = pp.read_surfaces(labels, length, [Path(name) for name in inclusion or []])
        label, inclusion = "1", [str(number) for number in sorted(stored.names)[1:]]
    elif label is None:
        raise typer.BadParameter("which of the labels is the organ, by name or number", param_hint="--label")
    else:
        stored = with_names(pp.read_labels(labels), labels, names)
    options: dict[str, Any] = {
        "inclusions": inclusion or [],
        "fine": finer,
        "interior": interior,
        "keep": "all" if keep_all else _part(keep),
        "fill_holes": not keep_voids,
        "closed_at_border": closed_at_border,
        "smooth": smooth,
        "most_lost": most_lost,
        "finer_where_thin": finer_where_thin,
        "mesher": mesher,
    }
    made = None
    with warnings.catch_warnings(record=True) as said, progress() as say:
        warnings.simplefilter("always", UserWarning)
        if wall is not None:
            say(f"meshing the wall of {label}", 0.0)
            mesh = pp.hollow_mesh(stored, label, wall, edge)
            say(f"meshing the wall of {label}", 1.0)
        elif within is None:
            say(f"meshing {label}", 0.0)
            mesh = pp.tetrahedralize(stored, label, length, **options)
            say(f"meshing {label}", 1.0)
        else:
            judged = {"poisson": poisson, "stiffer": ratios, "rest_on": numbers("--rest-on", rest_on)}
            options |= judged | {"most_tets": most_tets, "progress": say}
            made = pp.adaptive_mesh(stored, label, within / 100, length, radius, **options)
            mesh = made.mesh
    for warning in said:  # once the line of progress is gone
        warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
    pp.write_mesh(output, mesh)
    typer.echo(str(pp.mesh_quality(mesh, stored if wall is None else None)))
    if made is not None:
        typer.echo(option_names(made.text()))
        typer.echo(f"fit and touch it with this radius: --radius {made.error.radius:.3g}")
        if error_map is not None:
            write_error_map(error_map, made.error, 100 * made.within)
    typer.echo(f"wrote {output}")


def mesh_every(labels: Path, folder: Path, edge: float | None, names: Path | None, options: dict[str, Any]) -> None:
    """Meshes each label of a map into a folder, and writes a scene to complete. options: of `pp.tetrahedralize`."""
    import os

    from palpate.atomic_write import replacing
    from palpate.meshes.io import READ
    from palpate.meshes.surface_files import is_surface
    from palpate.tissue.scene_file import scene_text
    from palpate.volumes.label_names import with_names

    if labels.suffix.lower() in READ or is_surface(labels):
        raise typer.BadParameter(f"{labels} has no labels; give a label map", param_hint="--all")
    stored = with_names(pp.read_labels(labels), labels, names)
    with progress() as say:
        made = pp.mesh_labels(stored, folder, edge, progress=say, **options)
    if not any(one.file for one in made):
        raise pp.errors.MeshError(f"{labels}: none of {len(made)} labels could be meshed; the first: {made[0].problem}")
    for one in made:
        told = f"{one.nodes:,} nodes, edge {one.edge:.2g} mm, {one.volume / 1000:.3g} ml" if one.file else one.problem
        typer.echo(f"{one.name}: {told}")
    scene = folder / "scene.yaml"
    if scene.exists():
        typer.echo(f"kept {scene}, which was there")
    else:
        with replacing(scene) as temporary:
            temporary.write_text(scene_text(Path(os.path.relpath(labels, folder)).as_posix(), made))
        typer.echo(f"wrote {scene}: complete it, then palpate scene {scene} -o scene.vtu")
    typer.echo(f"wrote {sum(1 for one in made if one.file)} of {len(made)} labels to {folder}")


def _part(text: str) -> str | int | list[float]:
    """A word, a rank, or a point."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return text
    return int(numbers[0]) if len(numbers) == 1 and numbers[0].is_integer() else numbers


def _label_and_number(option: str, text: str, what: str) -> tuple[str, float]:
    name, _, number = text.rpartition("=")
    try:
        return name, float(number)
    except ValueError:
        raise typer.BadParameter(f"{option} {text}: expected a label and a {what}, such as lump=1.5") from None
