"""Reference for small strain: linear elasticity by finite elements with direct solves."""

from functools import cached_property
from typing import Any

import numpy as np
import skfem
from scipy.sparse import csr_array
from skfem.helpers import ddot, sym_grad, trace

from palpate.arrays import ArrayLike, Float64, Int32
from palpate.errors import MaterialError
from palpate.meshes.cutting.cut_mesh import refuse_cut
from palpate.meshes.tet_mesh import TetMesh
from palpate.tissue.contact_patches import Answer, Contacts, contacts
from palpate.tissue.reference.surface_loads import surface_loads
from palpate.tissue.smoothed_elements import smoothed_stiffness
from palpate.tissue.sparse_factor import Factors
from palpate.tissue.tissue import AT_NODES, KPA, Tissue

_SHAPES = {
    "smoothed": skfem.ElementTetP1,
    "P1": skfem.ElementTetP1,
    "P2": skfem.ElementTetP2,
    "mixed": skfem.ElementTetP2,
}


@skfem.BilinearForm  # type: ignore[untyped-decorator]
def _elastic(u: Any, v: Any, w: Any) -> Any:
    """σ(u):ε(v) with σ = 2μ ε + λ tr(ε) I."""
    e = sym_grad(u)
    return 2 * w.mu * ddot(e, sym_grad(v)) + w.lam * trace(e) * trace(sym_grad(v))


def lame(young: ArrayLike, poisson: ArrayLike) -> tuple[Float64, Float64]:
    """Lamé's (λ, μ) in N/mm² from Young's modulus in kPa and Poisson's ratio."""
    E, nu = np.asarray(young, dtype=np.float64) * KPA, np.asarray(poisson, dtype=np.float64)
    return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))


def nodal_shear(mesh: TetMesh, young: ArrayLike, poisson: ArrayLike) -> Float64:
    """(N,) the largest μ of the tetrahedra at each node, N/mm². young: (M,) kPa. poisson: (M,)."""
    out = np.zeros(len(mesh.nodes))
    np.maximum.at(out, mesh.tets, lame(young, poisson)[1][:, None])
    return out


def basis(mesh: TetMesh, element: str = "P1") -> Any:
    """scikit-fem's basis of vector functions on a mesh: linear for "smoothed" and "P1", else quadratic."""
    tets = skfem.MeshTet(
        np.ascontiguousarray(mesh.nodes.T), np.ascontiguousarray(mesh.tets.T.astype(np.int64)), sort_t=False
    )
    return skfem.Basis(tets, skfem.ElementVector(_SHAPES[element]()), intorder=1 if element in AT_NODES else 2)


def stiffness(space: Any, young: Float64, poisson: Float64) -> csr_array:
    """K of linear elasticity on scikit-fem's basis `space`, N/mm. young: (M,) kPa. poisson: (M,).

    Raises `MaterialError` for ν = 0.5, which needs a pressure.
    """
    _refuse_incompressible(poisson)
    return assembled(space, *lame(young, poisson))


def _refuse_incompressible(poisson: Float64) -> None:
    if (poisson >= 0.5).any():
        raise MaterialError(
            f"poisson: 0.5 at tet {int(np.argmax(poisson))} can be solved with pressure as an unknown only: "
            f'pp.finite_elements(tissue, "mixed"); give this model up to 0.49'
        )


def assembled(space: Any, lam: Float64, mu: Float64) -> csr_array:
    """K for Lamé's (M,) constants in N/mm²."""
    points = space.dx.shape[1]
    K = _elastic.assemble(space, lam=np.tile(lam[:, None], points), mu=np.tile(mu[:, None], points))
    return csr_array(K)


