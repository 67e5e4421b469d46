"""A ball in a ball, in files of surfaces, and what has to come of it."""

import warnings

import numpy as np
import pytest

import palpate as pp
from support.ball_surfaces import Gltf, ball

ORGAN, LUMP = 20.0, 7.0  # mm, radii
CENTRE, BESIDE = np.array([12.0, -40.0, 105.0]), np.array([6.0, 3.0, -2.0])  # of the organ; of the lump from there
POINTS, FACES = ball()
FLAWLESS = 4 / 3 * np.pi
TO_GLTF = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) / 1000  # m; y is towards the head, z towards the front


def read(path, **options):
    """Labels and what was said."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        labels = pp.read_surfaces(path, **options)
    return labels, [str(w.message) for w in said]


def volume(labels, value):
    return np.count_nonzero(labels.values == value) * labels.grid.voxel_volume


def check_balls(labels, said, name):
    """The organ and the lump have their names, their places, and the volumes of balls."""
    assert (labels.names, said) == ({1: name, 2: "lump"}, [])
    organ, lump = (FLAWLESS * radius**3 for radius in (ORGAN, LUMP))
    assert volume(labels, 1) == pytest.approx(organ - lump, rel=0.01)
    assert volume(labels, 2) == pytest.approx(lump, rel=0.02)
    for inside, centre in ((labels.values > 0, CENTRE), (labels.values == 2, CENTRE + BESIDE)):
        assert np.allclose(labels.grid.points(np.argwhere(inside)).mean(axis=0), centre, atol=0.1)


def nested():
    return ("lump", POINTS * LUMP + CENTRE + BESIDE, FACES), ("skin", POINTS * ORGAN + CENTRE, FACES)


def gltf_balls(root=None):
    """One mesh, a unit ball, which two nodes below a third move and scale, so that it is there twice."""
    made = Gltf()
    mesh = made.mesh(made.primitive(POINTS, FACES), name="ball")
    to_root = np.eye(3) if root is None else np.linalg.inv(root)
    children = [
        made.node(False, name=name, mesh=mesh, scale=[r / 1000] * 3, translation=(to_root @ TO_GLTF @ centre).tolist())
        for name, r, centre in (("lump", LUMP, CENTRE + BESIDE), ("skin", ORGAN, CENTRE))
    ]
    turn = {} if root is None else {"matrix": np.block([[root, np.zeros((3, 1))], [0, 0, 0, 1]]).T.ravel().tolist()}
    made.node(children=children, **turn)
    return made
