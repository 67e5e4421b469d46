"""`palpate doctor`: what is installed, which devices answer, how fast this machine is."""

import os
import platform
import shutil
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import typer

_NEEDED = ("numpy", "scipy", "scikit-image", "scikit-fem", "h5py", "nibabel", "tifffile", "meshio", "starlette")


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("doctor")(doctor)


def doctor() -> None:
    """Say what is installed, what this machine can do, and what is missing.

    Example: palpate doctor
    """
    import palpate
    from palpate import _core, server

    well = True
    typer.echo(f"palpate {palpate.__version__}, Python {platform.python_version()}, {platform.platform()}")
    typer.echo(f"kernels: {_core.instruction_set()}, {_core.threads()} threads of {os.cpu_count()} processors")
    for name in _NEEDED:
        try:
            typer.echo(f"{name:>14} {version(name)}")
        except PackageNotFoundError:
            well = False
            typer.echo(f"{name:>14} missing; install it: pip install {name}")
    page = Path(server.__file__).parent / "static" / "index.html"
    well &= page.is_file()
    typer.echo(f"page: {'bundled' if page.is_file() else 'missing; reinstall the wheel, or: make wheel'}")
    browser = next((b for b in ("chromium", "google-chrome", "firefox") if shutil.which(b)), None)
    typer.echo(f"browser: {browser or 'none found here; open the printed address from another machine'}")
    typer.echo("devices: pointer (in the page), replay (a file)")
    if not well:
        raise typer.Exit(1)
