"""`palpate fit`."""

import shlex
from math import exp
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import palpate as pp
from palpate.commands.by_region import by_region
from palpate.commands.progress import doing, progress

if TYPE_CHECKING:
    from palpate.tissue.force_error_map import ForceErrorMap
    from palpate.tissue.tissue import Constant

P1_NOTE = "{}: this tissue has P1 elements, which are too stiff; run palpate fit again for smoothed ones"


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("fit", short_help="Gives a mesh stiffness and support, and fits springs to it.")(fit_command)


def list_tissues(wanted: bool) -> None:
    """Prints the table of tissues and ends."""
    if wanted:
        from palpate.tissue.named_tissues import tissue_list

        typer.echo(tissue_list())
        raise typer.Exit


def fit_command(
    mesh: Annotated[Path, typer.Argument(help="Mesh of tetrahedra: .vtu, .vtk or .msh.", show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", help="Tissue to write: .vtu.", show_default=False)],
    young: Annotated[float | None, typer.Option(help="Young's modulus, kPa.", show_default=False)] = None,
    poisson: Annotated[
        float | None, typer.Option(help="Poisson's ratio, from 0 to below 0.5. Default: the tissue's, else 0.45.")
    ] = None,
    tissue: Annotated[str | None, typer.Option(help="Constants of a named tissue: kidney. See --list-tissues.")] = None,
    rest_on: Annotated[
        str, typer.Option(help="Way to the table that holds it: x,y,z. Open ends of a hollow organ are held, too.")
    ] = "0,0,-1",
    depth: Annotated[
        float | None, typer.Option(help="Nodes so near the table are held, mm. Default: 10 % of the extent.")
    ] = None,
    region_young: Annotated[
        list[str] | None, typer.Option(help="Another modulus for a region, by name or number: lump=20")
    ] = None,
    young_spread: Annotated[
        float | None, typer.Option(help="One standard deviation of --young, kPa. Default: the tissue's.")
    ] = None,
    region_young_spread: Annotated[list[str] | None, typer.Option(help="Another spread: lump=10")] = None,
    region_poisson: Annotated[list[str] | None, typer.Option(help="Another Poisson's ratio: lump=0.4")] = None,
    region_tissue: Annotated[list[str] | None, typer.Option(help="Another tissue: lump=liver-carcinoma")] = None,
    stiffness: Annotated[
        Path | None, typer.Option(help="Map of the stiffness, kPa, instead of --young: .nii.gz, .nrrd, .mha.")
    ] = None,
    quantity: Annotated[str | None, typer.Option(help="What the map holds: shear (MR elastography), young.")] = None,
    relaxation: Annotated[
        str | None, typer.Option(help="share@seconds of the instantaneous stiffness, which relax: 0.3@0.1,0.2@2")
    ] = None,
    region_relaxation: Annotated[list[str] | None, typer.Option(help="Another relaxation: lump=0.5@0.2")] = None,
    bulk: Annotated[
        bool, typer.Option("--bulk/--no-bulk", help="Whether the bulk modulus relaxes as the shear modulus does.")
    ] = True,
    inertia: Annotated[
        float | None, typer.Option(help="Damping ratio of the swings of a tissue that has mass: 0.05")
    ] = None,
    density: Annotated[
        float | None, typer.Option(help="For --inertia, kg/m³. Default: 1060.", show_default=False)
    ] = None,
    stiffening: Annotated[
        float, typer.Option(help="Exponent with which --model neo-hookean stiffens with stretch: 5. 0: it does not.")
    ] = 0.0,
    region_stiffening: Annotated[list[str] | None, typer.Option(help="Another exponent: lump=10")] = None,
    surface_friction: Annotated[
        float, typer.Option(help="Coulomb's coefficient of the lips of cuts on each other: 0.1", show_default=False)
    ] = 0.0,
    law: Annotated[str, typer.Option(help="Of the home springs: uniform, linear, exponential.")] = "exponential",
    element: Annotated[str, typer.Option(help="smoothed; P1: too stiff; P2, mixed: for springs alone.")] = "smoothed",
    within: Annotated[
        float | None, typer.Option(help="Also find the model whose worst node is off by no more, mm.")
    ] = None,
    force_within: Annotated[float, typer.Option(help="And whose force is off by no more, %.")] = 5.0,
    up_to: Annotated[float, typer.Option(help="For pushes so deep, mm.")] = 10.0,
    radius: Annotated[
        float | None, typer.Option(help="Of the contacts in all this, mm. Default: two mean edges.", show_default=False)
    ] = None,
    error_map: Annotated[
        Path | None,
        typer.Option(
            "--map", help="Picture of where the mesh is too coarse for the force: .png, .svg.", show_default=False
        ),
    ] = None,
    show_tissues: Annotated[
        bool, typer.Option("--list-tissues", help="Print the named tissues.", callback=list_tissues, is_eager=True)
    ] = False,
) -> None:
    """Example: [bold]palpate fit kidney.vtu --young 15 --rest-on 0,1,0 --depth 12 -o tissue.vtu[/bold]

    Gives a mesh stiffness and support, and says which model palpate touch
    begins with. Fits springs too, and says how far they are off. In a CT, 0,1,0 is the way to the back.

    Which model is needed for 0.3 mm and 5 % of force in pushes of 10 mm:
    palpate fit kidney.vtu --young 15 --within 0.3 -o tissue.vtu

    Where the mesh is too coarse for that force:
    palpate fit kidney.vtu --young 15 --map map.png -o tissue.vtu

    With a stiff lump:
    palpate fit breast.vtu --young 3.25 --region-young lump=42.5 -o tissue.vtu

    With constants from the literature, and from an elastogram:
    palpate fit liver.vtu --tissue liver --region-tissue lump=liver-carcinoma -o tissue.vtu
    palpate fit liver.vtu --stiffness elastogram.nii.gz --quantity shear -o tissue.vtu

    A lump of which the stiffness is known to some 30 kPa: the page tells what that makes of the force:
    palpate fit breast.vtu --young 3 --region-young lump=90 --region-young-spread lump=30 -o tissue.vtu

    Half of the stiffness just after a push relaxes within a second:
    palpate fit liver.vtu --young 3 --relaxation 0.3@0.1,0.2@1 -o tissue.vtu

    A lump alone relaxes, and only in shear:
    palpate fit breast.vtu --young 3 --region-relaxation lump=0.5@0.2 --no-bulk -o tissue.vtu

    With mass, so that it swings when it is let go:
    palpate fit liver.vtu --young 3 --inertia 0.05 -o tissue.vtu

    Stiffer the further it is stretched, for palpate touch --model neo-hookean:
    palpate fit liver.vtu --young 3 --stiffening 5 -o tissue.vtu
    """
    from palpate.atomic_write import writable
    from palpate.errors import FileError
    from palpate.simulation.starting_model import starting_model
    from palpate.tissue.named_tissues import material_lines
    from palpate.tissue.tissue import check_surface_friction

    writable(output)
    check_surface_friction(surface_friction)
    if radius is not None and not radius > 0:
        raise typer.BadParameter(f"{radius:g} mm; give the radius of the contacts, above 0", param_hint="--radius")
    if error_map is not None:
        writable(error_map)
    if output.suffix.lower() != ".vtu":
        raise FileError(f"{output}: tissue is written as .vtu; name it so")
    relaxing: dict[int | str, pp.Relaxation] = {}
    swinging = _inertia(inertia, density)
    solid = pp.read_mesh(mesh)
    for region, text in by_region(solid, "--region-relaxation", str, relaxation, region_relaxation).items():
        relaxing[region] = pp.Relaxation.parse(text, bulk)
    if not bulk and not relaxing:
        raise typer.BadParameter("says what does not relax; give --relaxation, too", param_hint="--no-bulk")
    kinds = by_region(solid, "--region-tissue", str, tissue, region_tissue)
    nu = by_region(solid, "--region-poisson", float, poisson, region_poisson)
    E: Constant = by_region(solid, "--region-young", float, young, region_young, region_tissue)
    spread = by_region(solid, "--region-young-spread", float, young_spread, region_young_spread)
    b = by_region(solid, "--region-stiffening", float, stiffening, region_stiffening)
    if stiffness is not None or quantity is not None:
        E = _from_map(solid, stiffness, quantity, E, nu, kinds)
    resting = pp.resting_on(solid, numbers("--rest-on", rest_on), depth)
    fixed = sorted({*resting.tolist(), *pp.fixed_at_openings(solid).tolist()})
    with progress() as say:
        fitted = pp.fit(
            solid,
            E,
            nu,
            fixed,
            law=law,
            element=element,
            radius=radius,
            progress=say,
            tissue=kinds,
            relaxation=relaxing or None,
            inertia=swinging,
            stiffening=b,
            young_spread=spread or None,
        ).replace(surface_friction=surface_friction)
    pp.write_tissue(output, fitted)
    with doing("trying models"):
        begin = starting_model(fitted, radius)
    if element == "P1":
        typer.echo(P1_NOTE.format(output))
    typer.echo(f"palpate touch {shlex.quote(str(output))} begins with {begin.reason}")
    for line in material_lines(fitted):
        typer.echo(line)
    if fitted.young_spread.any():
        typer.echo(_spread_text(fitted))
    for line in _relaxation_lines(fitted):
        typer.echo(line)
    if swinging is not None:
        typer.echo(f"inertia: {swinging.density:g} kg/m³, damping ratio {swinging.damping:g}, {swinging.modes} modes")
    if fitted.stiffening.any():
        typer.echo(_stiffening_text(fitted.stiffening.max()))
    assert fitted.report is not None
    typer.echo(fitted.report.text())
    coarseness = None
    if within is not None:
        with progress() as say:
            found = pp.select_model(fitted, within, force_within / 100, up_to, radius, progress=say)
        typer.echo(found.text())
        coarseness = found.mesh
        if coarseness is not None and found.too_coarse:
            typer.echo(_finer_mesh(coarseness, force_within))
    if error_map is not None:
        if coarseness is None:
            with progress() as say:
                coarseness = pp.force_error_map(fitted, radius, progress=say)
        write_error_map(error_map, coarseness, force_within)
    typer.echo(f"{len(solid.nodes)} nodes, {len(fitted.fixed)} held; wrote {output}")


def _relaxation_lines(tissue: "pp.Tissue") -> list[str]:
    """What the relaxation means, and how far the creep that a session follows is off."""
    from palpate.tissue.regional_relaxation import creep_of

    if tissue.relaxation is None:
        return []
    if isinstance(tissue.relaxation, pp.Relaxation):
        lines = [f"relaxation: {tissue.relaxation.text}"]
    else:
        names = tissue.mesh.names
        lines = [f"relaxation of {names.get(r, f'region {r}')}: {one.text}" for r, one in tissue.relaxations.items()]
    if not tissue.relaxes_alike:
        creep = creep_of(tissue.relaxations.values())
        lines.append(
            f"parts relax differently: {len(creep.times)} creep times are followed, from {len(creep.samples)} "
            f"factorizations; of what creeps at most {creep.error:.1%} is off"
        )
    return lines


def _spread_text(tissue: "pp.Tissue") -> str:
    """Where the stiffness is known to a spread alone."""
    import numpy as np

    known, names = [], tissue.mesh.names
    for region in np.unique(tissue.mesh.region).tolist():
        inside = tissue.mesh.region == region
        young, spread = (float(np.median(values[inside])) for values in (tissue.young, tissue.young_spread))
        if spread > 0:
            known.append(f"{names.get(region, f'region {region}')} {young:g} ± {spread:g} kPa")
    return f"stiffness, one standard deviation: {', '.join(known)}; the page tells what that makes of the force"


def _stiffening_text(most: float) -> str:
    stretch = 1.2
    growth = exp(most * (stretch**2 + 2 / stretch - 3))
    return (
        f"stiffening: exponent up to {most:g}: at a stretch of {stretch:g} the stress is {growth:.3g} times that of a tissue "
        f"that does not stiffen. The model neo-hookean and the error of linear strain follow it, linear models do not"
    )


def write_error_map(path: Path, found: "ForceErrorMap", percent: float) -> None:
    """Draws the map, red where the estimate is too near to `percent` % of the force."""
    from palpate.atomic_write import replacing

    figure = pp.plot_force_error(found, percent / 100)
    with replacing(path) as temporary:
        figure.savefig(temporary, format=path.suffix.lstrip(".").lower() or "png", dpi=150)
    typer.echo(f"{path}: {found.text()}")


def _finer_mesh(found: "ForceErrorMap", percent: float) -> str:
    """What to do about a mesh that makes a larger error than `percent` % of the force: 0.6 of it leaves room for a model."""
    import numpy as np

    tissue = found.tissue
    young = {int(r): float(tissue.young[tissue.mesh.region == r].mean()) for r in np.unique(tissue.mesh.region)}
    base = max(young, key=lambda r: int((tissue.mesh.region == r).sum()))
    words = ["palpate", "mesh", "LABELS", "--within", f"{0.6 * percent:.2g}", "--radius", f"{found.radius:.3g}"]
    words += ["--poisson", f"{tissue.poisson.max():.4g}"]
    for region in set(young) - {base}:
        name = tissue.mesh.names.get(region, str(region))
        words += ["--inclusion", name, "--stiffer", f"{name}={young[region] / young[base]:.3g}"]
    return f"the mesh alone may be off by more than {percent:g} % of force; make a finer one: {shlex.join(words)}"


def _inertia(damping: float | None, density: float | None) -> "pp.Inertia | None":
    if damping is None:
        if density is not None:
            raise typer.BadParameter(
                "mass alone does nothing; give --inertia, the damping ratio, too", param_hint="--density"
            )
        return None
    return pp.Inertia(damping) if density is None else pp.Inertia(damping, density)


def numbers(option: str, text: str) -> list[float]:
    """Three numbers from x,y,z."""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if len(found) != 3:
        raise typer.BadParameter(f"{text!r}: give three numbers, such as 0,0,-1", param_hint=option)
    return found


def _from_map(
    mesh: "pp.TetMesh",
    stiffness: Path | None,
    quantity: str | None,
    young: "Constant",
    poisson: dict[int | str, float],
    tissue: dict[int | str, str],
) -> "Constant":
    """Young's modulus of each tet from a map, which is then the only thing that gives it."""
    import numpy as np

    if stiffness is None:
        raise typer.BadParameter("says what a map holds; give the map with --stiffness", param_hint="--quantity")
    if young:
        hint = "the map gives Young's modulus; leave out --young and --region-young"
        raise typer.BadParameter(hint, param_hint="--stiffness")
    volume = pp.read_volume(stiffness, unit="kPa")
    E = pp.stiffness_from_map(mesh, volume, quantity or "", poisson, tissue)
    typer.echo(
        f"Young's modulus {E.min():.3g} to {E.max():.3g} kPa, median {np.median(E):.3g}, from {stiffness}. MR elastography "
        f"vibrates at 40 to 60 Hz most often: tissue is stiffer there than under a slow press."
    )
    return E
