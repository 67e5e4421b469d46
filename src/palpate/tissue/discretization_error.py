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

SATURATION = 1.3
"""The error over what quadratic functions of the same mesh find of it: the median of `benchmarks.force_estimate --seed 3`."""
ROUNDS, ITERATIONS = 2, 4  # changes of p, and steps of conjugate gradients for each: more of them change little
SIDES = ((0, 1), (1, 2), (2, 0))  # of a surface triangle


class DiscretizationError:
    """Estimates the error of the contact force of linear finite elements, smoothed or P1, on the tissue's mesh.

    With u the displacement under the load f, and p = λ div u averaged over the cells of the nodes, the functional of two
    fields

        L(u, p) = 2 f(u) − ∫2μ ε(u):ε(u) − 2 ∫p div u + ∫p²/λ

    is stationary at the solution of the continuum, where it is the compliance f(u). A few rounds of Uzawa's method bring
    L close to that: L grows to its largest value over quadratic displacements (`HierarchicalBasis`), by some steps of
    conjugate gradients, and falls as nodal pressures fit the dilatation, with the diagonal ∫N_a (1/λ + 1/2μ) for the
    Schur complement. The first p is averaged once more between neighbours, since smoothed elements have pressure modes
    that alternate from node to node. The compliance on the mesh, f(u), is compared with the result. Quadratic functions find
    only a part of the error, in the median of random meshes and places 1 / `SATURATION`; the estimate is as much larger.

    Hierarchical estimates: R. E. Bank & R. K. Smith, SIAM J. Numer. Anal. 30 (1993) 921. Uzawa's method: H. C. Elman &
    G. H. Golub, SIAM J. Numer. Anal. 31 (1994) 1645.
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
        p, load = self._pressure(basis.slopes(z)), self._loads(found, force)
        for _ in range(ROUNDS):
            stress = basis.shear_stress(basis.slopes(z)) + p[:, :, None, None] * np.eye(3)
            z += basis.solve(load - basis.forces(stress), ITERATIONS)
            dilatation = np.trace(basis.slopes(z), axis1=2, axis2=3)
            value, change = self._functional(z, p, load, dilatation)
            p = p + change
        return SATURATION * (value / compliance - 1)

    def _pressure(self, slope: Float64) -> Float64:
        """(M, 4) N/mm² at the corners: λ times the mean dilatation of the cells. slope: of linear displacements."""
        cells = self.cells
        nodal = cells.lam * self._averaged(np.trace(slope[:, 0], axis1=1, axis2=2))
        return np.asarray(self._averaged(nodal[cells.node].mean(axis=1))[cells.node])

    def _averaged(self, values: Float64) -> Float64:
        """(cells,) mean over each node's cell of the values (M,) of the tets."""
        cells = self.cells
        return np.asarray(
            np.bincount(cells.node.ravel(), np.repeat(cells.volumes / 4 * values, 4)) / cells.node_volumes
        )

    def _functional(self, z: Float64, p: Float64, load: Float64, dilatation: Float64) -> tuple[float, Float64]:
        """L (N mm) once nodal pressures fit the dilatation, and their change (M, 4). p, dilatation: (M, 4) at corners."""
        cells, basis, volumes = self.cells, self.basis, self.cells.volumes
        shear = float((z * basis.forces(basis.shear_stress(basis.slopes(z)))).sum())
        work = np.einsum("ma,ab,mb,m->", p, MASS, dilatation, volumes, optimize=True)
        bulk = np.einsum("ma,ab,mb,m->", p, MASS, p, volumes * self._softness, optimize=True)
        excess = np.where(self.lam[:, None] > 0, p * self._softness[:, None] - dilatation, 0)
        nodal = np.bincount(cells.node.ravel(), ((excess @ MASS) * volumes[:, None]).ravel())
        schur = np.bincount(cells.node.ravel(), np.repeat(volumes / 4 * (self._softness + 0.5 / basis.mu), 4))
        value = 2 * float((load * z).sum()) - shear - 2 * work + bulk - (nodal**2 / schur).sum()
        return float(value), -(nodal / schur)[cells.node]

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
