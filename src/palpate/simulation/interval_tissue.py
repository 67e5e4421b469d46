"""The two organs of a trial: the same nodes, tetrahedra and supports, and another stiffness in one of them."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Bool, Float64
from palpate.errors import DataError
from palpate.meshes.cutting.cut_mesh import refuse_cut
from palpate.simulation.forced_choice import ForcedChoice
from palpate.simulation.lesson_case import LEAST_TETS
from palpate.tissue.spring_fitting import scattered_points, surface_normals
from palpate.tissue.tissue import Tissue

TRIES = 400
DEPTH = 3.0  # mm of tissue between the lump and the skin above it
STEEPEST = 0.8  # of the skin above the lump: cosine of its normal with the z axis, about which the page turns the organ


@dataclass(frozen=True, eq=False)
class Stimulus:
    """What is stiffer in one of the intervals: these tetrahedra (M,). place, normal: (3,) mm, above a lump; else None."""

    stiffer: Bool
    place: Float64 | None = None
    normal: Float64 | None = None

    def tissue(self, organ: Tissue, level: float) -> Tissue:
        """The organ with E (1 + level) there."""
        young = np.where(self.stiffer, (1 + level) * organ.young, organ.young)
        return organ.replace(young=young, springs=None, report=None, materials={}, young_spread=0.0)


def stimulus(experiment: ForcedChoice, organ: Tissue) -> Stimulus:
    """What is stiffer: the whole organ, or a ball whose place the seed draws, once for all trials.

    A level is the stiffness of a lump and not its size: on a mesh, sizes that differ by less than an edge hold the same
    tetrahedra. Raises `DataError` if the organ cannot be used or no lump fits, `MeshError` if it has been cut.
    """
    mesh = organ.mesh
    refuse_cut(mesh, "ask", "take the organ before the cut")
    if organ.attachments:
        raise DataError("organ: attachments do not become stiffer with it; ask with an organ that has none")
    if experiment.question == "stiffness":
        return Stimulus(np.ones(len(mesh.tets), dtype=bool))
    radius = experiment.diameter / 2
    middles, skin = mesh.nodes[mesh.tets].mean(axis=1), mesh.nodes[mesh.surface_nodes]
    held = mesh.nodes[organ.held]
    points = scattered_points(organ, TRIES, seed=experiment.seed)
    for place, normal in zip(points, surface_normals(organ, points), strict=True):
        centre = place - (DEPTH + radius) * normal
        own_depth = float(np.linalg.norm(skin - centre, axis=1).min()) - radius
        clear = np.linalg.norm(held - centre, axis=1).min(initial=np.inf) > 2 * radius
        inside = np.linalg.norm(middles - centre, axis=1) <= radius
        if abs(normal[2]) < STEEPEST and clear and own_depth > DEPTH / 2 and np.count_nonzero(inside) >= LEAST_TETS:
            return Stimulus(inside, place, normal)
    raise DataError(
        f"diameter: no lump of {experiment.diameter:g} mm fits {DEPTH:g} mm below the skin after {TRIES} tries; make it "
        f"smaller, or larger if the mesh is coarse ({organ.edge:.3g} mm)"
    )
