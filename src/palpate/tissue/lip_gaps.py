"""The gap between the lips of a cut, node by node."""

import numpy as np
from scipy.sparse import csc_array, csr_array, hstack

from palpate import _core
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.tissue.surface_gaps import SurfaceGaps

SAME = 1e-8  # of the body's size: vertices that are nearer to each other are at one place


def lip_gaps(mesh: CutMesh, slips: bool = False) -> SurfaceGaps:
    """The weighted mean of the gap over each part of the cut; slips: and the slips there.

    A node of the mesh before, of which the two lips have two copies, has a part of the cut: its weight is the node's own
    shape function, so the means are those of a mortar method. With it the jump of the displacement along the normal is
    integrated over the faces of the cut (one point a corner). Where the blade has turned, a node has a gap on each side of
    the kink. At rest all gaps are 0.
    """
    skin = mesh.skin
    first, node, normal, tangent = _core.cutting.lip_gaps(
        skin.triangles,
        skin.lip.view(np.uint8),
        mesh.tets[skin.tet],
        np.ascontiguousarray(skin.weight),
        mesh.places,
        mesh.origin,
        SAME * float(np.ptp(mesh.nodes, axis=0).max()),
    )
    count, size = len(first) - 1, 3 * len(mesh.nodes)
    rows = (3 * node[:, None] + np.arange(3)).ravel()
    N = csc_array((normal.ravel(), rows, 3 * first), shape=(size, count))
    if not slips:
        return SurfaceGaps(csr_array(N), np.zeros(count), csr_array((size, 0)))
    ways = [csc_array((way.ravel(), rows, 3 * first), shape=(size, count)) for way in (tangent[:, :3], tangent[:, 3:])]
    beside = np.arange(2 * count).reshape(2, count).T.ravel()  # both ways of a gap
    return SurfaceGaps(csr_array(N), np.zeros(count), csr_array(csc_array(hstack(ways))[:, beside]))
