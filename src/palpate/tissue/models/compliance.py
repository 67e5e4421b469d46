"""Model `compliance`: linear finite elements by cached Green's functions."""

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.sparse import bsr_array, csr_array, eye_array
from scipy.sparse.linalg import LinearOperator, eigsh

from palpate import _core
from palpate.arrays import Float64, Int32
from palpate.errors import DataError, MaterialError
from palpate.meshes.display_surfaces import displayed_nodes
from palpate.tissue.body_gaps import gap_contact
from palpate.tissue.contact_patches import Contacts
from palpate.tissue.error_bound import relative
from palpate.tissue.gap_contact import GapContact
from palpate.tissue.linearisation_error import MOST_CONTACTS, LinearisationError
from palpate.tissue.models.tissue_model import TissueModel, nodal_element
from palpate.tissue.reference.linear_elasticity import FiniteElements
from palpate.tissue.regional_relaxation import CreepFit, creep_of
from palpate.tissue.relaxation import Relaxation
from palpate.tissue.sparse_factor import Factors
from palpate.tissue.tissue import Tissue
from palpate.tissue.vibration import Inertia, lowest_modes, nodal_mass

SCALING = 32  # roundings of an entry when the stiffness is scaled from both sides by triangular 3x3 blocks, at most


class ComplianceModel(TissueModel):
    """Linear finite elements of the tissue's `element`, "smoothed" or "P1": K is factored once, then columns of K⁻¹ made.

    memory: MB of tables that a state may keep; the least recently used go first. A push solves in double precision, as
    `finite_elements` does. The real-time loop takes the force from 3×3 blocks of K⁻¹ between the nodes of the patch, in
    single precision (they err by some 1e-5); by the clock, a thread makes them where the hand is going, and where it is
    late the last stiffness serves until they come, then fades into the exact one. If the tissue has a relaxation, the
    loop follows it at every node that has been touched; `push` answers for the long term. Where parts relax differently, the
    stiffness is factored at some values of the Laplace variable, and the loop follows the creep that these give: `creep`
    says how far that is off. If it has inertia, the loop moves
    it in its lowest modes, and adds what the others give (residual flexibility) with a lag.

    contact: whether the lips of cuts, and organs beside each other, press on each other where they meet, with the tissue's
    `surface_friction` (`GapContact`); they do not in tissue that relaxes or has inertia.

    Raises `MaterialError` if the stiffness is not positive definite, `DataError` on a memory that is not positive.
    """

    native: "_core.compliance.ComplianceModel"
    linear_elasticity = True
    attaches = True
    slides = True
    time_dependent = True
    creep: CreepFit | None = None  # of a tissue whose parts relax differently

    gaps: GapContact | None = None

    def __init__(self, tissue: Tissue, memory: float = 256.0, contact: bool = True) -> None:
        if not (np.isfinite(memory) and memory > 0):
            raise DataError(f"memory: {memory} MB; give how much the tables may take, such as 256")
        self.elements = self._finite_elements(tissue)
        self.factors = self.elements.factors
        self.factors.require_positive()
        self._free = np.full(len(tissue.mesh.nodes), -1, dtype=np.int32)
        self._free[~tissue.held] = np.arange(np.count_nonzero(~tissue.held))
        shown = displayed_nodes(tissue.mesh)
        self.vertices: Int32 = shown[~tissue.held[shown]]
        if tissue.attachments and (tissue.time_dependent or not contact):
            raise MaterialError("attachments: hold elastic tissue whose surfaces may meet (contact=True)")
        if contact and not tissue.time_dependent:
            self.gaps = gap_contact(tissue, self.factors, self._free[self.vertices])
        self.linear_elasticity = self.gaps is None
        super().__init__(tissue, self._in_time(tissue, int(memory * 2**20)), {} if contact else {"contact": 0.0})

    def _finite_elements(self, tissue: Tissue) -> FiniteElements:
        return FiniteElements(tissue, nodal_element(tissue))

    def _in_time(self, tissue: Tissue, budget: int) -> "_core.compliance.ComplianceModel":
        """The native model of an elastic body, of one that relaxes or swings, or of one whose parts relax differently."""
        body = (self._free, self.vertices, tissue.mesh.nodes, budget)
        if tissue.relaxation is None or tissue.relaxes_alike:
            one = tissue.relaxation
            if self.gaps is not None:
                return _core.compliance.ComplianceModel(self.factors.native, *body, self.gaps.native)
            table = one.table() if isinstance(one, Relaxation) else np.empty((0, 2))
            in_time = table if tissue.inertia is None else self._modes(tissue, tissue.inertia, table)
            return _core.compliance.ComplianceModel(self.factors.native, *body, in_time)
        self.creep = creep_of(tissue.relaxations.values())
        self._sampled = [self.factors, *(self._factors_at(tissue, s) for s in self.creep.samples[1:])]
        natives = [factors.native for factors in self._sampled]
        return _core.compliance.ComplianceModel(natives, *body, self.creep.times, self.creep.mix)

    def _factors_at(self, tissue: Tissue, s: float) -> Factors:
        """Of the stiffness at the Laplace variable s, 1/s."""
        constants = tissue.at_rate(s)
        factors = self._finite_elements(Tissue(tissue.mesh, *constants, tissue.fixed, element=tissue.element)).factors
        factors.require_positive()
        return factors

    def _modes(self, tissue: Tissue, inertia: Inertia, relaxation: Float64) -> "_core.compliance.VibrationModes":
        free = ~tissue.held
        mass = np.repeat(nodal_mass(tissue.mesh, inertia.density)[free], 3)
        K = csr_array(self.elements.K[self.elements.free][:, self.elements.free])
        frequencies, shapes = lowest_modes(K, mass, self.factors, inertia.modes)
        whole = np.zeros((len(tissue.mesh.nodes), len(frequencies), 3), dtype=np.float32)
        whole[free] = shapes.reshape(-1, 3, len(frequencies)).transpose(0, 2, 1)
        return _core.compliance.VibrationModes(frequencies, whole, inertia.damping, inertia.lag, relaxation)

    def solve(
        self, found: Contacts, state: "_core.tissue.ModelState", tolerance: float, most_sweeps: int
    ) -> tuple[Float64, float, int]:
        """Directly: the patches' compliance C = WᵀK⁻¹W, the forces by it, then their field, whose error is certified."""
        nodes, load = self.loads(found)
        whole = np.zeros((len(self.places), 3))
        force, pressed = self._forces(found, nodes, load)
        if self.gaps is not None:
            whole += (self.gaps.A @ pressed).reshape(-1, 3)
        whole[nodes] += (load @ force).reshape(-1, 3)
        u = self.factors.solve(whole.ravel())
        state.u[:] = 0
        state.u[~self.tissue.held] = u.reshape(-1, 3)
        return -force.reshape(-1, 3), self._certified_error(u, whole.ravel()), 0

    def held_forces(self, found: Contacts) -> Float64:
        """(m, 3) N of the tools on the tissue, without the field and its certificate."""
        return self._forces(found, *self.loads(found))[0].reshape(-1, 3)

    def _forces(self, found: Contacts, nodes: Int32, load: Float64) -> tuple[Float64, Float64]:
        """(3m,) N of the tools on the tissue, and (r,) N in the gaps."""
        if self.gaps is None:
            return found.forces(self.compliance(found)).ravel(), np.zeros(0)
        unknowns = (3 * nodes[:, None] + np.arange(3)).ravel()
        unit = np.zeros((3 * len(self.places), load.shape[1]))
        unit[unknowns] = load
        moved = self.factors.solve(unit)
        C = load.T @ moved[unknowns]
        C = (C + C.T) / 2

        def tools(displacement: Float64) -> Float64:
            return replace(found, displacement=displacement).forces(C)

        force, pressed = self.gaps.forces(C, moved, found.displacement, tools)
        return force.ravel(), pressed

    def model_errors(self, u: Float64, found: Contacts, force: Float64) -> tuple[float, float | None]:
        """What the mesh and linear strain make of the force (m, 3) N of the tools on the tissue, relative to it."""
        known = found.normals is None and len(found.patches) <= MOST_CONTACTS
        return self.discretization(u, found, force), self.linearisation(found, force) if known else None

    @cached_property
    def linearisation(self) -> LinearisationError:
        """Compares linear forces with those at finite strain."""
        return LinearisationError(self.tissue, self.factors, self.elements.element)

    def compliance(self, found: Contacts) -> Float64:
        """(3m, 3m) mm/N, symmetric: the mean displacements of the m patches under unit forces spread over them."""
        nodes, load = self.loads(found)
        C = load.T @ self.factors.native.partial_solve(nodes, load, nodes)
        return np.asarray((C + C.T) / 2)

    def loads(self, found: Contacts) -> tuple[Int32, Float64]:
        """Free numbers of the (n,) nodes that the patches touch, and (3n, 3m) their loads under unit forces."""
        W = found.weights(len(self.tissue.mesh.nodes))
        touched = np.flatnonzero(W.any(axis=1))
        return self._free[touched], np.asarray(np.kron(W[touched], np.eye(3)), dtype=np.float64)

    @property
    def places(self) -> Float64:
        """(free nodes, 3) mm."""
        return self.tissue.mesh.nodes[~self.tissue.held]

    def _certified_error(self, u: Float64, load: Float64) -> float:
        """As `RingModel.certified_error`: ‖r‖_{M⁻¹}/√λ over what is left of ‖u‖_K, what rounds in r included."""
        if not load.any():
            return 0.0
        K = self._stiffness
        terms = int(np.diff(K.indptr).max()) + 2
        absolute = csr_array((np.abs(K.data), K.indices, K.indptr), shape=K.shape)
        rounding = terms * 2.0**-53 * (absolute @ np.abs(u) + np.abs(load))
        residual = (np.abs(load - K @ u) + rounding).reshape(-1, 3)
        # M⁻¹ ≤ 1/(least eigenvalue of its block), so signs do not matter.
        square = float((residual**2).sum(axis=1) @ (1 / self._diagonal[1]))
        distance, length = float(np.sqrt(square / self._least)), float(np.sqrt(max(float(u @ load), 0.0)))
        return relative(distance, length)

    @cached_property
    def _stiffness(self) -> csr_array:
        free = self.elements.free
        return csr_array(self.elements.K[free][:, free])

    @cached_property
    def _diagonal(self) -> tuple[Float64, Float64]:
        """(n, 3, 3) diagonal blocks M of K and (n,) their least eigenvalues."""
        blocks = bsr_array(self._stiffness, blocksize=(3, 3))
        rows = np.repeat(np.arange(len(blocks.indptr) - 1), np.diff(blocks.indptr))
        diagonal = np.asarray(blocks.data[rows == blocks.indices])
        return diagonal, np.linalg.eigvalsh(diagonal)[:, 0]

    @cached_property
    def _least(self) -> float:
        """λ such that K − λM is positive definite, shown by a factorisation with all pivots positive."""
        K, (blocks, _) = self._stiffness, self._diagonal
        n = len(blocks)
        M = csr_array(bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=K.shape))
        inverse = LinearOperator(K.shape, matvec=self.factors.solve, dtype=np.float64)
        start = np.random.default_rng(0).standard_normal(K.shape[0])
        shift = 0.9 * float(eigsh(K, 1, M=M, sigma=0, OPinv=inverse, v0=start, tol=1e-2, return_eigenvectors=False)[0])
        # Scaled to unit diagonal blocks: those of a sliver that a cut has left may be a millionth of the others.
        root = np.linalg.inv(np.linalg.cholesky(blocks))
        scale = bsr_array((root, np.arange(n), np.arange(n + 1)), shape=K.shape)
        scaled, unit = csr_array(scale @ K @ scale.T), eye_array(K.shape[0], format="csr")
        rounding = SCALING * 2.0**-53 * float((abs(scale) @ abs(K) @ abs(scale).T).sum(axis=1).max())
        for _ in range(20):
            factors = Factors(csr_array(scaled - shift * unit), self.places)
            proven = shift - factors.slack - rounding
            if factors.positive and proven > 0.5 * shift:
                return proven
            shift *= 0.7
        raise MaterialError("the stiffness is all but singular: no error can be certified; hold more nodes")
