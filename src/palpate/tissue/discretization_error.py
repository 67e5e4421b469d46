"""How far the contact force of linear finite elements is from the continuum's: an estimate without a finer mesh."""

import numpy as np

from palpate import _core
from palpate.arrays import Float64, Int32
from palpate.tissue.contact_patches import Contacts
from palpate.tissue.hierarchical_basis import MASS, HierarchicalBasis
from palpate.tissue.reference.linear_elasticity import lame
from palpate.tissue.reference.surface_loads import composite_rule, patch_alignment
from palpate.tissue.smoothed_elements import smoothing_cells
from palpate.tissue.tissue import Tissue

ITERATIONS = 6  # of conjugate gradients; from there to convergence the estimate changes by some 0.5 % of the force
SIDES = ((0, 1), (1, 2), (2, 0))  # of a surface triangle


class DiscretizationError:
    """Estimates the error of the contact force of linear finite elements, smoothed or P1, on the tissue's mesh.

    With u the displacement under the load f, and p = λ div u averaged over the cells of the nodes, the functional of two
    fields

        L(u, p) = 2 f(u) − ∫2μ ε(u):ε(u) − 2 ∫p div u + ∫p²/λ

    is stationary at the solution of the continuum, where it is the compliance f(u). Two corrections bring L close to
    that: its largest value over quadratic displacements (`HierarchicalBasis`), approached by some steps of conjugate
    gradients, and the least over nodal changes of p, with the diagonal ∫N_a (1/λ + 1/2μ) for the Schur complement. The
    compliance on the mesh, f(u), is compared with the result.

    Hierarchical estimates: R. E. Bank & R. K. Smith, SIAM J. Numer. Anal. 30 (1993) 921.
    """

    def __init__(self, tissue: Tissue) -> None:
        self.tissue = tissue
        self.lam, mu = lame(tissue.young, tissue.poisson)
        self.cells = smoothing_cells(tissue.mesh, self.lam, mu)
        self.basis = HierarchicalBasis(tissue, self.cells, mu)
        self._softness = np.divide(1, self.lam, out=np.zeros_like(mu), where=self.lam > 0)  # p is 0 where λ is

    def __call__(self, u: Float64, found: Contacts, force: Float64) -> float:
        """Return the relative error of the force.

        Parameters
        ----------
        u : ndarray, (N, 3)
            Displacement of the nodes in equilibrium with the contacts, mm.
        found : Contacts
            The contacts.
        force : ndarray, (m, 3)
            Force of the tools on the tissue, N.

        Returns
        -------
        float
            Estimate of (force − F) / F, F the continuum's force for the same displacement of the tools.
        """
        basis = self.basis
        realised = np.stack([patch.weights @ u[patch.nodes] for patch in found.patches])
        compliance = float((realised * force).sum())
        if not compliance > 0:
            return 0.0
        z = np.zeros((len(basis.held), 3))
        z[: len(u)] = u
        p = self._pressure(basis.slopes(z))
        load = self._loads(found, force)
        stress = basis.shear_stress(basis.slopes(z)) + p[:, :, None, None] * np.eye(3)
        z += basis.solve(load - basis.forces(stress), ITERATIONS)
        slope = basis.slopes(z)
        shear = float((z * basis.forces(basis.shear_stress(slope))).sum())
        dilatation = np.trace(slope, axis1=2, axis2=3)
        volumes = self.cells.volumes
        work = np.einsum("ma,ab,mb,m->", p, MASS, dilatation, volumes, optimize=True)
        bulk = np.einsum("ma,ab,mb,m->", p, MASS, p, volumes * self._softness, optimize=True)
        functional = 2 * float((load * z).sum()) - shear - 2 * work + bulk - self._pressure_gain(p, dilatation)
        return float(functional / compliance - 1)

    def _pressure(self, slope: Float64) -> Float64:
        """(M, 4) N/mm² at the corners: λ times the mean dilatation of each node's cell. slope: of linear displacements."""
        cells = self.cells
        part = cells.volumes / 4 * np.trace(slope[:, 0], axis1=1, axis2=2)
        dilatation = np.bincount(cells.node.ravel(), np.repeat(part, 4)) / cells.node_volumes
        return np.asarray((cells.lam * dilatation)[cells.node])

    def _pressure_gain(self, p: Float64, dilatation: Float64) -> float:
        """N mm: by how much L falls if nodal pressures fit the dilatation (M, 4) at the corners."""
        cells, compressible = self.cells, self.lam > 0
        excess = np.where(compressible[:, None], p * self._softness[:, None] - dilatation, 0)
        nodal = np.bincount(cells.node.ravel(), ((excess @ MASS) * cells.volumes[:, None]).ravel())
        schur = np.bincount(
            cells.node.ravel(), np.repeat(cells.volumes / 4 * (self._softness + 0.5 / self.basis.mu), 4)
        )
        return float((nodal**2 / schur).sum())

    def _loads(self, found: Contacts, force: Float64) -> Float64:
        """(N + E, 3) N: the tools' tractions on each function of the basis."""
        out = np.zeros((len(self.basis.held), 3))
        for patch, hit, radius, F in zip(found.patches, found.hits, found.radii, force, strict=True):
            out[patch.nodes] += np.outer(patch.weights, F)
            rows, share = self._bubble_shares(hit, radius)
            np.add.at(out, rows, np.outer(share, F))
        out[self.basis.held] = 0
        return out

    def _bubble_shares(self, hit: "_core.tissue.SurfacePoint", radius: float) -> tuple[Int32, Float64]:
        """Rows of the edges under a patch, and ∫bφ/∫φ for their bubbles b; several entries of one edge add up."""
        triangles, at, density = _patch_quadrature(self.tissue, hit, radius)
        total = float(((density @ at.T) * ~self.tissue.held[triangles]).sum())
        rows = np.stack([self.basis.edges(triangles[:, side]) for side in SIDES])
        share = np.stack([density @ (4 * at[a] * at[b]) for a, b in SIDES])
        return rows.ravel(), share.ravel() / total


def _patch_quadrature(
    tissue: Tissue, hit: "_core.tissue.SurfacePoint", radius: float
) -> tuple[Int32, Float64, Float64]:
    """Triangles (T, 3) of a patch, barycentric points (3, q), and φ times their weights (T, q), mm²."""
    triangles = tissue.mesh.surface[tissue.surface.patch_triangles(hit, radius)]
    corner = tissue.mesh.nodes[triangles]
    offset, alignment = corner - hit.point, np.maximum(patch_alignment(tissue, hit)[triangles], 1e-9)
    if not (radius > 0 and (2 * (offset**2).sum(axis=2) < alignment * radius**2).any()):  # the patch is the point
        return tissue.mesh.surface[[hit.triangle]], hit.weights[:, None], np.ones((1, 1))
    local, weight = composite_rule()
    at = np.stack([1 - local.sum(axis=0), *local])
    x = np.einsum("cq,tcd->tqd", at, offset)
    falloff = np.clip(1 - 2 * (x**2).sum(axis=2) / ((alignment @ at) * radius**2), 0, None) ** 2
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    return triangles, at, falloff * weight * area[:, None]
