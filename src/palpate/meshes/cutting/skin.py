"""The surface of a cut body: the organ's own and the lips of the cut, embedded in its tetrahedra."""

from dataclasses import dataclass

import numpy as np

from palpate.arrays import Bool, Float64, Int32


@dataclass(frozen=True, eq=False)
class Skin:
    """A closed surface whose vertices move with tetrahedra.

    triangles: (T, 3) vertices, normals outwards. lip: (T,) True on a face that a blade has made. tet: (S,) the
    tetrahedron that moves each vertex, and weight: (S, 4) how much each of its corners counts.
    """

    triangles: Int32
    lip: Bool
    tet: Int32
    weight: Float64

    def carried(self, tets: Int32, values: Float64) -> Float64:
        """(S, k) at the vertices, of nodal values (N, k)."""
        return np.asarray(np.einsum("sa,sak->sk", self.weight, values[tets[self.tet]]))
