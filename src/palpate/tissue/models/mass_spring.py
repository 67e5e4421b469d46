"""Model `springs`: the mass-spring model of the dissertation, with home and edge springs."""

import numpy as np
from scipy.sparse import csr_array, diags_array

from palpate import _core
from palpate.arrays import Float64, Int32
from palpate.errors import DataError, MaterialError
from palpate.meshes.cutting.cut_mesh import refuse_cut
from palpate.tissue.contact_patches import Contacts
from palpate.tissue.models.ring_relaxation import (
    RingModel,
    best_relaxation,
    least_ritz_value,
    typical_contact,
    without_diagonal,
)
from palpate.tissue.tissue import KPA, SpringLaw, Tissue

ROUNDING = 1e-9  # relative to the stiffest edge: right angles have a smaller rounding error in any pose


class SpringModel(RingModel):
    """Home springs k_h tie each node to its rest position, edge springs k_e (u_j − u_i) to its neighbours.

    law.scale matches the force.

    law: None takes the tissue's fitted springs, or the exponential law where nothing was fitted. relaxation: ω of the
    sweep; None: chosen from the spectrum under a typical contact. rigid: every node of the patch goes with the tool,
    instead of their weighted mean; with radius 0 these are the touched triangle's nodes, the dissertation's contact.
    """

    def __init__(
        self, tissue: Tissue, law: SpringLaw | None = None, relaxation: float | None = None, rigid: bool = False
    ) -> None:
        refuse_cut(tissue.mesh, "springs")
        self.rigid = rigid
        self.law = law or tissue.springs or SpringLaw()
        K = edge_stiffness(tissue, self.law.weights) * self.law.scale
        start, column, value = without_diagonal(csr_array(K))
        held = tissue.held.view(np.uint8)

        def native(omega: float) -> "_core.relaxation.MassSpring":
            law = self.law.law, self.law.rsc, self.law.rows == "distance"
            return _core.relaxation.MassSpring(
                start, column, value, tissue.mesh.nodes, held, *law, tissue.edge, omega, rigid
            )

        omega = _relaxation(tissue, K, native(1.0)) if relaxation is None else float(relaxation)
        if not 0 < omega < 2:
            raise MaterialError(f"relaxation: {omega} diverges; give a number between 0 and 2")
        self.springs = native(omega)
        super().__init__(tissue, self.springs, omega)

    def solve(
        self, found: Contacts, state: "_core.tissue.ModelState", tolerance: float, most_sweeps: int
    ) -> tuple[Float64, float, int]:
        """As every ring model; raises `DataError` also where a node would have to go with two rigid tools."""
        nodes = np.concatenate([spot.nodes for spot in found.patches])
        if self.rigid and len(np.unique(nodes)) < len(nodes):
            shared = int(np.flatnonzero(np.bincount(nodes) > 1)[0])
            raise DataError(f"node {shared} lies under two rigid contacts; move them apart, or give smaller radii")
        return super().solve(found, state, tolerance, most_sweeps)

    def least_eigenvalue(self, state: "_core.tissue.ModelState") -> float:
        """1 − ρ with ρ ≤ Σk_e / (Σk_e + k_h) at every free node (Gershgorin): proven, as the contact stands."""
        return float(self.springs.contraction(state))


def edge_stiffness(tissue: Tissue, weights: str) -> csr_array:
    """(N, N) symmetric, N/mm: k_e of each edge, no diagonal.

    "equal": Young's modulus of the tets around the edge (volume-weighted mean) times the mean edge length.
    "cotangent": −Σ E V ∇φ_i·∇φ_j over these tets, the stiffness of the scalar Laplacian; where obtuse angles make it
    smaller than 5 % of the mean it is raised to that, so that no spring pushes. Across right angles, where it is zero
    but for rounding, there is no spring.
    """
    mesh = tissue.mesh
    pairs = [(a, b) for a in range(4) for b in range(a + 1, 4)]
    E = tissue.young * KPA
    if weights == "cotangent":
        slope = _shape_gradients(mesh.nodes, mesh.tets)
        value = np.stack([-E * mesh.volumes * np.einsum("ij,ij->i", slope[:, a], slope[:, b]) for a, b in pairs])
    else:
        value = np.stack([E * mesh.volumes] * len(pairs))
    ends = np.stack([mesh.tets[:, pair] for pair in pairs])
    shape = (len(mesh.nodes),) * 2

    def gathered(v: Float64) -> csr_array:
        one_way = csr_array((v.ravel(), (ends[..., 0].ravel(), ends[..., 1].ravel())), shape=shape)
        return csr_array(one_way + one_way.T)

    K = gathered(value)
    if weights == "cotangent":
        K.data[np.abs(K.data) < ROUNDING * K.data.max()] = 0
        K.eliminate_zeros()
        K.data = np.maximum(K.data, 0.05 * K.data.mean())
        return K
    volume = gathered(np.stack([mesh.volumes] * len(pairs)))
    K.data *= tissue.edge / volume.data
    return K


def _shape_gradients(nodes: Float64, tets: Int32) -> Float64:
    """(M, 4, 3) 1/mm: gradient of each corner's linear shape function."""
    edges = nodes[tets[:, 1:]] - nodes[tets[:, :1]]
    inner = np.linalg.inv(edges).transpose(0, 2, 1)
    return np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)


def _relaxation(tissue: Tissue, K: csr_array, model: "_core.relaxation.MassSpring") -> float:
    """ω from the spectrum while a typical contact is held."""
    state, spot = model.make_state(), typical_contact(tissue)
    model.relax(state, spot, np.zeros(3), 0)
    still = tissue.held.copy()
    still[spot.nodes] = True
    free = np.flatnonzero(~still)
    diagonal = (K.sum(axis=1) + model.home(state))[free]
    root = diags_array(1 / np.sqrt(diagonal))
    return best_relaxation(least_ritz_value(csr_array(root @ (diags_array(diagonal) - K[free][:, free]) @ root)))
