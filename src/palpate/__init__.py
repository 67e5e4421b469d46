"""palpate: from X-ray projections to an organ you can touch.

The public names, in the order of the data. Each is imported when it is first used, so that `palpate --help` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from palpate.meshes.mesh import TetMesh as TetMesh
    from palpate.scans.scan import Scan as Scan
    from palpate.scans.views import Panel as Panel
    from palpate.scans.views import Views as Views
    from palpate.server.serve import touch as touch
    from palpate.simulation.devices.pointer import Command as Command
    from palpate.simulation.devices.pointer import Pointer as Pointer
    from palpate.simulation.devices.replay import Replay as Replay
    from palpate.simulation.record import Record as Record
    from palpate.simulation.record import read_record as read_record
    from palpate.simulation.record import write_record as write_record
    from palpate.simulation.session import Session as Session
    from palpate.tissue.elasticity import finite_elements as finite_elements
    from palpate.tissue.models import model as model
    from palpate.tissue.tissue import SpringLaw as SpringLaw
    from palpate.tissue.tissue import Tissue as Tissue
    from palpate.tissue.tissue import resting_on as resting_on
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
    "TetMesh": "meshes.mesh",
    "Tissue": "tissue.tissue",
    "SpringLaw": "tissue.tissue",
    "resting_on": "tissue.tissue",
    "finite_elements": "tissue.elasticity",
    "model": "tissue.models",
    "Session": "simulation.session",
    "Command": "simulation.devices.pointer",
    "Pointer": "simulation.devices.pointer",
    "Replay": "simulation.devices.replay",
    "Record": "simulation.record",
    "read_record": "simulation.record",
    "write_record": "simulation.record",
    "touch": "server.serve",
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
