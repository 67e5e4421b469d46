"""`palpate doctor`: what is installed, which devices answer, how fast this machine is."""

import os
import platform
import shutil
import time
from importlib.metadata import PackageNotFoundError, version

import typer

NEEDED = (
    "numpy", "scipy", "scikit-image", "scikit-fem", "h5py", "nibabel", "tifffile", "meshio", "rich", "typer", "pyyaml",
    "starlette", "uvicorn", "websockets", "matplotlib", "pydicom", "pillow", "pylibjpeg", "pylibjpeg-openjpeg", "jinja2",
    "lazy-loader", "threadpoolctl",
)  # fmt: skip
PROMPT = (
    "for steady forces: '* - rtprio 1' in /etc/security/limits.d/palpate.conf, two processors or more, log in again"
)
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox", "safari")


def add(app: typer.Typer) -> None:
    """Adds the command to `app`."""
    app.command("doctor", short_help="Says what is installed, what is missing, and how fast this machine is.")(doctor)


def doctor() -> None:
    """Example: [bold]palpate doctor[/bold]

    Says what is installed, what this machine can do, and what is missing.
    """
    from palpate.version import __version__

    typer.echo(f"palpate {__version__}, Python {platform.python_version()}, {platform.platform()}")
    checks = (_packages, _kernels, _samples, _page, _browser)
    well = [check() for check in checks]
    _devices()
    _plugins()
    if not all(well):
        raise typer.Exit(1)


def _packages() -> bool:
    well = True
    for name in NEEDED:
        try:
            typer.echo(f"{name:>14} {version(name)}")
        except PackageNotFoundError:
            well = False
            typer.echo(f"{name:>14} missing; install it: pip install {name}")
    return well


def _kernels() -> bool:
    try:
        from palpate import _core
    except ImportError as problem:
        typer.echo(f"kernels: missing ({problem}); install palpate's wheel again, or: make wheel")
        return False
    typer.echo(
        f"kernels: {_core.base.instruction_set()}, {_core.base.threads()} threads of {os.cpu_count()} processors"
    )
    try:
        typer.echo(f"projector: {_voxel_views_a_second() / 1e9:.2f} G voxel-views a second")
    except ImportError as problem:
        typer.echo(f"projector: not tried ({problem})")
    prompt = _core.simulation.realtime_priority()
    typer.echo(
        "loop: " + ("goes ahead of other threads" if prompt else f"waits its turn among other threads; {PROMPT}")
    )
    return True


def _voxel_views_a_second() -> float:
    """Of a forward projection with eight views of 256 x 256 x 24 voxels: the best of three."""
    import numpy as np

    import palpate as pp

    panel = pp.Panel((256, 256), (0.8, 0.8), (-102, -102, 0))
    angle = np.arange(8) * np.pi / 4
    source = np.stack([250 * np.cos(angle), 250 * np.sin(angle), np.full(8, 1000.0)], axis=1)
    grid = pp.Grid((24, 256, 256), (1.0, 0.5, 0.5), (-64, -64, 30))
    A = pp.Projector(pp.Views(source, panel), grid)
    x, best = np.ones(A.domain_shape, dtype=np.float32), np.inf
    for _ in range(3):
        began = time.perf_counter()
        A(x)
        best = min(best, time.perf_counter() - began)
    return 8 * grid.size / best


def _samples() -> bool:
    from palpate.samples import sample

    lacking = [name for name in ("breast", "head", "abdomen") if not any(sample(name).glob("*"))]
    typer.echo(f"samples: {'missing: ' + ', '.join(lacking) + '; reinstall the wheel' if lacking else 'all there'}")
    return not lacking


def _page() -> bool:
    from palpate.errors import FileError

    try:
        from palpate.server.access_control import check_page

        check_page()
    except (FileError, ImportError) as problem:
        typer.echo(f"page: missing; reinstall the wheel, or: make wheel ({problem})")
        return False
    typer.echo("page: bundled")
    return True


def _browser() -> bool:
    """No browser here is no fault: the page can be opened from another machine."""
    from palpate.server.loopback_server import has_display

    found = next((b for b in BROWSERS if shutil.which(b)), None)
    if found is None:
        typer.echo("browser: none found here; open the printed address from another machine")
    elif has_display():
        typer.echo(f"browser: {found}")
    else:
        typer.echo(f"browser: {found}, but no display here; open the printed address from another machine")
    return True


def _devices() -> None:
    """A device that is not here is no fault: the page's pointer is always there."""
    typer.echo("devices: pointer (in the page), replay (a file)")
    try:
        from palpate.haptics.discovery import look_for_devices
    except ImportError as problem:
        typer.echo(f"  with motors: not tried ({problem})")
        return
    for sighting in look_for_devices():
        if sighting.found:
            said = ", ".join(part for part in (sighting.found.model, sighting.found.serial) if part)
            typer.echo(f"  {sighting.driver}: {said}, version {sighting.found.version}")
        else:
            typer.echo(f"  {sighting.driver}: {sighting.fault}; {sighting.text}")


def _plugins() -> None:
    """Parts that installed packages or --plugin files registered."""
    from palpate import plugins

    own = {kind: plugins.names(kind)[len(built_in) :] for kind, built_in in plugins.BUILT_IN.items()}
    found = [f"{kind.replace('_', ' ')} {name}" for kind, some in own.items() for name in some]
    typer.echo(f"plugins: {', '.join(found) or 'none'}")
