"""Model `multigrid`: conjugate gradients on linear finite elements, preconditioned by a multigrid V-cycle."""

from functools import cached_property

import numpy as np

from palpate import _core
from palpate.arrays import Float64, Int32
from palpate.errors import DataError, MaterialError
from palpate.tissue.contact_patches import Contacts
from palpate.tissue.error_bound import MOST_NODES, Certificate, relative
from palpate.tissue.models.block_gauss_seidel import ordered_by_node
from palpate.tissue.models.tissue_model import IterativeModel, nodal_element
from palpate.tissue.reference.linear_elasticity import lame, nodal_shear
from palpate.tissue.tissue import Tissue

QUICK = 3000  # nodes that may move: an iteration of more takes longer than a tick of 1 ms
MOST_INTERVAL = 10_000  # ticks
SAMPLES = 4  # contacts, of which new ones take the largest stiffness until theirs is known


class MultigridModel(IterativeModel):
    """Finite elements of the tissue's `element`, by conjugate gradients with a multigrid preconditioner.

    The preconditioner is that of P1 elements. For smoothed ones their λ is limited to 5 μ in it, since P1 locks.

    On meshes where an iteration takes longer than a tick, a thread iterates by the clock, for the stiffness of the contacts
    that there are; a tick multiplies with the newest. interval: the ticks that this takes in lockstep (`Session.step`); 0:
    the ticks themselves iterate. By default 0 up to `QUICK` nodes that may move, else 16.

    cell: edge of the finest lattice's cells in mean edges of the mesh. smoothing: sweeps of block over-relaxation on
    each level on the way down, and in reverse on the way up. relaxation: their ω. In a tick a sweep is an iteration.

    The error of an answer is certified, by factors of the stiffness, up to `MOST_NODES` nodes that may move
    (`certified`); beyond, it is an estimate from the preconditioner and the least eigenvalue of the preconditioned
    stiffness as Lanczos steps see it, halved for safety, but proven by nothing.
    """

    native: "_core.multigrid.MultigridModel | _core.multirate.LinearMultirateModel"
    linear_elasticity = True
    batch, growth = 3, 2

    def __init__(
        self,
        tissue: Tissue,
        cell: float = 1.9,
        smoothing: int = 3,
        relaxation: float = 1.4,
        interval: int | None = None,
    ) -> None:
        if not (np.isfinite(cell) and cell >= 1):
            raise MaterialError(f"cell: {cell} mean edges; give 1 or more (2 is quick, 1.9 surer)")
        if not 1 <= smoothing <= 100 or smoothing != int(smoothing):
            raise MaterialError(f"smoothing: {smoothing} sweeps; give a whole number from 1 to 100")
        if not 0 < relaxation < 2:
            raise MaterialError(f"relaxation: {relaxation} diverges; give a number between 0 and 2")
        if (tissue.poisson >= 0.5).any():
            raise MaterialError("poisson: 0.5 is incompressible, which needs a pressure; give this model at most 0.49")
        lam, mu = lame(tissue.young * tissue.mesh.filled, tissue.poisson)  # its own stiffness is P1's
        nodes, tets = np.ascontiguousarray(tissue.mesh.nodes), np.ascontiguousarray(tissue.mesh.tets, dtype=np.int32)
        held, sizes = tissue.held.view(np.uint8), (cell * tissue.edge, int(smoothing), float(relaxation))
        moving = int((~tissue.held).sum())
        interval = (0 if moving <= QUICK else 16) if interval is None else int(interval)
        if not 0 <= interval <= MOST_INTERVAL:
            raise DataError(f"interval: {interval} ticks; give 0 (iterate in the ticks) to {MOST_INTERVAL}, such as 16")
        self.iteration = _core.multigrid.MultigridModel(nodes, tets, lam, mu, held, *sizes, *self._stiffness(tissue))
        settings = {"cell": cell, "smoothing": smoothing, "relaxation": relaxation, "interval": float(interval)}
        super().__init__(tissue, self._beside(tissue, interval) if interval else self.iteration, settings)
        self.certified = moving <= MOST_NODES

    def _beside(self, tissue: Tissue, interval: int) -> "_core.multirate.LinearMultirateModel":
        mesh = tissue.mesh
        shear = nodal_shear(mesh, tissue.young, tissue.poisson)
        free = mesh.surface_nodes[~tissue.held[mesh.surface_nodes]]
        some = mesh.nodes[free[:: max(1, len(free) // SAMPLES)]]
        found = (tissue.surface.patch(tissue.surface.closest(x), 2 * tissue.edge) for x in some)
        samples = [patch for patch in found if not isinstance(patch, str)]
        return _core.multirate.LinearMultirateModel(self.iteration, interval, mesh.nodes, shear, samples)

    @property
    def iterated(self) -> "_core.multigrid.MultigridModel":
        """The model whose iterations answer a push."""
        return self.iteration

    @staticmethod
    def _stiffness(tissue: Tissue) -> tuple[Int32, Int32, Float64] | tuple[()]:
        """Block rows of K, in order; nothing for P1, whose K the preconditioner has."""
        if nodal_element(tissue) == "P1":
            return ()
        K = ordered_by_node(tissue)
        return K.indptr.astype(np.int32), K.indices.astype(np.int32), K.data

    def certified_error(self, state: "_core.tissue.ModelState", force: Float64, found: Contacts) -> float:
        """Bound on ‖u − u*‖_K/‖u*‖_K for the state that answers `found` with `force` (m, 3) N on the tools."""
        u: Float64 = np.array(state.u)
        inner = self.iteration.internal_force(u)
        residual = -(inner + found.weights(len(u)) @ force)
        residual[self.tissue.held] = 0
        if not residual.any():
            return 0.0
        energy = float(np.sqrt(max(float(np.vdot(u, inner)), 0.0)))
        return relative(self._distance(residual, u), energy)

    def _distance(self, residual: Float64, u: Float64) -> float:
        if self.certified:
            return self._certificate.distance(residual, u)
        squared = float(np.vdot(residual, self.iteration.precondition(residual)))
        return float(np.sqrt(max(squared, 0.0) / (0.5 * self._least)))

    @cached_property
    def _certificate(self) -> Certificate:
        return Certificate(ordered_by_node(self.tissue), self.tissue.held, self.tissue.mesh.nodes)

    @cached_property
    def _least(self) -> float:
        """The least eigenvalue of B K, from above, by 30 steps of conjugate gradients (their Lanczos matrix)."""
        u = np.zeros_like(self.tissue.mesh.nodes)
        r = np.random.default_rng(0).standard_normal(u.shape)
        r[self.tissue.held] = 0
        alphas: list[float] = []
        betas: list[float] = []
        p, before = np.zeros_like(u), 0.0
        for _ in range(30):
            z = self.iteration.precondition(r)
            now = float(np.vdot(r, z))
            if not now > 0:
                break
            if before:
                betas.append(now / before)
            p = z + (betas[-1] if betas else 0.0) * p
            Kp = self.iteration.internal_force(p)
            Kp[self.tissue.held] = 0
            alphas.append(now / float(np.vdot(p, Kp)))
            r = r - alphas[-1] * Kp
            before = now
        a, b = np.array(alphas), np.array(betas[: len(alphas) - 1])
        diagonal = 1 / a
        diagonal[1:] += b / a[:-1]
        off = np.sqrt(b) / a[:-1]
        return float(np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1))[0])
