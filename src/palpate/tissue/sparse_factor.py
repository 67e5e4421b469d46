"""Sparse Cholesky factors of a stiffness matrix."""

from typing import Any

import numpy as np
from scipy.sparse import bsr_array

from palpate import _core
from palpate.arrays import Float64
from palpate.errors import DataError, MaterialError


class Factors:
    """K = L Lᵀ for a symmetric K whose unknowns 3i, 3i+1, 3i+2 belong to node i at places[i] (n, 3) mm.

    native: the C++ factor. positive: every pivot was positive. Then K + slack·1 is positive semidefinite, where slack
    bounds what rounding in the factorisation can hide; so a matrix is proven positive definite by factoring it less a
    shift larger than `slack`. Raises `DataError` if K is not of 3×3 blocks that fit `places`.
    """

    def __init__(self, K: Any, places: Float64) -> None:
        nodes = len(places)
        if K.shape != (3 * nodes, 3 * nodes) or nodes == 0:
            raise DataError(f"K: shape {K.shape} does not fit {nodes} nodes of three unknowns each")
        blocks = bsr_array(K, blocksize=(3, 3))
        start, column = blocks.indptr.astype(np.int32), blocks.indices.astype(np.int32)
        data = np.ascontiguousarray(blocks.data, dtype=np.float64)
        self.native = _core.linalg.SparseCholesky(start, column, data, np.ascontiguousarray(places, dtype=np.float64))

    @property
    def positive(self) -> bool:
        """Whether every pivot was positive."""
        return self.native.positive

    def require_positive(self) -> None:
        """Raises `MaterialError` unless `positive`."""
        if not self.positive:
            raise MaterialError(
                "the stiffness is not positive definite; hold more nodes, or mend flat tets of the mesh"
            )

    @property
    def slack(self) -> float:
        """If `positive`, no eigenvalue of K lies below −slack, rounding included."""
        return self.native.slack

    def solve(self, load: Float64) -> Float64:
        """K⁻¹ load, (3n,) or (3n, k); columns together cost less than one by one.

        Raises `MaterialError` if K is not positive definite.
        """
        self.require_positive()
        out = np.array(load, dtype=np.float64, order="C")
        self.native.solve(out.reshape(len(out), -1))
        return out
