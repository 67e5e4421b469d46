"""The robust way: fTetWild (pytetwild, Mozilla Public License 2.0), for surfaces that stuffing cannot follow.

Source: Y. Hu, T. Schneider, B. Wang, D. Zorin, D. Panozzo, "Fast tetrahedral meshing in the wild", ACM Transactions on
Graphics 39(4), 117, 2020. It takes minutes where stuffing takes seconds, and keeps sharp edges and thin places.
"""

import numpy as np

from palpate.errors import MeshError
from palpate.meshes.element_quality import smallest_dihedral
from palpate.meshes.stuffing.dihedral_improvement import improve_dihedrals
from palpate.meshes.stuffing.manifold_repair import remove_pinches
from palpate.meshes.stuffing.nested_solids import Solid
from palpate.meshes.stuffing.thin_features import measure_losses, smooth_surface
from palpate.meshes.stuffing.volume_matching import WORST_DIHEDRAL, StuffedMesh
from palpate.meshes.tet_mesh import signed_volumes

ENVELOPE = 0.1  # of the edge: how far the surface may stray


def check_tetwild() -> None:
    """Raises `MeshError` if pytetwild is not installed."""
    try:
        import pytetwild  # noqa: F401
    except ImportError as problem:
        raise MeshError(
            f"mesher 'tetwild' needs pytetwild ({problem}): pip install 'palpate[tetwild]'; its licence is the Mozilla "
            f"Public License 2.0, and it bundles GMP (LGPL); or use the mesher 'stuffing', which needs nothing"
        ) from None


def ftetwild(body: Solid, edge: float) -> StuffedMesh:
    """Tets of about `edge` mm that fill a solid. Raises `MeshError` if they are no solid."""
    check_tetwild()
    import pytetwild

    points, triangles = smooth_surface(body)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    made, cells = pytetwild.tetrahedralize(
        points, triangles.astype(np.int32), edge_length_abs=edge, epsilon=ENVELOPE * edge / size, quiet=True
    )
    nodes, tets = np.asarray(made, dtype=np.float64), np.asarray(cells, dtype=np.int64)
    if len(tets) == 0:
        raise MeshError(f"tetwild left nothing of {body.name!r} with an edge of {edge:g} mm; use a shorter one")
    flip = signed_volumes(nodes, tets) < 0
    tets[flip] = tets[flip][:, [0, 2, 1, 3]]
    tets = tets[remove_pinches(tets, signed_volumes(nodes, tets))]
    nodes = improve_dihedrals(nodes, tets, WORST_DIHEDRAL + 0.1)
    worst = float(smallest_dihedral(nodes, tets).min(initial=180))
    if not worst > 1:
        raise MeshError(f"tetwild's worst dihedral angle is {worst:.2g}°; use another edge than {edge:g} mm")
    return StuffedMesh(nodes, tets, np.ones((1, len(tets)), dtype=bool), measure_losses(body, nodes, tets, edge))
