"""`palpate scan import|simulate|template`: where every reconstruction starts."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

import palpate as pp

MEANING = "Scan files: import, simulate, or a geometry template."
scan_app = typer.Typer(
    no_args_is_help=True,
    help=f"Example: [bold]palpate scan import breast -o breast.h5[/bold]\n\n{MEANING}",
)


class Motion(StrEnum):
    """How the tube moves."""

    arc = "arc"
    rotating = "rotating"
    circular = "circular"
    linear = "linear"
    hypocycloid = "hypocycloid"
    free = "free"


class PhantomName(StrEnum):
    """Analytic phantoms."""

    slab = "slab"
    breast = "breast"


def add(app: typer.Typer) -> None:
    """Adds the commands to `app`."""
    app.add_typer(scan_app, name="scan", short_help=MEANING)


@scan_app.command("import", short_help="Imports a stack of projections.")
def import_command(
    stack: Annotated[Path, typer.Argument(help="A file, a folder, a 'pattern*.tif', or a sample: breast, head.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Scan file to write (.h5).")],
    geometry: Annotated[Path | None, typer.Option(help="Geometry file; palpate scan template writes one.")] = None,
) -> None:
    """Example: [bold]palpate scan import breast -o breast.h5[/bold]

    Imports a stack of projections.

    DICOM projections (a file, or a folder) tell their geometry.
    Your own: palpate scan template -o geometry.yaml, fill it in, then
    palpate scan import 'views/*.tif' --geometry geometry.yaml -o scan.h5
    """
    from palpate.atomic import writable
    from palpate.scans.dicom import MEANING as DICOM_MEANING
    from palpate.scans.dicom import is_dicom_stack
    from palpate.scans.importers import geometry_of

    writable(output)
    dicom = is_dicom_stack(stack) and geometry is None
    meaning = None if dicom else geometry_of(str(stack), geometry)
    scan = pp.import_scan(str(stack), meaning)
    pp.write_scan(output, scan)
    _tell(output, scan)
    if dicom:
        typer.echo(DICOM_MEANING)
    if meaning is None or meaning.values == "intensity":
        typer.echo("these are intensities, not photon counts: palpate reconstruct --likelihood least-squares")


@scan_app.command("simulate", short_help="Simulates a scan of a phantom whose shadow is known exactly.")
def simulate_command(
    output: Annotated[Path, typer.Option("-o", "--output", help="Scan file to write (.h5).")],
    phantom: Annotated[PhantomName, typer.Option(help="What is in the beam.")] = PhantomName.slab,
    motion: Annotated[Motion, typer.Option(help="How the tube moves.")] = Motion.circular,
    views: Annotated[int, typer.Option(help="Number of projections.")] = 8,
    incident: Annotated[float, typer.Option(help="Photons a pixel with nothing in the beam.")] = 20000,
    background: Annotated[float, typer.Option(help="Scattered and dark counts a pixel.")] = 0,
    seed: Annotated[int, typer.Option(help="The same seed gives the same counts.")] = 1,
    noise: Annotated[bool, typer.Option(help="Poisson noise, or the expected counts themselves.")] = True,
    pixels: Annotated[tuple[int, int], typer.Option(help="Rows and columns of the panel.")] = (512, 512),
    pitch: Annotated[float, typer.Option(help="Pixel pitch, mm.")] = 0.4,
    distance: Annotated[float, typer.Option(help="Tube above the panel, mm.")] = 1000,
    extent: Annotated[float, typer.Option(help="Radius of the circle, or length of the line, mm.")] = 250,
    angle: Annotated[float, typer.Option(help="Half the range of an arc or rotation, degrees.")] = 20,
    truth: Annotated[Path | None, typer.Option(help="Also write the phantom itself, 1 mm voxels, here.")] = None,
) -> None:
    """Example: [bold]palpate scan simulate --motion circular --views 8 --incident 20000 --seed 1 -o scan.h5[/bold]

    Simulates a scan of a phantom whose shadow is known exactly.
    """
    from palpate.atomic import writable
    from palpate.scans.simulate import standard_views
    from palpate.volumes.files import writable_volume

    writable(output)
    if truth is not None:
        writable_volume(truth)
    geometry = standard_views(motion.value, views, pixels, pitch, distance, extent, angle)
    solid = pp.slab_phantom() if phantom is PhantomName.slab else pp.breast_phantom()
    scan = pp.simulate_scan(solid, geometry, incident, seed if noise else None, background)
    pp.write_scan(output, scan)
    if truth is not None:
        pp.write_volume(truth, solid.volume(solid.grid(1.0)))
    _tell(output, scan)


@scan_app.command("template", short_help="Writes a commented geometry file to fill in.")
def template_command(
    motion: Annotated[Motion, typer.Option(help="How your tube moves; free lists each view by itself.")] = Motion.arc,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="File to write; none: the screen.")] = None,
) -> None:
    """Example: [bold]palpate scan template --motion arc -o geometry.yaml[/bold]

    Writes a commented geometry file to fill in.
    """
    from palpate.atomic import replacing
    from palpate.scans.template import template

    text = template(motion.value)
    if output is None:
        typer.echo(text, nl=False)
        return
    with replacing(output) as temporary:
        temporary.write_text(text, encoding="utf-8")
    typer.echo(f"{output}: fill it in, then: palpate scan import STACK --geometry {output} -o scan.h5")


def _tell(output: Path, scan: "pp.Scan") -> None:
    views, rows, columns = scan.shape
    low, high = float(scan.incident.min()), float(scan.incident.max())
    beam = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    typer.echo(
        f"{output}: {views} views of {rows} x {columns} pixels, {scan.mask.mean():.1%} measured, incident {beam}"
    )
