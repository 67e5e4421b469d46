"""How far a cut opens where the tissue is under tension at rest."""

import numpy as np

from palpate.arrays import Float64
from palpate.errors import DataError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.tissue.reference.linear_elasticity import FiniteElements
from palpate.tissue.tissue import KPA, Constant, Tissue, constant_per_tet


def gape(tissue: Tissue, tension: Constant) -> Float64:
    """Return how a cut tissue moves when the tension that it had at rest goes from the lips of its cuts.

    The tension is alike in all directions, and was in equilibrium before the cut, with whatever holds the organ. A blade
    takes its traction from both lips, so they draw back. Linear elasticity; lips that meet go through each other.

    Parameters
    ----------
    tissue : Tissue
        What `cut` made.
    tension : float, array_like (M,), or dict
        Of the tissue at rest, kPa: one number, one for each tetrahedron of the cut mesh, or by region number or name.

    Returns
    -------
    ndarray, (N, 3)
        Displacement of the nodes, mm.

    Raises
    ------
    DataError
        If the tissue has not been cut, or the tension is negative.

    Examples
    --------
    >>> opened = pp.cut(tissue, pp.incision(tissue, [top - (8, 0, 0), top + (8, 0, 0)], depth=10))
    >>> bool(np.abs(pp.gape(opened, tension=1.0)).max() > 0)
    True
    """
    mesh = tissue.mesh
    if not isinstance(mesh, CutMesh):
        raise DataError("tissue: has not been cut; make a cut with pp.cut")
    pull = constant_per_tet("tension", tension, mesh)
    if (pull < 0).any():
        raise DataError(f"tension: {pull.min():g} kPa; give 0 or more: tissue that is pressed does not gape")
    return opening(FiniteElements(tissue), mesh, pull)


def opening(elements: FiniteElements, mesh: CutMesh, pull: Float64) -> Float64:
    """(N, 3) mm: what `gape` returns, for the tension of each tetrahedron (M,) kPa and elements that are factored."""
    load = np.zeros(elements.K.shape[0])
    load[elements.nodal] = _released(mesh, pull * KPA)
    return np.asarray(elements.solve(load[:, None])[elements.nodal, 0])


def _released(mesh: CutMesh, tension: Float64) -> Float64:
    """(N, 3) N: the traction that the lips have lost, the other way round."""
    skin = mesh.skin
    lips = skin.triangles[skin.lip]
    a, b, c = mesh.places[lips].swapaxes(0, 1)
    force = -tension[skin.tet[lips[:, 0]]][:, None] * np.cross(b - a, c - a) / 6  # on each corner
    corner = np.zeros((len(mesh.places), 3))
    for k in range(3):
        np.add.at(corner, lips[:, k], force)
    out = np.zeros((len(mesh.nodes), 3))
    np.add.at(out, mesh.tets[skin.tet], skin.weight[:, :, None] * corner[:, None])
    return out
