"""Contact compliance where the stiffness of a part changes many times, from one factorisation of the whole."""

import numpy as np
from scipy.sparse import csr_array

from palpate.arrays import ArrayLike, Bool, Float64
from palpate.errors import MaterialError
from palpate.meshes.tet_mesh import TetMesh
from palpate.tissue.contact_patches import contacts
from palpate.tissue.reference.linear_elasticity import FiniteElements, lame
from palpate.tissue.smoothed_elements import p1_stiffness, smoothed_stiffness
from palpate.tissue.spring_fitting import surface_normals
from palpate.tissue.tissue import AT_NODES, Tissue

COLUMNS = 192  # solved together


class StiffnessUpdate:
    """The forces of equal pushes on a tissue whose stiffness changes in some tetrahedra only, exact for each change.

    With K = K₀ + ΔK, and ΔK among few unknowns S: Wᵀ K⁻¹ W = Wᵀ K₀⁻¹ W − Yᵀ ΔK (1 + G ΔK)⁻¹ Y, where Y = (K₀⁻¹ W)_S and
    G = (K₀⁻¹)_SS (Sherman, Morrison & Woodbury; for finite elements Akgün, Garcelon & Haftka, Int. J. Numer. Meth. Eng.
    50:1587, 2001). Each change then costs the solution of a dense system of size S.

    changed: (M,) the tetrahedra that may change. points: (P, 3) mm, where contacts of `radius` mm push along the inward
    normal. Raises `MaterialError` if the element is not "smoothed" or "P1", or none or all tetrahedra change.
    """

    def __init__(self, tissue: Tissue, changed: Bool, points: ArrayLike, radius: float) -> None:
        if tissue.element not in AT_NODES:
            raise MaterialError(f'element: "{tissue.element}" has no update; make the tissue with "smoothed" or "P1"')
        if not changed.any():
            raise MaterialError("changed: no tetrahedron; the lump lies outside the tissue's mesh")
        mesh, x = tissue.mesh, np.asarray(points, np.float64)
        self.tissue, self.inward = tissue, -surface_normals(tissue, x)
        elements = FiniteElements(tissue)
        loads = np.concatenate([elements.loads(contacts(tissue, p, np.zeros(3), radius)) for p in x], axis=1)
        # A cell of smoothed elements at a changed tetrahedron's node holds all tetrahedra about that node.
        around = np.isin(mesh.tets, np.unique(mesh.tets[changed])).any(axis=1)
        used, local = np.unique(mesh.tets[around], return_inverse=True)
        self._around = np.flatnonzero(around)
        self._part = TetMesh(mesh.nodes[used], local.reshape(-1, 4).astype(np.int32), mesh.region[around])
        free = np.repeat(~tissue.held[used], 3)
        self._free = np.flatnonzero(free)
        rows = elements.nodal[used].ravel()[free]
        solved = elements.solve(loads)
        self._Y = solved[rows]
        self._C = loads.T @ solved
        self._G = np.empty((len(rows), len(rows)))
        for first in range(0, len(rows), COLUMNS):
            some = rows[first : first + COLUMNS]
            unit = np.zeros((loads.shape[0], len(some)))
            unit[some, np.arange(len(some))] = 1
            self._G[:, first : first + COLUMNS] = elements.solve(unit)[rows]
        self._before = self._stiffness(tissue.young)

    def forces(self, young: Float64, depth: float) -> Float64:
        """(P,) N along the inward normal of a push of `depth` mm at each point alone. young: (M,) kPa."""
        change = self._stiffness(young) - self._before
        system = (change @ self._G).T  # G ΔK: both are symmetric
        system[np.diag_indices_from(system)] += 1
        answer = self._C - self._Y.T @ (change @ np.linalg.solve(system, self._Y))
        return self._along(answer, depth)

    def plain_forces(self, depth: float) -> Float64:
        """(P,) N of the unchanged tissue."""
        return self._along(self._C, depth)

    def _along(self, C: Float64, depth: float) -> Float64:
        out = np.empty(len(self.inward))
        for k, w in enumerate(self.inward):
            own = slice(3 * k, 3 * k + 3)
            out[k] = depth * (w @ np.linalg.solve((C[own, own] + C[own, own].T) / 2, w))
        return out

    def _stiffness(self, young: Float64) -> csr_array:
        """Of the part alone, among its free unknowns."""
        made = smoothed_stiffness if self.tissue.element == "smoothed" else p1_stiffness
        K = made(self._part, *lame(young[self._around], self.tissue.poisson[self._around]))
        return csr_array(K)[self._free][:, self._free]
