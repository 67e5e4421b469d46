"""The compliance of a cut body from the factors of the whole one: no new factorisation."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, csr_array, eye_array, kron

from palpate import _core
from palpate.arrays import ArrayLike, Bool, Float64, Int32, Int64
from palpate.errors import DataError, MaterialError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.tissue.contact_patches import Answer, Contacts, contacts
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.reference.linear_elasticity import lame
from palpate.tissue.smoothed_elements import p1_stiffness, smoothed_stiffness
from palpate.tissue.tissue import Tissue

LEAST_PIVOT = 1e-10  # of the entry before elimination: of a piece that comes free it is 0 but for rounding

MOST_UNKNOWNS = 12_000
ROUNDING = 1e-12  # of the largest entry of the stiffness


@dataclass(frozen=True, eq=False)
class _Part:
    """Some tetrahedra of a mesh, the nodes that they have alone, and their constants."""

    nodes: Float64
    tets: Int32
    region: Int32
    filled: Float64 | float
    lam: Float64
    mu: Float64

    def stiffness(self, element: str) -> bsr_array:
        """(3n, 3n) N/mm."""
        build = smoothed_stiffness if element == "smoothed" else p1_stiffness
        return build(self, self.lam, self.mu)


class CutCompliance:
    """Linear elasticity of a cut tissue, from the factors of the tissue before the cut.

    Let u be the displacement of the nodes that there were before, and u + δ that of their copies. The stiffness of the
    cut body in these unknowns is

        [K + ΔK, B; Bᵀ, D],

    K that of the whole body, ΔK the change of its own block: 0 for P1 elements, whose copies share out a tetrahedron's
    volume; not 0 for smoothed ones, since the blade splits the cells in which strain is averaged. ΔK and B stand on the
    nodes I of the cells that changed. With the forces λ = ΔK w + B δ on them, w = u on I, and G = K⁻¹ among I, what is
    left of the equilibrium K u + λ = f is small and dense:

        [−G, −1, 0; −1, ΔK, B; 0, Bᵀ, D] (λ, w, δ) = (−(K⁻¹f) on I, 0, f_δ).

    It is L S Lᵀ with S = −1 for λ and +1 for the others, all pivots of the right sign, since eliminating λ leaves
    G⁻¹ + ΔK. The compliance between two loads f and e is then fᵀK⁻¹e + z_fᵀ S z_e with z = L⁻¹ times the right-hand side.
    For P1, (λ, w) are eliminated by hand: S = D − BᵀG B, z = L⁻¹ (f_δ − BᵀK⁻¹f).

    model: of the tissue before. opened: what `cut` made of it. Raises `DataError` if that was another tissue, and
    `MaterialError` for a piece that hangs on too little.
    """

    def __init__(self, model: ComplianceModel, opened: Tissue) -> None:
        if not isinstance(opened.mesh, CutMesh) or isinstance(model.tissue.mesh, CutMesh):
            raise DataError("opened: give the model of a tissue before the cut, and what pp.cut made of that tissue")
        count = len(model.tissue.mesh.nodes)
        if not np.array_equal(opened.mesh.nodes[:count], model.tissue.mesh.nodes) or not np.array_equal(
            opened.mesh.origin[:count], np.arange(count)
        ):
            raise DataError("opened: was cut from another tissue than the model's")
        self.model, self.tissue, self.mesh = model, opened, opened.mesh
        self.whole = count
        self.copies: Int64 = np.flatnonzero(~opened.held[count:]) + count  # nodes with a δ
        self._assemble()

    def _assemble(self) -> None:
        rows, change, rounding = self._change()
        own = rows < self.whole
        blocks = change.reshape(len(rows), 3, len(rows), 3)
        both = (own[:, None] & own)[:, None, :, None]
        blocks[both & (np.abs(blocks) < rounding)] = 0  # what two equal sums leave
        moved = blocks[own][:, :, own].any(axis=(1, 2, 3)) | blocks[own][:, :, ~own].any(axis=(1, 2, 3))
        self.changed: Int64 = rows[own][moved]  # I
        at = np.concatenate([np.flatnonzero(own)[moved], np.flatnonzero(~own)])
        H = blocks[at][:, :, at].reshape(3 * len(at), 3 * len(at))
        n = 3 * len(self.changed)
        self.delta_k, self.B, self.D = H[:n, :n], H[:n, n:], H[n:, n:]
        self.smoothed = bool(self.delta_k.any())
        self.factor = self._factor()

    def _change(self) -> tuple[Int64, Float64, float]:
        """Free nodes (n,), whole ones first; (3n, 3n) N/mm, what the cut adds to the stiffness on u and δ of these; and
        N/mm below which a change is rounding."""
        before, mesh = self.model.tissue.mesh, self.mesh
        split: Bool = (mesh.share != 1) | (mesh.tets >= self.whole).any(axis=1)
        if not split.any():
            return np.empty(0, dtype=np.int64), np.zeros((0, 0)), 0.0
        near = np.zeros(self.whole, dtype=bool)
        near[before.tets[np.unique(mesh.parent[split])]] = True
        around = np.asarray(near[before.tets].any(axis=1))  # all tetrahedra of every cell that changes
        mine = around[mesh.parent]
        nodes = np.unique(np.concatenate([before.tets[around].ravel(), mesh.tets[mine].ravel()]))
        if 6 * len(nodes) > MOST_UNKNOWNS:
            raise DataError(
                f"opened: the cuts change {len(nodes)} nodes; from {MOST_UNKNOWNS // 6} on the cut body is factored sooner: "
                f'pp.model(opened, "compliance")'
            )
        place, element = mesh.nodes[nodes], self.model.elements.element

        def part(tissue: Tissue, kept: Int64) -> _Part:
            lam, mu = lame(tissue.young[kept], tissue.poisson[kept])
            filled = tissue.mesh.filled
            of_all = np.searchsorted(nodes, tissue.mesh.tets[kept]).astype(np.int32)
            share = filled if isinstance(filled, float) else filled[kept]
            return _Part(place, of_all, tissue.mesh.region[kept], share, lam, mu)

        old = part(self.model.tissue, np.flatnonzero(around)).stiffness(element)
        new = part(self.tissue, np.flatnonzero(mine)).stiffness(element)
        T = self._of_jumps(nodes)
        change = csr_array(T.T @ csr_array(new) @ T - csr_array(old))
        free = np.flatnonzero(~self.tissue.held[nodes])
        unknowns = (3 * free[:, None] + np.arange(3)).ravel()
        change = change[unknowns][:, unknowns]
        return nodes[free], change.toarray(), ROUNDING * float(np.abs(new.data).max())

    def _of_jumps(self, nodes: Int64) -> csr_array:
        """(3n, 3n): displacements of nodes from u and δ."""
        late = np.flatnonzero(nodes >= self.whole)
        first = np.searchsorted(nodes, self.mesh.origin[nodes[late]])
        size = (len(nodes), len(nodes))
        return csr_array(
            kron(eye_array(len(nodes)) + csr_array((np.ones(len(late)), (late, first)), size), eye_array(3))
        )

    def _factor(self) -> "_core.cutting.JumpFactor":
        """L and S. Raises `MaterialError` if a pivot all but vanishes."""
        G = self._between(self.changed)
        n, m = len(G), len(self.D)
        if self.smoothed:
            factor = _core.cutting.JumpFactor(2 * n + m)
            last = np.hstack([np.zeros((m, n)), self.B.T, self.D])
            good = factor.append(-G, -1.0, LEAST_PIVOT) and factor.append(
                np.hstack([-np.eye(n), self.delta_k]), 1.0, 0.0
            )  # ΔK may be 0 in some direction: no entry to compare with
        else:
            factor, good = _core.cutting.JumpFactor(m), True
            last = self.D - self.B.T @ G @ self.B
        if not (good and factor.append(np.ascontiguousarray(last), 1.0, LEAST_PIVOT)):
            raise MaterialError(
                "blade: leaves a piece that hangs on one edge or corner, or on nothing; hold more nodes"
            )
        return factor

    def _between(self, nodes: Int64) -> Float64:
        """(3n, 3n) mm/N: K⁻¹ among nodes of the whole body."""
        if len(nodes) == 0:
            return np.zeros((0, 0))
        free = self.model._free[nodes]
        G = self.model.factors.native.partial_solve(free, np.eye(3 * len(free)), free)
        return np.asarray((G + G.T) / 2)

    def reduced(self, load: Float64) -> tuple[Float64, Float64]:
        """Loads (N', 3, k) N on the cut body: K⁻¹f (N, 3, k) mm of the whole body, and z (r, k)."""
        k = load.shape[2]
        f = np.zeros((self.whole, 3, k))
        np.add.at(f, self.mesh.origin, load)
        g = np.zeros_like(f)
        free = ~self.model.tissue.held
        g[free] = self.model.factors.solve(f[free].reshape(-1, k)).reshape(-1, 3, k)
        jump, on = load[self.copies].reshape(-1, k), g[self.changed].reshape(-1, k)
        right = np.concatenate([-on, np.zeros_like(on), jump]) if self.smoothed else jump - self.B.T @ on
        return g, self.factor.reduce(np.ascontiguousarray(right))

    def compliance(self, found: Contacts) -> Float64:
        """(3m, 3m) mm/N of the patches."""
        load = self._loads(found)
        g, z = self.reduced(load)
        f = np.zeros_like(g)
        np.add.at(f, self.mesh.origin, load)
        C = np.einsum("nik,nil->kl", f, g, optimize=True) + z.T @ (self._sign[:, None] * z)
        return np.asarray((C + C.T) / 2)

    def displacement(self, load: Float64) -> Float64:
        """(N', 3) mm of the cut body under loads (N', 3) N."""
        _, z = self.reduced(load[:, :, None])
        x = self.factor.expand(z)[:, 0]
        n = 3 * len(self.changed)
        jump = x[len(x) - 3 * len(self.copies) :]
        force = x[:n] if self.smoothed else self.B @ jump
        f = np.zeros((self.whole, 3))
        np.add.at(f, self.mesh.origin, load)
        f[self.changed] -= force.reshape(-1, 3)
        free, u = ~self.model.tissue.held, np.zeros((len(self.mesh.nodes), 3))
        u[: self.whole][free] = self.model.factors.solve(f[free].ravel()).reshape(-1, 3)
        u[self.whole :] = u[self.mesh.origin[self.whole :]]
        u[self.copies] += jump.reshape(-1, 3)
        u[self.tissue.held] = 0
        return u

    def push(self, points: ArrayLike, displacements: ArrayLike, radii: ArrayLike) -> Answer:
        """The answer to glued contacts; arguments as for every model's `push`. Its `error` is not known: NaN."""
        found = contacts(self.tissue, points, displacements, radii)
        force = found.forces(self.compliance(found))
        u = self.displacement(self._loads(found) @ force.ravel())
        return found.answer(self.tissue, -force, u, float("nan"), 0, None)

    @property
    def _sign(self) -> Float64:
        """S, (r,)."""
        sign = np.ones(self.factor.size)
        sign[: 3 * len(self.changed) * self.smoothed] = -1
        return sign

    def _loads(self, found: Contacts) -> Float64:
        """(N', 3, 3m) N: unit forces spread over the patches."""
        W = found.weights(len(self.mesh.nodes))
        return np.asarray(np.einsum("nc,ij->nicj", W, np.eye(3)).reshape(len(W), 3, -1))

    @property
    def unknowns(self) -> int:
        """Rows of L."""
        return self.factor.size