class FiniteElements:
    """The elastic equilibrium of a tissue, factored once; `push` answers like a model, exactly.

    element: "smoothed", "P1" or "P2"; None: the tissue's own ("mixed" is `MixedElements`). The prescribed quantity is the
    patch's weighted mean displacement ∫φu/∫φ = Wᵀu = d, the force its multiplier, a traction with the density φ.
    """

    def __init__(self, tissue: Tissue, element: str | None = None) -> None:
        self.tissue = tissue
        self.element = tissue.element if element is None else element
        if self.element not in AT_NODES:
            refuse_cut(tissue.mesh, f'finite elements "{self.element}"')
        self.K = self._stiffness()
        self.free = np.setdiff1d(np.arange(self.K.shape[0]), self._held_unknowns())

    @cached_property
    def space(self) -> Any:
        """scikit-fem's basis."""
        return basis(self.tissue.mesh, self.element)

    @cached_property
    def nodal(self) -> Int32:
        """(N, 3) unknowns of each node."""
        if self.element in AT_NODES:  # in scikit-fem's order, without its basis
            return np.arange(3 * len(self.tissue.mesh.nodes), dtype=np.int32).reshape(-1, 3)
        return np.asarray(self.space.nodal_dofs.T)

    def _stiffness(self) -> csr_array:
        if self.element == "smoothed":
            _refuse_incompressible(self.tissue.poisson)
            return csr_array(smoothed_stiffness(self.tissue.mesh, *lame(self.tissue.young, self.tissue.poisson)))
        return stiffness(self.space, self.tissue.young * self.tissue.mesh.filled, self.tissue.poisson)

    @cached_property
    def factors(self) -> Factors:
        """Of the stiffness among the unknowns that are not held."""
        at_nodes = self.element in AT_NODES
        places = self.tissue.mesh.nodes[~self.tissue.held] if at_nodes else self.space.doflocs[:, self.free[::3]].T
        return Factors(self.K[self.free][:, self.free], places)

    def solve(self, load: Float64) -> Float64:
        """(unknowns, k) displacements under (unknowns, k) loads, held unknowns 0."""
        u = np.zeros_like(load)
        u[self.free] = self.factors.solve(load[self.free])
        return u

    def loads(self, found: Contacts) -> Float64:
        """(unknowns, 3m): column 3c+k is a unit force along axis k spread over patch c."""
        out = np.zeros((self.K.shape[0], 3 * len(found.patches)))
        if self.element in AT_NODES:
            W = found.weights(len(self.tissue.mesh.nodes))
            for k in range(3):
                out[self.nodal[:, k], k::3] = W
            return out
        for c, (hit, radius) in enumerate(zip(found.hits, found.radii, strict=True)):
            for k, column in enumerate(surface_loads(self.space, self.tissue, hit, radius).T):
                out[: self.space.N, 3 * c + k] = column
        return out

    def push(
        self,
        points: ArrayLike,
        displacements: ArrayLike,
        radii: ArrayLike,
        normals: ArrayLike | None = None,
        friction: float = np.inf,
        tolerance: float = 1e-3,
        warm: Any = None,
    ) -> Answer:
        """The exact answer of linear finite elements to m contacts; arguments as for every model's `push`."""
        found = contacts(self.tissue, points, displacements, radii, normals, friction)
        W = self.loads(found)
        columns = self.solve(W)
        C = W.T @ columns
        force = found.forces((C + C.T) / 2).ravel()
        u = columns @ force
        residual = self.K[self.free] @ u - W[self.free] @ force
        error = float(np.linalg.norm(residual) / max(float(np.linalg.norm(W[self.free] @ force)), 1e-300))
        return found.answer(self.tissue, -force.reshape(-1, 3), u[self.nodal], error, 0, None)

    def support_force(self, displacement: Float64) -> Float64:
        """(3,) N of the supports on a tissue whose nodes moved by `displacement` (N, 3) mm; for elements `AT_NODES`."""
        u = np.zeros(self.K.shape[0])
        u[self.nodal] = displacement
        force: Float64 = (self.K @ u)[self.nodal[self.tissue.fixed]].sum(axis=0)
        return force

    def _held_unknowns(self) -> Int32:
        held = [self.nodal[self.tissue.fixed].ravel()]
        if self.element not in AT_NODES:  # an edge between two fixed nodes is fixed
            still = self.tissue.held[self.space.mesh.edges].all(axis=0)
            held.append(self.space.edge_dofs[:, still].ravel())
        return np.concatenate(held)
