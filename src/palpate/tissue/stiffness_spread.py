"""How far the force of a push may be off because a tissue's stiffness is known to a spread alone."""

import numpy as np

from palpate.arrays import Float64, Int32, Int64
from palpate.tissue.reference.linear_elasticity import lame
from palpate.tissue.smoothed_elements import smoothing_cells
from palpate.tissue.tissue import Tissue

SHEARS = [(i, j) for i in range(3) for j in range(3)]  # components of a strain


class StiffnessSpread:
    """The standard deviation of a force, relative to it, that follows from those of the stiffness, to first order.

    Of a push that is held, the energy is W = ½ F·d, and its derivative by the stiffness of a part of the body is the
    part's own energy: ∂W/∂ln E_r = W_r. So ∂ln F/∂ln E_r, along the push, is the share W_r/W of the energy that the part
    stores. Regions of one named tissue vary together, from person to person; others vary by themselves, and their
    variances add up. Several tools at once: of F·d of all.

    tissue: with `young_spread`, of a real-time element.
    The adjoint of a functional: Cacuci, Sensitivity and Uncertainty Analysis, Chapman & Hall, 2003.
    """

    def __init__(self, tissue: Tissue) -> None:
        self.tissue = tissue
        self.certain = not tissue.young_spread.any()
        if self.certain:
            return
        lam, mu = lame(tissue.young, tissue.poisson)
        cells = smoothing_cells(tissue.mesh, lam, mu)
        self._volumes, self._slopes = cells.volumes, cells.slopes
        self._edge, self._node, self._mu, self._lam = cells.edge, cells.node, cells.mu, cells.lam
        if tissue.element == "P1":  # each tetrahedron is a cell of its own
            self._edge = self._node = np.arange(len(lam), dtype=np.int32)[:, None]
            self._mu, self._lam = mu, lam
        part, relative = _parts(tissue), tissue.young_spread / tissue.young
        self._of_edge, self._of_node = _of_cells(self._edge, part), _of_cells(self._node, part)
        self._edge_spread, self._node_spread = self._mean(self._edge, relative), self._mean(self._node, relative)

    def __call__(self, u: Float64) -> float:
        """Return the relative standard deviation of the force with which the displacement u, (N, 3) mm, is held."""
        if self.certain:
            return 0.0
        slope = self._slopes.transpose(0, 2, 1) @ u[self.tissue.mesh.tets]
        strain = (slope + slope.transpose(0, 2, 1)) / 2
        squares = sum(self._mean(self._edge, strain[:, i, j]) ** 2 for i, j in SHEARS)
        shear = 2 * self._mu * self._sizes(self._edge) * squares
        bulk = self._lam * self._sizes(self._node) * self._mean(self._node, np.trace(slope, axis1=1, axis2=2)) ** 2
        whole = float(shear.sum() + bulk.sum())
        if not whole > 0:
            return 0.0
        moved = np.bincount(self._of_edge, shear * self._edge_spread)
        moved += np.bincount(self._of_node, bulk * self._node_spread)
        return float(np.linalg.norm(moved) / whole)

    def _sizes(self, cell: Int32) -> Float64:
        """mm³ of the cells, which have equal shares of a tetrahedron."""
        return self._sums(cell, np.ones(len(cell)))

    def _mean(self, cell: Int32, values: Float64) -> Float64:
        """Over each cell of the values (M,) of the tetrahedra."""
        return np.asarray(self._sums(cell, values) / self._sizes(cell))

    def _sums(self, cell: Int32, values: Float64) -> Float64:
        shared = self._volumes / cell.shape[1] * values
        return np.asarray(np.bincount(cell.ravel(), np.repeat(shared, cell.shape[1])), dtype=np.float64)


def _of_cells(cell: Int32, part: Int64) -> Int64:
    """The part of each cell, none of which crosses regions."""
    out = np.zeros(int(cell.max()) + 1, dtype=np.int64)
    out[cell] = part[:, None]
    return out


def _parts(tissue: Tissue) -> Int64:
    """(M,) of each tetrahedron the number of what varies together: a named tissue, else a region."""
    regions, index = np.unique(tissue.mesh.region, return_inverse=True)
    names = [tissue.materials.get(int(r), int(r)) for r in regions]
    return np.array([names.index(name) for name in names], dtype=np.int64)[index]
