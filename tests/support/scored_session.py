"""Commands and sessions for the tests of scores and replays."""

import numpy as np

import palpate as pp
from palpate.meshes.tet_mesh import signed_volumes
from palpate.simulation.scoring import EVERY

TOP, RADIUS = (0.0, 0.0, 25.0), 9.0
LUMP_TOP = 19.0  # mm, z of the lump's uppermost node or thereabouts: a ball of 9 mm about z = 10


def hold(point, displacement):
    return pp.Command(True, tuple(map(float, point)), tuple(map(float, displacement)))


def needle(depth, point=TOP, axis=(0.0, 0.0, -1.0)):
    return pp.Command(True, tuple(map(float, point)), tuple(depth * np.array(axis)), kind="needle")


def press(depth, ticks, start=0.0, point=TOP):
    """Pressed in evenly, or let out, by the first tool."""
    return [[hold(point, (0, 0, -z))] for z in np.linspace(start, depth, ticks)]


def session_of(model, **options):
    return pp.Session(model, radius=RADIUS, **{"sweeps": 20, **options})


def stepped(session, commands, watch=None):
    """Forces (ticks, 4, 3) N of commands, given in steps that a watch may look at."""
    forces = []
    while commands:
        tick = session.frame().tick
        now, commands = commands[: EVERY - tick % EVERY], commands[EVERY - tick % EVERY :]
        forces.append(session.step(now))
        if watch:
            watch.see(forces[-1])
    return np.concatenate(forces)


def in_which_region(mesh, nodes, point):
    """Label of the tet of moved nodes in which a point lies, by the volumes of what it makes with each face."""
    tets = mesh.tets
    corners = nodes[tets]
    parts = np.zeros((len(tets), 4))
    for k in range(4):
        swapped = corners.copy()
        swapped[:, k] = point
        parts[:, k] = signed_volumes(swapped.reshape(-1, 3), np.arange(4 * len(tets)).reshape(-1, 4))
    inside = np.flatnonzero((parts > 0).all(axis=1))
    return None if len(inside) == 0 else int(mesh.region[inside[0]])
