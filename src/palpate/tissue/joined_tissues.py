"""Several organs as one tissue."""

from collections.abc import Sequence

import numpy as np

from palpate.arrays import Float64, Int32
from palpate.errors import DataError, MeshError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.meshes.tet_mesh import TetMesh
from palpate.tissue.attachment import Attachment
from palpate.tissue.gap_contact import complementarity
from palpate.tissue.organ_gaps import deepest_overlap, organ_gaps
from palpate.tissue.reference.linear_elasticity import FiniteElements
from palpate.tissue.tissue import Tissue

BONE = 1e6  # kPa, of bones, whose nodes are all held
SETTLED = 0.02  # mm of overlap that may be left
MOST_ROUNDS = 8
DEEPEST = 1.0  # edges: organs that overlap by more were not made of one label map


def join_tissues(
    tissues: Sequence[Tissue],
    bones: Sequence[TetMesh] = (),
    attachments: Sequence[Attachment] = (),
    surface_friction: float | None = None,
) -> Tissue:
    """Return several organs as one tissue, in which they touch each other.

    Each keeps its stiffness and its supports. With the model `compliance` they press and rub on each other where they meet;
    other models let them go through each other. Organs that were meshed one by one overlap here and there by a part
    of an element: they are moved apart as far as that takes, in the shape of least elastic energy, which then is at rest.

    Parameters
    ----------
    tissues : sequence of Tissue
        The organs, in one patient space. Their `element` is the same.
    bones : sequence of TetMesh, optional
        What is rigid and does not move.
    attachments : sequence of Attachment, optional
        What attaches one to another, besides what the tissues have.
    surface_friction : float, optional
        Coulomb's coefficient between all of them, as of `Tissue`. The default is the largest of the tissues' own.

    Returns
    -------
    Tissue
        The organs. Region numbers and names that are used twice get others: "lump" of the second organ is "lump 2".

    Raises
    ------
    DataError
        If there are less than two organs and bones, or one was cut, relaxes or has inertia, or their elements differ.
    MeshError
        If two organs overlap by more than an element.

    References
    ----------
    Puso & Laursen, Comput. Methods Appl. Mech. Eng. 193 (2004) 601: a mortar method for contact.

    Examples
    --------
    >>> moved = pp.TetMesh(mesh.nodes + (90, 0, 0), mesh.tets, mesh.region, mesh.names)
    >>> both = pp.join_tissues([tissue, tissue.replace(mesh=moved)])
    >>> len(both.mesh.nodes) == 2 * len(mesh.nodes), both.mesh.names[3]
    (True, 'organ 2')
    """
    _check(tissues, bones)
    meshes = [*(tissue.mesh for tissue in tissues), *bones]
    start = np.cumsum([0, *(len(mesh.nodes) for mesh in meshes)])[:-1]
    regions, names = _regions(meshes)
    mesh = TetMesh(
        np.concatenate([mesh.nodes for mesh in meshes]),
        np.concatenate([mesh.tets + first for mesh, first in zip(meshes, start, strict=True)]),
        np.concatenate(regions),
        names,
    )
    rigid = sum(len(mesh.tets) for mesh in bones)

    def of_all(name: str, of_bone: float) -> Float64:
        return np.concatenate([*(getattr(tissue, name) for tissue in tissues), np.full(rigid, of_bone)])

    held = [*(tissue.fixed for tissue in tissues), *(np.arange(len(bone.nodes)) for bone in bones)]
    joined = Tissue(
        mesh,
        of_all("young", BONE),
        of_all("poisson", 0.3),
        np.concatenate([nodes + first for nodes, first in zip(held, start, strict=True)]),
        element=tissues[0].element,
        stiffening=of_all("stiffening", 0.0),
        young_spread=of_all("young_spread", 0.0),
        attachments=[*(one for tissue in tissues for one in tissue.attachments), *attachments],
        surface_friction=max(one.surface_friction for one in tissues) if surface_friction is None else surface_friction,
    )
    return _without_overlap(joined)


def _check(tissues: Sequence[Tissue], bones: Sequence[TetMesh]) -> None:
    if not tissues or len(tissues) + len(bones) < 2:
        raise DataError(
            f"tissues: {len(tissues)} given, and {len(bones)} bones; give two organs, or an organ and a bone"
        )
    for number, tissue in enumerate(tissues, 1):
        if isinstance(tissue.mesh, CutMesh):
            raise DataError(f"tissues: number {number} has been cut; join the organs first, then cut")
        if tissue.time_dependent:
            raise DataError(f"tissues: number {number} relaxes or has inertia; organs that touch are elastic")
        if tissue.element != tissues[0].element:
            raise DataError(
                f'tissues: number {number} has the element "{tissue.element}", the first "{tissues[0].element}"'
            )


def _regions(meshes: Sequence[TetMesh]) -> tuple[list[Int32], dict[int, str]]:
    """The regions of each, renumbered where a number is used twice, and the names of all."""
    regions: list[Int32] = []
    names: dict[int, str] = {}
    taken: set[int] = set()
    for number, mesh in enumerate(meshes, 1):
        region = mesh.region.copy()
        for value in np.unique(mesh.region).tolist():
            free = value if value not in taken else max(taken) + 1
            region[mesh.region == value] = free
            taken.add(free)
            name = mesh.names.get(value, f"region {value}")
            names[free] = name if name not in names.values() else f"{name} {number}"
        regions.append(region)
    return regions, names


def _without_overlap(tissue: Tissue) -> Tissue:
    """The organs, moved apart where they overlap."""
    deepest = deepest_overlap(tissue.mesh)
    if deepest > DEEPEST * tissue.edge:
        raise MeshError(
            f"tissues: two organs overlap by {deepest:.2g} mm, more than an element; mesh them from one label map"
        )
    for _ in range(MOST_ROUNDS):
        found = organ_gaps(tissue.mesh)
        N, rest = found.N, found.rest
        deepest = -rest.min(initial=0.0)
        if deepest <= SETTLED:
            return tissue
        N = N[np.flatnonzero(np.repeat(~tissue.held, 3))]
        apart = FiniteElements(tissue).factors.solve(N.toarray())
        u = np.zeros((len(tissue.mesh.nodes), 3))
        u[~tissue.held] = (apart @ complementarity(N.T @ apart, rest)).reshape(-1, 3)
        mesh = tissue.mesh
        tissue = tissue.replace(mesh=TetMesh(mesh.nodes + u, mesh.tets, mesh.region, mesh.names))
    raise MeshError(f"tissues: two organs overlap by {deepest:.2g} mm where both are held; hold less of them")
