"""What models are judged by: finite elements by scikit-fem, and the springs' own limit by conjugate gradients."""

import numpy as np
import skfem
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import cg
from skfem.helpers import dot, grad

from palpate.arrays import Bool, Float64, Int32
from palpate.errors import DataError
from palpate.studies.deformation.config import contact
from palpate.tissue.contact_patches import patch
from palpate.tissue.reference.linear_elasticity import FiniteElements
from palpate.tissue.sparse_factor import Factors
from palpate.tissue.tissue import AT_NODES, KPA, SpringLaw, Tissue


def pushed(truth: FiniteElements, name: str, radius: float, depth: float) -> tuple[Float64, Float64]:
    """Nodal displacement (N, 3) mm and force on the tool (3,) N of the cube under contact `name`, `depth` mm down."""
    point, r = contact(truth.tissue, name, radius)
    down = np.array([0.0, 0.0, -depth])
    if name == "patch":
        answer = truth.push(point, down, r)
        return answer.displacement, answer.force
    return solve_with_imposed_nodes(truth, patch(truth.tissue, point, r).nodes, down)


def solve_with_imposed_nodes(truth: FiniteElements, nodes: Int32, displacement: Float64) -> tuple[Float64, Float64]:
    """As `pushed`, with every node of `nodes` (with P2 also their edges' middles) moved by `displacement` (3,) mm."""
    moved = truth.nodal[nodes]
    if truth.element not in AT_NODES:
        mesh = truth.space.mesh
        moved = np.concatenate([moved, truth.space.edge_dofs[:, np.isin(mesh.edges, nodes).all(axis=0)].T])
    u = np.zeros(truth.K.shape[0])
    u[moved] = displacement
    free = np.setdiff1d(truth.free, moved.ravel())
    factors = Factors(truth.K[free][:, free], truth.space.doflocs[:, free[::3]].T)
    u[free] = factors.solve(-(truth.K @ u)[free])
    return u[truth.nodal], -(truth.K @ u)[moved].sum(axis=0)


def spring_limit(solid: Tissue, law: SpringLaw, point: Float64, radius: float, displacement: Float64) -> Float64:
    """(N, 3) mm: where sweeps over springs by the law must end, with the patch's mean prescribed.

    For cotangent edges and rows by distance: k_e from scikit-fem's Laplacian, home springs from the law as it is
    written, one scalar system, since the three axes do not know of each other.
    """
    if (law.weights, law.rows) != ("cotangent", "distance"):
        raise DataError(f"law: {law} has no limit by other means; take cotangent edges, rows by distance")
    mesh, spot = solid.mesh, patch(solid, point, radius)
    corners = np.ascontiguousarray(mesh.tets.T.astype(np.int64))
    tets = skfem.MeshTet(np.ascontiguousarray(mesh.nodes.T), corners, sort_t=False)
    space = skfem.Basis(tets, skfem.ElementTetP1())
    young = np.tile(solid.young[:, None] * KPA, space.dx.shape[1])
    L = csr_array(skfem.BilinearForm(lambda u, v, w: w.E * dot(grad(u), grad(v))).assemble(space, E=young))
    edge = -L
    edge.setdiag(0)
    edge.data[np.abs(edge.data) < 1e-12 * edge.data.max()] = 0
    edge.eliminate_zeros()  # across right angles there is no spring
    edge.data = np.maximum(edge.data, 0.05 * edge.data.mean())
    total = np.asarray(edge.sum(axis=1)).ravel()
    home = rsc(law, 1 + np.linalg.norm(mesh.nodes - mesh.nodes[spot.nodes].T @ spot.weights, axis=1) / solid.edge)
    home *= total / np.diff(edge.indptr)  # k_h is RSC times the mean of the node's own k_e
    system = csr_array(law.scale * (diags_array(total + home) - edge))
    free: Bool = ~solid.held
    K, w = system[free][:, free], np.zeros(len(mesh.nodes))
    w[spot.nodes] = spot.weights
    column, info = cg(K, w[free], rtol=1e-13, atol=0, maxiter=20_000, M=diags_array(1 / K.diagonal()))
    if info:
        raise DataError("springs: conjugate gradients did not converge; the system is singular")
    u = np.zeros_like(mesh.nodes)
    u[free] = np.outer(column / (w[free] @ column), displacement)
    return u


def rsc(law: SpringLaw, rows: Float64) -> Float64:
    """Home over edge stiffness at `rows` (N,), 1 at the contact."""
    if law.law == "uniform":
        return np.full_like(rows, law.rsc)
    return np.asarray(law.rsc * rows if law.law == "linear" else 1 - np.exp(law.rsc * rows))
