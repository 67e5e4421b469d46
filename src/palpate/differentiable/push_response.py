"""Forces of a push and their derivatives by displacement and by the regions' stiffness, in NumPy."""

from functools import lru_cache

import numpy as np
from scipy.sparse import csr_array

from palpate.arrays import AnyArray, ArrayLike, Float64, float64
from palpate.errors import MaterialError
from palpate.tissue.contact_patches import Answer, contacts
from palpate.tissue.reference.linear_elasticity import FiniteElements, lame
from palpate.tissue.smoothed_elements import p1_stiffness, smoothed_stiffness
from palpate.tissue.tissue import AT_NODES, Tissue


class PushResponse:
    """The force F(d, E) of a tissue on m glued tools, by linear finite elements, and its derivatives.

    With the patches' weights W and their compliance C = Wᵀ K⁻¹ W, F = −C⁻¹ d. It is linear in d, and C is symmetric, so
    gᵀ ∂F/∂d is the force of a push by g. K = Σ E_r K_r is linear in the regions' moduli. With u(d) the displacement that a
    push by d makes, gᵀ ∂F/∂E_r = −u(g)ᵀ K_r u(d): one more push gives the derivatives by all moduli.

    Parameters
    ----------
    tissue : Tissue
        The solid. Its mesh, Poisson's ratios and fixed nodes count; the moduli come with each call.
    points : array_like, (m, 3) or (3,)
        Rest positions of the contacts on the surface, mm.
    radii : float or array_like (m,)
        Radii of the contacts, mm.

    Attributes
    ----------
    regions : ndarray, (R,)
        The region numbers of the mesh, ascending, which is the order of the moduli.

    Raises
    ------
    MaterialError
        If the element is not "smoothed" or "P1", or the tissue has attachments, or a patch is held.
    DataError
        If a contact lies off the surface.

    References
    ----------
    Adjoint derivatives of a solution: Cea, ESAIM: M2AN 20:371, 1986.

    Examples
    --------
    >>> response = PushResponse(tissue, top, radii=10)
    >>> response.force((0, 0, -2), (5, 50)).shape
    (3,)
    >>> by_displacement, by_young = response.gradient((0, 0, -2), (5, 50), (0, 0, 1))
    >>> bool(by_displacement[2] < 0 and by_young[0] > 0)  # a deeper push and a stiffer organ push back more
    True
    """

    def __init__(self, tissue: Tissue, points: ArrayLike, radii: ArrayLike) -> None:
        if tissue.element not in AT_NODES:
            raise MaterialError(
                f'element: "{tissue.element}" has no derivative; make the tissue with "smoothed" or "P1"'
            )
        if tissue.attachments:
            raise MaterialError("attachments: a differentiable push knows none; leave them out")
        x = float64("points", points)
        contacts(tissue, x, np.zeros_like(x), radii)  # refuses what cannot be, before the first push
        self.tissue, self.points, self.radii = tissue, x, radii
        self.regions = np.unique(tissue.mesh.region)
        self._elements = lru_cache(maxsize=1)(self._factored)  # a gradient follows the force at the same moduli

    def force(self, displacements: ArrayLike, young: ArrayLike) -> Float64:
        """Return the force on the tools.

        Parameters
        ----------
        displacements : array_like, (m, 3) or (3,)
            Of the contacts, mm.
        young : array_like, (R,)
            Young's modulus of each region, kPa.

        Returns
        -------
        ndarray, (m, 3) or (3,)
            The force of the tissue on each tool, N.

        Raises
        ------
        MaterialError
            If a modulus is not positive.
        DataError
            If a shape is wrong.
        """
        return self._push(displacements, young).force

    def gradient(self, displacements: ArrayLike, young: ArrayLike, cotangent: ArrayLike) -> tuple[Float64, Float64]:
        """Return the derivatives of Σ cotangent · force.

        Parameters
        ----------
        displacements : array_like, (m, 3) or (3,)
            Of the contacts, mm.
        young : array_like, (R,)
            Young's modulus of each region, kPa.
        cotangent : array_like, (m, 3) or (3,)
            Weight of each component of the force.

        Returns
        -------
        by_displacement : ndarray, (m, 3) or (3,)
            N/mm times the weight.
        by_young : ndarray, (R,)
            N/kPa times the weight.

        Raises
        ------
        MaterialError
            If a modulus is not positive.
        DataError
            If a shape is wrong.
        """
        pushed, adjoint = (self._push(d, young) for d in (displacements, cotangent))
        u, v = pushed.displacement.ravel(), adjoint.displacement.ravel()
        return adjoint.force, np.array([-(v @ (self._unit_stiffness(r) @ u)) for r in self.regions])

    def _push(self, displacements: ArrayLike, young: ArrayLike) -> Answer:
        moduli = float64("young", young, self.regions.shape)
        return self._elements(tuple(moduli.tolist())).push(self.points, displacements, self.radii)

    def _factored(self, young: tuple[float, ...]) -> FiniteElements:
        """The equilibrium with these moduli of the regions, kPa."""
        region: AnyArray = np.searchsorted(self.regions, self.tissue.mesh.region)
        return FiniteElements(self.tissue.replace(young=np.array(young)[region], springs=None, report=None))

    def _unit_stiffness(self, region: int) -> csr_array:
        """K_r (3N, 3N), N/mm per kPa. No cell of smoothed elements crosses regions, so that K is the sum of these."""
        mesh, made = self.tissue.mesh, smoothed_stiffness if self.tissue.element == "smoothed" else p1_stiffness
        return csr_array(made(mesh, *lame((mesh.region == region).astype(np.float64), self.tissue.poisson)))
