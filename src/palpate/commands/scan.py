"""`palpate scan import|correct|calibrate|check|simulate|template`: where every reconstruction starts."""

import shlex
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.findings import warn
from palpate.commands.progress import doing
from palpate.commands.scan_calibrate import calibrate_command

MEANING = "Scan files: import, correct, calibrate, check, simulate, or a geometry template."
PICTURES = (".png", ".svg", ".pdf")
FOUND = 3  # exit code of `palpate scan check` where something is wrong
scan_app = typer.Typer(
    no_args_is_help=True,
    help=f"Example: [bold]palpate scan import breast -o breast.h5[/bold]\n\n{MEANING}",
)


Motion = StrEnum("Motion", "arc rotating circular linear hypocycloid orbit parallel free")
PhantomName = StrEnum("PhantomName", "slab breast")


def add(app: typer.Typer) -> None:
    """Adds the commands to `app`."""
    app.add_typer(scan_app, name="scan", short_help=MEANING)


@scan_app.command("import", short_help="Imports a stack of projections.")
def import_command(
    stack: Annotated[Path, typer.Argument(help="A file, a folder, a 'pattern*.tif', or a sample: breast, head.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Scan to write: a file (.h5), or a folder (.zarr).")],
    geometry: Annotated[Path | None, typer.Option(help="Geometry file; palpate scan template writes one.")] = None,
    check: Annotated[bool, typer.Option(help="Look for mistakes in geometry and counts, and warn.")] = True,
) -> None:
    """Example: [bold]palpate scan import breast -o breast.h5[/bold]

    Imports a stack of projections.

    DICOM projections (a file, or a folder) tell their geometry.
    Your own: palpate scan template -o geometry.yaml, fill it in, then
    palpate scan import 'views/*.tif' --geometry geometry.yaml -o scan.h5
    """
    from palpate.scans.dicom_projections import MEANING as DICOM_MEANING
    from palpate.scans.dicom_projections import is_dicom_stack
    from palpate.scans.importers import geometry_of
    from palpate.scans.io import writable_scan

    writable_scan(output)
    dicom = is_dicom_stack(stack) and geometry is None
    meaning = None if dicom else geometry_of(str(stack), geometry)
    with doing(f"importing {stack.name}"):
        scan = pp.import_scan(str(stack), meaning)
    pp.write_scan(output, scan)
    _print_summary(output, scan)
    if dicom:
        typer.echo(DICOM_MEANING)
    if meaning is None or meaning.values == "intensity":
        words = shlex.join(["palpate", "reconstruct", str(output), "-o", "volume.nii.gz"])
        typer.echo(f"these are intensities, not photon counts: {words} --thickness MM --likelihood least-squares")
    if check:
        warn(pp.check_scan(scan))


@scan_app.command("correct", short_help="Makes a scan of what a panel read: dark, flat, bad pixels, gain, lag, dose.")
def correct_command(
    raw: Annotated[Path, typer.Argument(help="Raw views: a file, a folder, or a 'pattern*.tif'.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Scan to write: a file (.h5), or a folder (.zarr).")],
    geometry: Annotated[Path | None, typer.Option(help="Geometry file; palpate scan template writes one.")] = None,
    dark: Annotated[
        str | None, typer.Option(help="Frames without beam, or a number: 0 for a panel without offset.")
    ] = None,
    flat: Annotated[str | None, typer.Option(help="Frames with the beam and no object; a stack is averaged.")] = None,
    gain: Annotated[
        str | None, typer.Option(help="Digital units a photon: a number or an image. None: from the flats' noise.")
    ] = None,
    lag: Annotated[
        str | None, typer.Option(help="0.03, amplitude:decay pairs 0.02:0.4,0.01:0.9, or frames of after-glow.")
    ] = None,
    dose: Annotated[
        str | None, typer.Option(help="Readings of a dosimeter, lines view,reading and flat,reading; or air.")
    ] = None,
    offset: Annotated[
        str | None, typer.Option(help="Digital units above the dark: a number, or lines view,number.")
    ] = None,
    electronic: Annotated[
        float | None, typer.Option(help="Read-out noise, digital units. None: from the dark's frames.")
    ] = None,
    bad_pixels: Annotated[
        Path | None, typer.Option(help="Known bad pixels: an image that is not 0 there, or a text.")
    ] = None,
    dark_by_view: Annotated[
        bool, typer.Option(help="Each frame of the dark belongs to the view of its number.")
    ] = False,
    flat_by_view: Annotated[
        bool, typer.Option(help="Each frame of the flat belongs to the view of its number.")
    ] = False,
    flat_view: Annotated[int | None, typer.Option(help="View that has the tube where it was for the flat.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of before and after (.png, .svg).")] = None,
    check: Annotated[bool, typer.Option(help="Refuse a flat that does not fit the views, and check the scan.")] = True,
) -> None:
    """Example: [bold]palpate scan correct raw/ -o scan.h5 --geometry g.yaml --dark dark.tif --flat flat.tif[/bold]

    Makes a scan of what a panel read.

    Counts are photons. Bad pixels and lines are masked, not filled.
    docs/raw-detector.md tells what is done, and what is refused.
    """
    from palpate.atomic_write import replacing, writable
    from palpate.commands.raw_inputs import raw_inputs
    from palpate.errors import DataError
    from palpate.scans.io import writable_scan

    writable_scan(output)
    if plot is not None:
        writable(plot)
        if plot.suffix.lower() not in PICTURES:
            raise DataError(f"plot: {plot} is no {', '.join(PICTURES)}; choose one of these suffixes")
    with doing(f"reading {raw.name}"):
        read, views, given = raw_inputs(raw, geometry, dark, flat, gain, lag, dose, offset, bad_pixels)
    with doing(f"correcting {len(views)} views"):
        done = pp.correct_scan(
            read,
            views,
            electronic=electronic,
            dark_by_view=dark_by_view,
            flat_by_view=flat_by_view,
            flat_view=flat_view,
            check=check,
            **given,
        )
    pp.write_scan(output, done.scan)
    _print_summary(output, done.scan)
    for line in done.notes:
        typer.echo(f"  {line}")
    if plot is not None:
        figure = pp.plot_correction(read, done)
        with replacing(plot) as temporary:
            figure.savefig(temporary, format=plot.suffix.lstrip(".").lower() or "png")
        typer.echo(f"{plot}: before and after")
    if check:
        warn(pp.check_scan(done.scan))


