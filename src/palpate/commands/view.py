"""`palpate view`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import palpate as pp

if TYPE_CHECKING:
    from palpate.scans.scan import Scan
    from palpate.volumes.volume import Volume


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("view", short_help="Opens slices or projections in the browser.")(view_command)


def view_command(
    file: Annotated[
        Path, typer.Argument(help="A volume (.nii.gz, .nrrd, .mha, DICOM ...) or a scan (.h5, DICOM projections).")
    ],
    other: Annotated[Path | None, typer.Argument(help="A second one of the same kind, to compare.")] = None,
    water: Annotated[
        float | None, typer.Option(help="Attenuation of water, 1/mm: values are then read in HU too.")
    ] = None,
    port: Annotated[
        int | None, typer.Option(help="On this machine's loopback. Default: a free one from 8765 on.")
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the page here, or only print its address.")] = True,
) -> None:
    """Example: [bold]palpate view volume.nii.gz[/bold]

    Look at a volume or a scan in the browser.

    A volume shows as three planes through a crosshair, with its value there,
    windows, thick slabs, profiles and a rendering; a scan as a cine loop of
    its projections. Two files are shown side by side, linked. Press ? in the
    page for the keys. The page is served to this machine only; the printed
    ssh line reaches it from another one. Ctrl-C ends it.
    """
    files = [file] if other is None else [file, other]
    pp.view(
        *map(_read, files),
        water=water,
        titles=[path.name for path in files],
        port=port,
        open_browser=browser,
    )


def _read(path: Path) -> "Volume | Scan":
    return pp.read_scan(path) if pp.is_scan(path) else pp.read_volume(path)
