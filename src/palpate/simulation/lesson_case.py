"""Cases of a lesson: lumps at places, of sizes and of stiffness that a seed draws."""

import numpy as np

from palpate.arrays import Float64
from palpate.errors import DataError
from palpate.meshes.cutting.cut_mesh import refuse_cut
from palpate.meshes.tet_mesh import TetMesh
from palpate.simulation.lesson import Lesson, Lumps
from palpate.tissue.spring_fitting import scattered_points, surface_normals
from palpate.tissue.tissue import Tissue

TRIES = 400
LEAST_TETS = 4  # of a lump
APART = 1.5  # mean edges between two lumps, which else could share a node and be one


def lesson_case(lesson: Lesson, organ: Tissue, seed: int) -> Tissue:
    """Draw a case: the lesson's organ with lumps.

    Nodes, tetrahedra and supports are those of the organ, so nothing that a page is sent tells where the lumps are.

    Parameters
    ----------
    lesson : Lesson
        The lesson.
    organ : Tissue
        Its organ, of one region.
    seed : int
        Which case. The same seed draws the same case.

    Returns
    -------
    Tissue
        The organ with a region "lump", without fitted springs.

    Raises
    ------
    DataError
        If the organ has regions already, the seed is negative, or no lump fits between the lesson's limits.
    MeshError
        If the organ has been cut.

    Examples
    --------
    >>> _ = Path("lesson.yaml").write_text(pp.lesson_template("tissue.vtu"))
    >>> plain = pp.tetrahedralize(labels, "organ", edge=6)
    >>> organ = pp.Tissue(plain, 5, poisson=0.4, fixed=pp.resting_on(plain, (0, 0, -1)))
    >>> case = pp.lesson_case(pp.read_lesson("lesson.yaml"), organ, seed=7)
    >>> sorted(case.mesh.names.values())
    ['lump', 'organ']
    """
    mesh = organ.mesh
    refuse_cut(mesh, "lesson", "take the organ before the cut")
    if len(np.unique(mesh.region)) > 1:
        raise DataError("organ: has regions inside already; a lesson draws its lumps itself, so mesh it without")
    if seed < 0:
        raise DataError(f"seed: {seed}; give 0 or more")
    rng = np.random.default_rng([seed, 26])
    limits = lesson.lumps
    count = int(rng.integers(limits.count[0], limits.count[1] + 1))
    middles = mesh.nodes[mesh.tets].mean(axis=1)
    skin = mesh.nodes[mesh.surface_nodes]
    young, inside = organ.young.copy(), np.zeros(len(mesh.tets), dtype=bool)
    placed: list[tuple[Float64, float]] = []
    for _ in range(count):
        centre, radius, stiffness = _drawn(organ, limits, placed, skin, rng)
        mine = np.linalg.norm(middles - centre, axis=1) <= radius
        if np.count_nonzero(mine) < LEAST_TETS:
            raise DataError(
                f"lumps: radius {radius:.3g} mm holds {np.count_nonzero(mine)} tetrahedra of {organ.edge:.3g} mm; "
                "make them larger, or mesh the organ finer"
            )
        placed.append((centre, radius))
        young[mine], inside = stiffness, inside | mine
    label = int(mesh.region.max())
    region = np.where(inside, label + 1, mesh.region).astype(np.int32)
    names = {label: mesh.names.get(label, "organ"), label + 1: "lump"}
    return organ.replace(
        mesh=TetMesh(mesh.nodes, mesh.tets, region, names, mesh.centerline),
        young=young,
        springs=None,
        report=None,
        materials={},
        young_spread=0.0,
    )


def _drawn(
    organ: Tissue, limits: Lumps, placed: list[tuple[Float64, float]], skin: Float64, rng: np.random.Generator
) -> tuple[Float64, float, float]:
    """Centre (3,) mm, radius mm and Young's modulus kPa of a lump that lies as deep as it should, apart from the others."""
    for _ in range(TRIES):
        radius, depth, young = (float(rng.uniform(*ends)) for ends in (limits.radius, limits.depth, limits.young))
        at = scattered_points(organ, 1, seed=int(rng.integers(2**31)))
        centre = at[0] - (depth + radius) * surface_normals(organ, at)[0]
        own_depth = float(np.linalg.norm(skin - centre, axis=1).min()) - radius
        hit = organ.surface.closest(np.ascontiguousarray(centre))
        within = float(np.dot(np.asarray(hit.point) - centre, organ.surface.normal(hit))) > radius
        apart = all(np.linalg.norm(centre - other) > radius + size + APART * organ.edge for other, size in placed)
        if within and apart and limits.depth[0] <= own_depth <= limits.depth[1]:
            return centre, radius, young
    raise DataError(
        f"lumps: none fits after {TRIES} tries; the organ may be too small for radius {list(limits.radius)} mm at depth "
        f"{list(limits.depth)} mm"
    )
