"""Gaps between surfaces of a body, as linear functions of its displacement."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, hstack

from palpate.arrays import Float64


@dataclass(frozen=True, eq=False)
class SurfaceGaps:
    """Gaps rest + Nᵀu, each a mean over a part of a surface, and the slips Tᵀu of the surfaces along each other there.

    N: (3N, g). rest: (g,) mm. T: (3N, 2g), two directions for each gap, at right angles to its mean normal;
    (3N, 0) where nobody asks for slips.
    """

    N: csr_array
    rest: Float64
    T: csr_array

    @classmethod
    def none(cls, nodes: int) -> "SurfaceGaps":
        """No gaps, of a mesh of so many nodes."""
        return cls(csr_array((3 * nodes, 0)), np.zeros(0), csr_array((3 * nodes, 0)))

    @classmethod
    def together(cls, parts: list["SurfaceGaps"]) -> "SurfaceGaps":
        """All gaps of several."""
        return cls(
            csr_array(hstack([part.N for part in parts])),
            np.concatenate([part.rest for part in parts]),
            csr_array(hstack([part.T for part in parts])),
        )


def along(normal: Float64) -> Float64:
    """(g, 2, 3) units at right angles to normals (g, 3), which need not be units, and to each other."""
    n = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    axis = np.eye(3)[np.abs(n).argmin(axis=1)]
    first = np.cross(n, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(n, first)], axis=1)
