"""`palpate scan calibrate`: the geometry of a scan from a phantom of balls at known places."""

from pathlib import Path
from typing import Annotated

import typer

import palpate as pp
from palpate.commands.progress import progress

MORE = 3.0  # times the noise: residuals above that have another cause
PICTURES = (".png", ".svg", ".pdf")


def calibrate_command(
    scan: Annotated[Path, typer.Argument(help="Scan file (.h5) of the phantom, with the geometry to start from.")],
    balls: Annotated[Path, typer.Option(help="Table of the balls: columns x,y,z and perhaps diameter, mm.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Geometry file to write (.yaml).")],
    diameter: Annotated[float | None, typer.Option(help="Of all balls, mm, if the table has none.")] = None,
    rigid: Annotated[
        bool, typer.Option(help="The tube turns about one axis, with the panel or above a still one: 14 numbers.")
    ] = False,
    still_panel: Annotated[
        bool | None,
        typer.Option("--still-panel/--moving-panel", help="One panel for all views. Default: as the start says."),
    ] = None,
    geometry: Annotated[
        Path | None, typer.Option(help="Geometry file whose other lines (stack, incident) are kept.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Picture of balls and residuals (.png, .svg).")] = None,
) -> None:
    """Example: [bold]palpate scan calibrate balls.h5 --balls balls.csv -o geometry.yaml[/bold]

    Finds where focal spots and panels are, from a phantom of balls at known places.

    The start may be off by 2 % of the distances, tilts of 1 degree and
    2 degrees of arc. docs/geometry.md tells what the balls cannot show.
    """
    import numpy as np

    from palpate.atomic_write import replacing, writable
    from palpate.errors import DataError

    writable(output)
    if plot is not None:
        writable(plot)
        if plot.suffix.lower() not in PICTURES:
            raise DataError(f"plot: {plot} is no {', '.join(PICTURES)}; choose one of these suffixes")
    if geometry is not None:
        pp.read_geometry(geometry)
    places = pp.read_balls(balls)
    seen = pp.read_scan(scan)
    with progress() as say:
        found = pp.calibrate_from_balls(
            seen, places, diameter=diameter, rigid=rigid, still_panel=still_panel, progress=say
        )
    used = np.asarray(np.isfinite(found.residuals).all(axis=2))
    rest, noise = (float(np.sqrt(np.nanmean(a**2))) for a in (found.residuals, found.noise))
    pp.write_geometry(output, found.views, geometry)
    typer.echo(
        f"{output}: {used.sum()} shadows of {len(places)} balls in {len(used)} views, {rest:.3f} pixels RMS left "
        f"(by their noise {noise:.3f})"
    )
    if rest > MORE * noise:
        typer.echo(
            "  more is left than noise explains: check the table of the balls" + " or fit without --rigid" * rigid
        )
    for words in _summary(found):
        typer.echo(f"  {words}")
    if plot is not None:
        figure = pp.plot_ball_calibration(seen, places, found)
        with replacing(plot) as temporary:
            figure.savefig(temporary, format=plot.suffix.lstrip(".").lower())
        typer.echo(f"{plot}: balls and residuals")
    if found.undetermined:
        typer.echo("The balls do not tell the following; it is as it was in the start:")
        for words in found.undetermined:
            typer.echo(f"  {words}")


def _summary(found: "pp.BallCalibration") -> list[str]:
    """A line for each number that was fitted; of numbers for each view, the largest change and deviation of all views."""
    kinds: dict[str, list[int]] = {}
    for i, name in enumerate(found.names):
        kinds.setdefault(name.split(": ", 1)[-1], []).append(i)
    lines = []
    for name, all_views in kinds.items():
        what, unit = name.rsplit(", ", 1)
        change, deviation = found.changes[all_views], found.deviations[all_views]
        if len(all_views) == 1:
            lines.append(f"{what}: {change[0]:+.3f} ± {deviation[0]:.2g} {unit}")
        else:
            lines.append(f"{what}: {change.min():+.3f} to {change.max():+.3f}, ± up to {deviation.max():.2g} {unit}")
    return [line.replace("± inf", "undetermined,").replace("± up to inf", "undetermined,") for line in lines]
