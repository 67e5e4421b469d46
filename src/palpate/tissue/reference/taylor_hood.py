"""Reference up to ν = 0.5: Taylor-Hood elements for displacement and pressure (Comput. Fluids 1 (1973) 73)."""

from functools import cached_property
from typing import Any

import numpy as np
import skfem
from scipy.sparse import block_array, csc_array, csr_array
from scipy.sparse.linalg import splu
from skfem.helpers import div

from palpate.arrays import Float64, Int32
from palpate.tissue.reference.linear_elasticity import FiniteElements, assembled
from palpate.tissue.sparse_factor import Factors
from palpate.tissue.tissue import KPA, Tissue

_MOST_STEPS = 300


@skfem.BilinearForm  # type: ignore[untyped-decorator]
def _divergence(u: Any, q: Any, w: Any) -> Any:
    return div(u) * q


class MixedElements(FiniteElements):
    """Quadratic displacement, linear pressure: does not lock, whatever ν from 0 to 0.5 in each tet.

    The pressure is continuous within each of the mesh's regions and may jump between them, as it does in nature.
    With σ = 2μ ε − μ/3 tr(ε) I + p I and p = (λ + μ/3) tr(ε) both parts are sound for every ν: the first is positive
    definite, the factor 1/(λ + μ/3) of the second is finite, and 0 for ν = 0.5, where the volume is kept. Unknowns are
    the displacements, mm, then the pressures in units of mean(μ)/edge, so that all rows of K are in N:

        A u + Bᵀp = f,   B u − C p = g (0 but for prescribed displacements).
    """

    def __init__(self, tissue: Tissue) -> None:
        super().__init__(tissue, "mixed")
        self.moving = self.free[self.free < self.space.N]

    def _stiffness(self) -> csr_array:
        tissue, space = self.tissue, self.space
        mu = tissue.young * KPA / (2 * (1 + tissue.poisson))  # N/mm²
        softness = 3 * (1 - 2 * tissue.poisson) / (mu * (1 + 4 * tissue.poisson))  # 1/(λ + μ/3), mm²/N
        unit = float(mu.mean()) / tissue.edge
        broken = space.with_element(skfem.ElementDG(skfem.ElementTetP1()))
        gather = _joined(tissue, broken.element_dofs)
        points = space.dx.shape[1]

        def mass(factor: Float64) -> csr_array:
            weighed = skfem.BilinearForm(lambda p, q, w: w.factor * p * q)
            every = weighed.assemble(broken, factor=np.tile(factor[:, None], points))
            return csr_array(gather @ csr_array(every) @ gather.T)

        self.A = assembled(space, -mu / 3, mu)
        self.B = unit * csr_array(gather @ csr_array(_divergence.assemble(space, broken)))
        self.C = unit**2 * mass(softness)
        self._like = unit**2 * mass(softness + 1 / mu)  # spectrally like B A⁻¹ Bᵀ + C (Verfürth, 1984)
        rows: Any = [[self.A, self.B.T], [self.B, -self.C]]
        return csr_array(block_array(rows))

    @cached_property
    def factors(self) -> Factors:
        """Of A among the displacements that are not held."""
        return Factors(self.A[self.moving][:, self.moving], self.space.doflocs[:, self.moving[::3]].T)

    @cached_property
    def _like_factors(self) -> Any:
        return splu(csc_array(self._like))

    def solve(self, load: Float64) -> Float64:
        """(unknowns, k) displacements and pressures for (unknowns, k) loads, held unknowns 0.

        Conjugate gradients on (B A⁻¹ Bᵀ + C) p = B A⁻¹ f − g, all columns abreast; each step is one solve with A.
        """
        B, like = self.B[:, self.moving], self._like_factors.solve
        u = self.factors.solve(load[self.moving])
        g = load[self.space.N :]
        p, r = np.zeros_like(g), B @ u - g
        z = like(r)
        way, size = z.copy(), (r * z).sum(axis=0)
        enough = 1e-26 * np.maximum(*((v * like(v)).sum(axis=0) for v in (B @ u, np.ascontiguousarray(g))))
        for _ in range(_MOST_STEPS):
            going = np.flatnonzero(size > enough)
            if len(going) == 0:
                break
            moved = self.factors.solve(B.T @ way[:, going])
            image = B @ moved + self.C @ way[:, going]
            step = size[going] / (way[:, going] * image).sum(axis=0)
            p[:, going] += step * way[:, going]
            u[:, going] -= step * moved
            r[:, going] -= step * image
            z = like(np.ascontiguousarray(r[:, going]))
            before, size[going] = size[going], (r[:, going] * z).sum(axis=0)
            way[:, going] = z + (size[going] / before) * way[:, going]
        out = np.zeros_like(load)
        out[self.moving], out[self.space.N :] = u, p
        return out


def _joined(tissue: Tissue, corners: Int32) -> csr_array:
    """(pressures, 4M): adds up what the tets of one region hold at a node. corners: (4, M) unknown of each corner."""
    mesh = tissue.mesh
    pair = mesh.tets.astype(np.int64) + len(mesh.nodes) * np.unique(mesh.region, return_inverse=True)[1][:, None]
    shared, place = np.unique(pair, return_inverse=True)
    ones = np.ones(pair.size)
    return csr_array((ones, (place.ravel(), corners.T.ravel())), shape=(len(shared), pair.size))
