"""What a trainee is asked to do, where it is right, and what the tissue should be spared."""

from dataclasses import dataclass

import numpy as np

from palpate.errors import DataError
from palpate.meshes.mesh import TetMesh
from palpate.meshes.shown import region_faces
from palpate.tissue.tissue import Tissue

ASKED = {
    "touch": "",
    "lump": "Find the lump: feel for it, and with a tool on it press Found it.",
    "biopsy": "Take a sample from the lump: drive the needle in, and when its tip is there press Take sample.",
}


@dataclass(frozen=True)
class Task:
    """A task and its limits, for `score`.

    kind: "touch" (no target), "lump" (mark what is felt) or "biopsy" (take a sample by needle). target: name or number
    of the region that is sought; empty: the stiffest of those inside. within: mm, a mark is right if it is no farther
    from the lump than the skin nearest to the lump, and this. force: N, strain: share of stretch, what should not be
    exceeded. All are the teacher's to choose: the defaults are no clinical limits. Raises `DataError` on a task that
    there is not, or a limit that is not positive.
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
    mesh, inner = tissue.mesh, list(region_faces(tissue.mesh))
    if not inner:
        raise DataError(f"task {task.kind}: the tissue is all one region, so there is no lump in it; mesh one with it")
    if not task.target:
        return max(inner, key=lambda label: float(tissue.young[mesh.region == label].mean()))
    for label in inner:
        if task.target in (mesh.names.get(label), str(label)):
            return label
    known = ", ".join(named(mesh, label) for label in inner)
    raise DataError(f"target: there is no region {task.target!r} inside the organ; there are {known}")


def named(mesh: TetMesh, label: int) -> str:
    """A region's name, or its number."""
    return mesh.names.get(label, str(label))
