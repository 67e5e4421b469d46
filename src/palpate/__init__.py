"""palpate: from X-ray projections to an organ you can touch.

The public names, in the order of the data. Each is imported when it is first used, so that `palpate --help` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from palpate.meshes.mesh import TetMesh as TetMesh
    from palpate.reconstruction.projector import Projector as Projector
    from palpate.scans.scan import Scan as Scan
    from palpate.scans.views import Panel as Panel
    from palpate.scans.views import Views as Views
    from palpate.volumes.grid import Grid as Grid
    from palpate.volumes.volume import Labels as Labels
    from palpate.volumes.volume import Volume as Volume

_HOME = {
    "Grid": "volumes.grid",
    "Volume": "volumes.volume",
    "Labels": "volumes.volume",
    "Panel": "scans.views",
    "Views": "scans.views",
    "Scan": "scans.scan",
    "Projector": "reconstruction.projector",
    "TetMesh": "meshes.mesh",
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'palpate' has no attribute {name!r}")
    value = getattr(import_module(f"palpate.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
