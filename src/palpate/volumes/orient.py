"""The axes of a volume beside those of the patient."""

from itertools import permutations

import numpy as np

from palpate.arrays import Float32
from palpate.volumes.grid import Grid
from palpate.volumes.volume import Volume


def along_patient(volume: Volume) -> tuple[Float32, Grid]:
    """The same voxels, axes swapped and reversed so that x, y, z are nearest to left, posterior, superior.

    The values are a view of the volume's, not a copy.
    """
    turn = volume.grid.direction
    order = max(permutations(range(3)), key=lambda o: sum(abs(turn[p, o[p]]) for p in range(3)))
    signs = [1.0 if turn[p, order[p]] > 0 else -1.0 for p in range(3)]
    new = turn[:, order] * signs
    if np.linalg.det(new) < 0:  # so oblique that no order is nearest
        return volume.values, volume.grid
    axes = [2 - order[2 - a] for a in range(3)]  # of the array, (z, y, x)
    flips = tuple(slice(None, None, int(signs[2 - a])) for a in range(3))
    values = volume.values.transpose(axes)[flips]
    corner = np.zeros(3)
    for a in range(3):
        if signs[2 - a] < 0:
            corner[axes[a]] = volume.grid.shape[axes[a]] - 1
    spacing = [volume.grid.spacing[i] for i in axes]
    return values, Grid(values.shape, spacing, volume.grid.points(corner)[0], new)


def knows_patient(volume: Volume) -> bool:
    """Are the axes a patient's? A reconstruction has those of its X-ray system until a direction says otherwise."""
    return volume.unit == "HU" or not np.allclose(volume.grid.direction, np.eye(3), atol=1e-6)
