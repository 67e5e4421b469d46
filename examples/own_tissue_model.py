"""A tissue model of your own in one file: python examples/own_tissue_model.py

It is linear elasticity with fibres, such as muscle has: E_f (aᵀ ε a)²/2 is added to the energy, a the fibres' direction and
ε the strain. For the command:

    palpate --plugin examples/own_tissue_model.py touch tissue.vtu --model fibres
"""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

import palpate as pp
from palpate.tissue.models.python_model import PythonModel

KPA = 1e-3  # N/mm²


@pp.register_tissue_model("fibres")
class Fibres(PythonModel):
    """direction: (3,) of the fibres. fibres: E_f, kPa."""

    def __init__(self, tissue, direction=(1.0, 0.0, 0.0), fibres=20.0):
        super().__init__(tissue)
        self.stiffness = stiffness(tissue, np.array(direction) / np.linalg.norm(direction), fibres)
        free = np.ones((len(tissue.mesh.nodes), 3), bool)
        free[tissue.fixed] = False
        self.free = np.flatnonzero(free)
        self.factor = splu(self.stiffness[self.free][:, self.free].tocsc())

    def equilibrium(self, W, displacement):
        """By the compliance of the contacts, Wᵀ K⁻¹ W."""
        loads = np.kron(W, np.eye(3))[self.free]
        columns = self.factor.solve(loads)
        contact_stiffness = np.linalg.inv(loads.T @ columns)
        force = contact_stiffness @ displacement.ravel()
        u = np.zeros(3 * len(W))
        u[self.free] = columns @ force
        return u.reshape(-1, 3), -force.reshape(-1, 3), contact_stiffness


def stiffness(tissue, direction, fibres):
    """(3N, 3N) N/mm, sparse, of linear tetrahedra."""
    mesh = tissue.mesh
    x = mesh.nodes[mesh.tets]
    edges = x[:, 1:] - x[:, :1]
    inner = np.linalg.inv(edges).transpose(0, 2, 1)  # gradients of the last three barycentric coordinates
    G = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)  # (M, 4, 3) 1/mm
    volume = np.linalg.det(edges) / 6
    lam = KPA * tissue.young * tissue.poisson / (1 + tissue.poisson) / (1 - 2 * tissue.poisson)
    mu = KPA * tissue.young / 2 / (1 + tissue.poisson)
    blocks = np.einsum("m,mai,mbj->maibj", lam, G, G) + np.einsum("m,maj,mbi->maibj", mu, G, G)
    blocks += np.einsum("m,mak,mbk,ij->maibj", mu, G, G, np.eye(3))
    along = np.einsum("mak,k,i->mai", G, direction, direction)  # strain along the fibres of unit displacements
    blocks += KPA * fibres * np.einsum("mai,mbj->maibj", along, along)
    blocks *= volume[:, None, None, None, None]
    dofs = (3 * mesh.tets[:, :, None] + np.arange(3)).reshape(-1, 12)
    rows, columns = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
    size = 3 * len(mesh.nodes)
    return coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size)).tocsr()


def soft_ball():
    """A ball of 30 mm and 5 kPa, whose lower quarter is held."""
    grid = pp.Grid((21, 21, 21), (4, 4, 4), (-40, -40, -40))
    ball = np.linalg.norm(grid.points(np.argwhere(np.ones(grid.shape))), axis=1).reshape(grid.shape) < 30
    mesh = pp.tetrahedralize(pp.Labels(ball.astype(np.int32), grid), 1, edge=10.0)
    return pp.Tissue(mesh, 5.0, 0.4, pp.fixed_beyond(mesh, (0, 0, -15), (0, 0, -1)))


def main():
    """Gives the force, N, that pulls the top of a ball 3 mm along the fibres, and across."""
    tissue = soft_ball()
    top = tissue.mesh.nodes[tissue.mesh.nodes[:, 2].argmax()]
    pulled = {}
    for name, direction in (("along", (1, 0, 0)), ("across", (0, 1, 0))):
        model = pp.model(tissue, "fibres", direction=direction)
        pulled[name] = -model.push(top, (3, 0, 0), 8.0).force[0]
    return pulled


if __name__ == "__main__":
    for name, force in main().items():
        print(f"pulled {name} the fibres: {force:.3f} N")
