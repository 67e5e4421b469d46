"""A small scan with its projector, and a small organ with a lump, for tests of derivatives."""

import functools

import numpy as np

import palpate as pp
from support.brick_meshes import block

PANEL = pp.Panel(shape=(12, 16), pitch=(4, 4), origin=(-30, -22, 0))
VIEWS = pp.arc_views(PANEL, angles=[-15, 0, 15], radius=400, pivot=(0, 0, 15))
GRID = pp.Grid(shape=(4, 10, 12), spacing=(5, 3, 3), origin=(-16.5, -13.5, 7))


@functools.cache
def projector():
    return pp.Projector(VIEWS, GRID)


def poisson_scan(seed=3):
    """Counts of a random volume, with background and masked pixels."""
    rng = np.random.default_rng(seed)
    p = projector()(0.02 * rng.random(GRID.shape))
    background = rng.uniform(5, 20, p.shape)
    return pp.Scan(rng.poisson(300 * np.exp(-p) + background), 300, VIEWS, background, rng.random(p.shape) > 0.1)


def lumpy(element="smoothed"):
    """A block of 4 x 4 x 4 bricks whose middle is region 2, held below; its top."""
    tissue = block(5)
    mesh = tissue.mesh
    middle = mesh.nodes[mesh.tets].mean(axis=1)
    inside = np.abs(middle - mesh.nodes.mean(axis=0)).max(axis=1) < np.ptp(mesh.nodes[:, 0]) / 4
    parted = pp.TetMesh(mesh.nodes, mesh.tets, np.where(inside, 7, 3))
    return pp.Tissue(parted, {3: 5, 7: 40}, 0.4, tissue.fixed, element=element)
