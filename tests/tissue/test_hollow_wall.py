"""The force of a wall against that of the continuum: Taylor-Hood elements on the same polyhedron."""

import numpy as np
from support.lumens import bent

import palpate as pp
from benchmarks.continuum_truth import compliance

RADIUS = 3.0  # mm, of the contact


def test_the_force_of_a_wall_nears_the_continuums():
    """Too high, as of every displacement element; with half the edge and more layers less than half of that."""
    labels, center = bent(4.0, 16.0)
    off = []
    for edge, layers in ((2.5, 1), (1.25, 3)):
        mesh = pp.hollow_mesh(labels, 1, 2.5, edge, layers=layers)
        tissue = pp.Tissue(mesh, young=100, poisson=0.45, fixed=pp.fixed_at_openings(mesh))
        place = center + (4.0, 16 * np.cos(0.8), 16 * np.sin(0.8))
        hit = tissue.surface.closest(place)
        moved = -0.4 * tissue.surface.normal(hit)
        force = pp.model(tissue, "compliance").push(np.array(hit.point), moved, RADIUS, tolerance=1e-6).force
        true = np.linalg.solve(compliance(tissue, place, RADIUS, levels=1), moved)
        off.append(np.linalg.norm(force) / np.linalg.norm(true) - 1)
    assert 0 < off[1] < 0.08
    assert off[1] < off[0] / 2


def test_open_ends_are_held_and_a_solid_has_none():
    labels, _ = bent()
    mesh = pp.hollow_mesh(labels, 1, 2, 3)
    held = mesh.nodes[pp.fixed_at_openings(mesh)]
    low = labels.grid.bounds[0]
    assert len(held) > 50
    on_side = np.isclose(held[:, 1], low[1], atol=1e-6) | np.isclose(held[:, 2], low[2], atol=1e-6)
    assert on_side.all()
    solid = pp.TetMesh(mesh.nodes, mesh.tets)
    assert len(pp.fixed_at_openings(solid)) == 0
