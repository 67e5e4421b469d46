"""`palpate fit`."""

import shlex
from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.progress import doing, progress

P1_NOTE = "{}: this tissue has P1 elements, which are too stiff; run palpate fit again for smoothed ones"


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("fit", short_help="Gives a mesh stiffness and support, and fits springs to it.")(fit_command)


def fit_command(
    mesh: Annotated[Path, typer.Argument(help="Mesh of tetrahedra: .vtu, .vtk or .msh.", show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", help="Tissue to write: .vtu.", show_default=False)],
    young: Annotated[float, typer.Option(help="Young's modulus, kPa.", show_default=False)],
    poisson: Annotated[float, typer.Option(help="Poisson's ratio, from 0 to below 0.5.")] = 0.45,
    rest_on: Annotated[str, typer.Option(help="Way to the table that holds it: x,y,z.")] = "0,0,-1",
    depth: Annotated[
        float | None, typer.Option(help="Nodes so near the table are held, mm. Default: 10 % of the extent.")
    ] = None,
    region_young: Annotated[
        list[str] | None, typer.Option(help="Another modulus for a region, by name or number: lump=20")
    ] = None,
    region_poisson: Annotated[list[str] | None, typer.Option(help="Another Poisson's ratio: lump=0.4")] = None,
    law: Annotated[str, typer.Option(help="Of the home springs: uniform, linear, exponential.")] = "exponential",
    element: Annotated[str, typer.Option(help="smoothed; P1: too stiff; P2, mixed: for springs alone.")] = "smoothed",
    within: Annotated[
        float | None, typer.Option(help="Also find the model whose worst node is off by no more, mm.")
    ] = None,
    force_within: Annotated[float, typer.Option(help="And whose force is off by no more, %.")] = 5.0,
    up_to: Annotated[float, typer.Option(help="For pushes so deep, mm.")] = 10.0,
) -> None:
    """Example: [bold]palpate fit kidney.vtu --young 15 --rest-on 0,1,0 --depth 12 -o tissue.vtu[/bold]

    Gives a mesh stiffness and support, and says which model palpate touch
    begins with. Fits springs too, and says how far they are off. In a CT, 0,1,0 is the way to the back.

    Which model is needed for 0.3 mm and 5 % of force in pushes of 10 mm:
    palpate fit kidney.vtu --young 15 --within 0.3 -o tissue.vtu

    With a stiff lump:
    palpate fit breast.vtu --young 3.25 --region-young lump=42.5 -o tissue.vtu
    """
    from palpate.atomic_write import writable
    from palpate.errors import FileError
    from palpate.simulation.starting_model import starting_model

    writable(output)
    if output.suffix.lower() != ".vtu":
        raise FileError(f"{output}: tissue is written as .vtu; name it so")
    solid = pp.read_mesh(mesh)
    regions = sorted(set(solid.region.tolist()))
    E = _by_region(solid.names, regions, "--region-young", young, region_young)
    nu = _by_region(solid.names, regions, "--region-poisson", poisson, region_poisson)
    fixed = pp.resting_on(solid, _numbers("--rest-on", rest_on), depth)
    with progress() as say:
        tissue = pp.fit(solid, E, nu, fixed, law=law, element=element, progress=say)
    pp.write_tissue(output, tissue)
    with doing("trying models"):
        begin = starting_model(tissue)
    if element == "P1":
        typer.echo(P1_NOTE.format(output))
    typer.echo(f"palpate touch {shlex.quote(str(output))} begins with {begin.reason}")
    assert tissue.report is not None
    typer.echo(tissue.report.text())
    if within is not None:
        with progress() as say:
            found = pp.select_model(tissue, within, force_within / 100, up_to, progress=say)
        typer.echo(found.text())
    typer.echo(f"{len(solid.nodes)} nodes, {len(tissue.fixed)} held; wrote {output}")


def _numbers(option: str, text: str) -> list[float]:
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3:
        raise typer.BadParameter(f"{text!r}: give three numbers, such as 0,0,-1", param_hint=option)
    return numbers


def _by_region(
    names: dict[int, str], regions: list[int], option: str, value: float, others: list[str] | None
) -> dict[int | str, float]:
    """One value for every region of the mesh, then those that `others` ("name=value") change."""
    values: dict[int | str, float] = dict.fromkeys(regions, value)
    numbers = {name: number for number, name in names.items()}
    for text in others or []:
        name, _, number = text.rpartition("=")
        try:
            region = numbers[name] if name in numbers else int(name)
            values[region] = float(number)
        except ValueError:
            known = ", ".join(f"{r} ({names[r]})" if r in names else str(r) for r in regions)
            hint = f"give region=value; the mesh has regions {known}"
            raise typer.BadParameter(f"{text!r}: {hint}", param_hint=option) from None
    return values