scan_app.command("calibrate", short_help="Finds the geometry from a phantom of balls at known places.")(
    calibrate_command
)


@scan_app.command("check", short_help="Looks for mistakes in geometry, counts and grid.")
def check_command(
    scan: Annotated[Path, typer.Argument(help="Scan (.h5, .zarr); palpate scan import makes one.", show_default=False)],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Picture of geometry and verdict (.png, .svg).")
    ] = None,
    thickness: Annotated[float | None, typer.Option(help="Depth of the object from the panel up, mm.")] = None,
    like: Annotated[Path | None, typer.Option(help="Volume file whose grid is to be reconstructed.")] = None,
    volume: Annotated[Path | None, typer.Option(help="A reconstructed volume: is it what the views show?")] = None,
    attenuation: Annotated[str, typer.Option(help="Least and largest of the dense part, 1/mm.")] = "0.005,0.1",
) -> None:
    """Example: [bold]palpate scan check breast.h5 --thickness 51.2 -o check.png[/bold]

    Looks for mistakes in geometry, counts and grid.

    The exit code is 3 if something is wrong. docs/scan-check.md tells
    what the data cannot show.
    """
    from palpate.atomic_write import replacing, writable
    from palpate.commands.reconstruct import numbers_in
    from palpate.errors import DataError

    if output is not None:
        writable(output)
    limits = numbers_in(attenuation)
    if len(limits) != 2:
        raise DataError(f"attenuation: expected two numbers least,largest in 1/mm, got {attenuation!r}")
    measured = pp.read_scan(scan)
    found_volume = pp.read_volume(volume) if volume else None
    grid = pp.read_volume(like).grid if like else found_volume.grid if found_volume else None
    if grid is None and thickness is not None:
        grid = pp.covering_grid(measured.views, thickness)
    found = pp.check_scan(measured, grid, attenuation=(limits[0], limits[1]))
    left = pp.residuals(measured, found_volume) if found_volume else None
    if left is not None:
        found += pp.check_residuals(left)
        typer.echo("deviance a pixel of each view: " + ", ".join(f"{d:.3g}" for d in left.deviance))
    for number, finding in enumerate(found, 1):
        typer.echo(f"{number}. {'' if finding.alarm else '(note) '}{finding}")
    if not any(finding.alarm for finding in found):
        typer.echo(f"{scan}: the views agree with one object" + (" in the grid" if grid else ""))
    if output is not None:
        figure = pp.plot_check(measured, found, grid, left)
        with replacing(output) as temporary:
            figure.savefig(temporary, format=output.suffix.lstrip(".").lower() or "png")
        typer.echo(f"{output}: geometry and verdict")
    if any(finding.alarm for finding in found):
        raise typer.Exit(FOUND)


@scan_app.command("simulate", short_help="Simulates a scan of a phantom whose shadow is known exactly.")
def simulate_command(
    output: Annotated[Path, typer.Option("-o", "--output", help="Scan to write: a file (.h5), or a folder (.zarr).")],
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
    from palpate.scans.io import writable_scan
    from palpate.scans.simulate import standard_views
    from palpate.volumes.io import writable_volume

    writable_scan(output)
    if truth is not None:
        writable_volume(truth)
    geometry = standard_views(motion.value, views, pixels, pitch, distance, extent, angle)
    solid = pp.slab_phantom() if phantom is PhantomName.slab else pp.breast_phantom()
    with doing(f"simulating {views} views"):
        scan = pp.simulate_scan(solid, geometry, incident, seed if noise else None, background)
    pp.write_scan(output, scan)
    if truth is not None:
        pp.write_volume(truth, solid.volume(solid.grid(1.0)))
    _print_summary(output, scan)


@scan_app.command("template", short_help="Writes a commented geometry file to fill in.")
def template_command(
    motion: Annotated[Motion, typer.Option(help="How your tube moves; free lists each view by itself.")] = Motion.arc,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="File to write; none: the screen.")] = None,
) -> None:
    """Example: [bold]palpate scan template --motion arc -o geometry.yaml[/bold]

    Writes a commented geometry file to fill in.
    """
    from palpate.atomic_write import replacing
    from palpate.scans.geometry_template import template

    text = template(motion.value)
    if output is None:
        typer.echo(text, nl=False)
        return
    with replacing(output) as temporary:
        temporary.write_text(text, encoding="utf-8")
    words = shlex.join(["palpate", "scan", "import", "STACK", "--geometry", str(output), "-o", "scan.h5"])
    typer.echo(f"{output}: fill it in, then: {words}")


def _print_summary(output: Path, scan: "pp.Scan") -> None:
    views, rows, columns = scan.shape
    low, high = float(scan.incident.min()), float(scan.incident.max())
    beam = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    typer.echo(
        f"{output}: {views} views of {rows} x {columns} pixels, {scan.mask.mean():.1%} measured, incident {beam}"
    )
