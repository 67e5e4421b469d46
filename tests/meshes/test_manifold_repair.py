"""Solids that touch themselves at an edge or a node: the smaller side goes, the larger one stays."""

import numpy as np
import pytest
from support.brick_meshes import brick

from palpate.meshes.stuffing.manifold_repair import remove_pinches
from palpate.meshes.tet_mesh import boundary_faces, signed_volumes
from palpate.meshes.triangle_surface import non_manifold_parts


def two_blocks(apart):
    """A block of 3 x 2 x 2 cells, and a smaller one beside it that shares nodes where its own meet."""
    large, small = brick((4, 3, 3), (30, 20, 20)), brick((2, 3, 2), (10, 20, 10))
    nodes = np.concatenate([large.nodes, small.nodes + apart])
    tets = np.concatenate([large.tets, small.tets + len(large.nodes)]).astype(np.int64)
    _, first, number = np.unique(nodes.round(6), axis=0, return_index=True, return_inverse=True)
    return nodes[first], number.ravel()[tets], len(large.tets)


@pytest.mark.parametrize("apart", [(30.0, 0.0, 20.0), (30.0, 20.0, 20.0)])  # at an edge, at a node
def test_the_smaller_side_of_a_pinch_goes(apart):
    nodes, tets, large = two_blocks(apart)
    keep = remove_pinches(tets, signed_volumes(nodes, tets))
    assert keep[:large].all()  # not the tets of both sides
    assert not keep[large:].all()
    left = boundary_faces(tets[keep].astype(np.int32))
    assert all(len(part) == 0 for part in non_manifold_parts(left))


def test_a_solid_that_is_whole_is_left_alone():
    mesh = brick((4, 3, 3), (30, 20, 20))
    assert remove_pinches(mesh.tets.astype(np.int64), mesh.volumes).all()
    assert mesh.parts[0] == 1
