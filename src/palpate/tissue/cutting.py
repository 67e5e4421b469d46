"""Cuts a tissue."""

from collections.abc import Sequence

import numpy as np

from palpate.arrays import Bool, Float64
from palpate.errors import DataError, MaterialError
from palpate.meshes.cutting.blade import Blade
from palpate.meshes.cutting.cut_mesh import CutMesh, cut_held_mesh, pieces_of, without
from palpate.tissue.tissue import Tissue

LOOSE = ("refuse", "remove")


def cut(tissue: Tissue, blade: Blade | Sequence[Blade], loose: str = "refuse") -> Tissue:
    """Return a tissue with cuts through it.

    Each tetrahedron that a blade has passed is there once for each part it was cut into (virtual nodes), and counts with
    that part's volume. The cut ends where the blade has ended, inside a tetrahedron or between two, and there the nodes
    stay whole. A held node holds the piece that its place is in.

    Parameters
    ----------
    tissue : Tissue
        The tissue, cut or not.
    blade : Blade or sequence of Blade
        What passes through it. Where nothing is met, nothing is cut.
    loose : {"refuse", "remove"}, optional
        What to do with a piece that comes free and that no three nodes hold.

    Returns
    -------
    Tissue
        The cut tissue, without the springs that `fit` found. Its `mesh` says `share`, `side` and `body` of each
        tetrahedron. The models `compliance`, `multigrid` and `blocks` take it.

    Raises
    ------
    MaterialError
        If a piece comes free, and `loose` is "refuse"; or if nothing would be left; or if the element is "P2" or "mixed".
    DataError
        If there is no blade, or `loose` is another word.
    MeshError
        If a piece of a cut tissue has been taken away before.

    References
    ----------
    Molino, Bao & Fedkiw, ACM Trans. Graph. 23 (2004) 385: virtual nodes.
    Sifakis, Der & Fedkiw, SCA 2007, 73: blades of any shape.

    Examples
    --------
    >>> blade = pp.Blade.swept([top - (8, 0, -5), top + (8, 0, 5)], direction=(0, 0, -1), depth=15)
    >>> opened = pp.cut(tissue, blade)
    >>> len(opened.mesh.nodes) > len(tissue.mesh.nodes)
    True
    """
    blades = (blade,) if isinstance(blade, Blade) else tuple(blade)
    if not blades:
        raise DataError("blade: none given; give one or more, such as pp.Blade.swept(path, direction, depth)")
    if loose not in LOOSE:
        raise DataError(f"loose: {loose!r} is not known; choose one of {', '.join(LOOSE)}")
    return _parts(tissue, blades, loose)[0]


def cut_apart(tissue: Tissue, blades: Sequence[Blade]) -> tuple[Tissue, tuple[CutMesh, ...]]:
    """The tissue with cuts through it, and the pieces that come free, the largest first. Raises as `cut` does."""
    left, mesh, gone = _parts(tissue, blades, "remove")
    return left, pieces_of(mesh, gone)


def _parts(tissue: Tissue, blades: Sequence[Blade], loose: str) -> tuple[Tissue, CutMesh, Bool]:
    """The tissue that is left, the mesh with all its pieces, and which of its tetrahedra have come free."""
    if not may_be_cut(tissue):
        raise MaterialError(
            f'element: "{tissue.element}" is not built for cuts; make the tissue with element="smoothed"'
        )
    whole = before_cuts(tissue)
    mesh, gone = cut_held_mesh(tissue.mesh, blades, whole.held)
    if gone.any() and (loose == "refuse" or gone.all()):
        raise MaterialError(_says(mesh, gone))
    return _tissue(whole, without(mesh, gone) if gone.any() else mesh), mesh, gone


def may_be_cut(tissue: Tissue) -> bool:
    """Whether cuts are built for the tissue's element."""
    return tissue.element in ("smoothed", "P1")


def before_cuts(tissue: Tissue) -> Tissue:
    """The tissue before all its cuts. Raises `MeshError` if a piece of it has been taken away."""
    mesh = tissue.mesh
    if not isinstance(mesh, CutMesh):
        return tissue
    first = np.unique(mesh.parent, return_index=True)[1]
    return tissue.replace(
        mesh=mesh.uncut,
        young=tissue.young[first],
        poisson=tissue.poisson[first],
        stiffening=tissue.stiffening[first],
        young_spread=tissue.young_spread[first],
        fixed=np.unique(mesh.origin[tissue.fixed]),
    )


def _tissue(before: Tissue, mesh: CutMesh) -> Tissue:
    relaxation = before.relaxation
    if isinstance(relaxation, dict):
        relaxation = {region: one for region, one in relaxation.items() if (mesh.region == region).any()} or None

    def copied(constant: Float64) -> Float64:
        return np.asarray(constant[mesh.parent])

    return before.replace(
        mesh=mesh,
        young=copied(before.young),
        poisson=copied(before.poisson),
        stiffening=copied(before.stiffening),
        young_spread=copied(before.young_spread),
        fixed=np.isin(mesh.origin, before.fixed) & mesh.real,
        springs=None,
        report=None,
        relaxation=relaxation,
    )


def _says(mesh: CutMesh, gone: Bool) -> str:
    free, volume = np.unique(mesh.body[gone]), np.bincount(mesh.body, mesh.volumes)
    largest = int(free[np.argmax(volume[free])])
    middle = mesh.nodes[np.unique(mesh.tets[mesh.body == largest])].mean(axis=0)
    if gone.all():
        return "blade: no piece of the cut tissue is held by three nodes or more; hold more of it"
    return (
        f"blade: {len(free)} of {len(volume)} pieces come free (the largest: {volume[largest]:.3g} mm³ about "
        f'{np.round(middle, 1).tolist()} mm); hold them, cut less deep, or take them away with loose="remove"'
    )
