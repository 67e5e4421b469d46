"""Training tasks: the target, and the limits that the trainee should keep."""

from dataclasses import dataclass

import numpy as np

from palpate.errors import DataError
from palpate.meshes.display_surfaces import inner_faces
from palpate.meshes.tet_mesh import TetMesh
from palpate.tissue.tissue import Tissue

ASKED = {
    "touch": "",
    "lump": "Find the lump: feel for it, and with a tool on it press Found it.",
    "biopsy": "Take a sample from the lump: drive the needle in, and when its tip is there press Take sample.",
}


@dataclass(frozen=True)
class Task:
    """A task and its limits, for `score`.

    The limits are the teacher's choice. The defaults are not clinical limits.

    Parameters
    ----------
    kind : {"touch", "lump", "biopsy"}, optional
        Without a target; mark the lump that is felt; take a sample by needle.
    target : str, optional
        Name or number of the region sought. The default is the stiffest region inside.
    within : float, optional
        A mark is right if its distance from the lump exceeds that of the closest skin by at most this, mm.
    force : float, optional
        Force that should not be exceeded, N.
    strain : float, optional
        Stretch that should not be exceeded, as a share.

    Attributes
    ----------
    text : str
        What the page tells the trainee.

    Raises
    ------
    DataError
        If the kind is unknown or a limit is not positive.

    Examples
    --------
    >>> pp.Task("lump", target="lump", force=2.0).kind
    'lump'
    """

    kind: str = "touch"
    target: str = ""
    within: float = 5.0
    force: float = 5.0
    strain: float = 0.3

    def __post_init__(self) -> None:
        if self.kind not in ASKED:
            raise DataError(f"task: {self.kind!r} is none; choose one of {', '.join(ASKED)}")
        for name in ("within", "force", "strain"):
            value = getattr(self, name)
            if not (value > 0 and np.isfinite(value)):
                raise DataError(f"{name}: {value:g}, expected more than 0")

    @property
    def text(self) -> str:
        """What the page tells the trainee."""
        return ASKED[self.kind]


def target_of(task: Task, tissue: Tissue) -> int | None:
    """The label of the region that is sought; None if none is. Raises `DataError` if it is not there."""
    if task.kind == "touch":
        return None
    mesh, inner = tissue.mesh, list(inner_faces(tissue.mesh))
    if not inner:
        raise DataError(f"task {task.kind}: the tissue is all one region, so there is no lump in it; mesh one with it")
    if not task.target:
        return max(inner, key=lambda label: float(tissue.young[mesh.region == label].mean()))
    for label in inner:
        if task.target in (mesh.names.get(label), str(label)):
            return label
    known = ", ".join(region_name(mesh, label) for label in inner)
    raise DataError(f"target: there is no region {task.target!r} inside the organ; there are {known}")


def region_name(mesh: TetMesh, label: int) -> str:
    """A region's name, or its number."""
    return mesh.names.get(label, str(label))
