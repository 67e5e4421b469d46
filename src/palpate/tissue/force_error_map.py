"""Where the elements are too coarse for the contact force: the mesh's estimated error all over the surface."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from palpate.arrays import ArrayLike, Float64, float64
from palpate.errors import DataError, MaterialError
from palpate.tissue.contact_patches import contacts
from palpate.tissue.discretization_error import DiscretizationError
from palpate.tissue.reference.linear_elasticity import FiniteElements
from palpate.tissue.spring_fitting import scattered_points, surface_normals
from palpate.tissue.tissue import AT_NODES, Tissue

MARGIN = 1.15
"""Estimates count so many times: on the coarsest meshes they are lower than the error (benchmarks/force_estimate.py)."""
FEWEST, MOST = 24, 64  # places, if the caller gives none
CANDIDATES = 20  # random points for each place that is chosen
BATCH = 16  # places that are solved for together


@dataclass(frozen=True, eq=False)
class ForceErrorMap:
    """Estimated error of the contact force that the mesh makes, at places of a tissue's surface.

    Parameters
    ----------
    tissue : Tissue
        The solid.
    points : ndarray, (P, 3)
        Places on the surface, mm.
    estimate : ndarray, (P,)
        Error relative to the force of a push along the normal: positive if the force is too large.
    radius : float
        Radius of the contacts, mm.

    Examples
    --------
    >>> found = pp.force_error_map(tissue, radius=12, points=[top])
    >>> found.share(0.95) == abs(found.estimate[0])
    True
    """

    tissue: Tissue
    points: Float64
    estimate: Float64
    radius: float

    def share(self, share: float) -> float:
        """Return the size of the error that this share of the places does not exceed.

        Parameters
        ----------
        share : float
            Of the places: 0.5 for the median, 1 for the worst.

        Returns
        -------
        float
            Relative to the force.
        """
        return float(np.quantile(np.abs(self.estimate), share))

    @property
    def cautious(self) -> float:
        """1.15 times the error that 95 % of the places do not exceed: estimates are lower than errors on coarse meshes."""
        return MARGIN * self.share(0.95)

    def on_surface(self) -> Float64:
        """Return the estimate on all triangles of the surface.

        It is interpolated with weights that are Gaussian in the distance, half a radius wide.

        Returns
        -------
        ndarray, (F,)
            Of the triangles `tissue.mesh.surface`; NaN where a node is held.
        """
        triangles = self.tissue.mesh.surface
        middle = self.tissue.mesh.nodes[triangles].mean(axis=1)
        found = cKDTree(self.points).query(middle, k=min(8, len(self.points)))
        near, index = (np.asarray(each).reshape(len(middle), -1) for each in found)
        weight = np.exp(-2 * (near**2 - near[:, :1] ** 2) / max(self.radius, 1e-9) ** 2)
        values = (weight * self.estimate[index]).sum(axis=1) / weight.sum(axis=1)
        return np.where(self.tissue.held[triangles].any(axis=1), np.nan, values)

    def text(self) -> str:
        """Return a sentence for people.

        Returns
        -------
        str
            Median, 95 % and worst, and where the worst is.
        """
        worst = self.points[np.argmax(np.abs(self.estimate))]
        return (
            f"error of the force that the mesh makes, estimated at {len(self.points)} places for a contact radius of "
            f"{self.radius:.3g} mm: median {self.share(0.5):.1%}, at most {self.share(0.95):.1%} at 95 % of the places, "
            f"worst {self.share(1):.1%} at {np.round(worst, 1).tolist()} mm"
        )


def force_error_map(
    tissue: Tissue,
    radius: float | None = None,
    points: ArrayLike | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> ForceErrorMap:
    """Estimate over the surface how far the contact force is from the continuum's, without a finer mesh.

    The estimate is `answer.estimate.mesh` of a push along the inward normal, at each place.

    Parameters
    ----------
    tissue : Tissue
        The solid, with smoothed or P1 elements.
    radius : float, optional
        Radius of the contacts, mm. The default is two mean edges. The error grows with the square of edge over radius.
    points : array_like, (P, 3), optional
        Places on the surface, mm. The default is 24 to 64, about a radius apart, closer over inclusions of another stiffness,
        and a radius away from what is held, if there are such.
    progress : callable, optional
        Called with what is done and the share done.

    Returns
    -------
    ForceErrorMap
        The places and the estimates. `pp.plot_force_error` draws it.

    Raises
    ------
    DataError
        If the radius is not positive, or holds too many nodes, or a point lies off the surface.
    MaterialError
        If the tissue has another element, or all of the surface is held.

    Examples
    --------
    >>> found = pp.force_error_map(tissue, radius=12, points=[top])
    >>> bool(found.share(1) < 0.5)
    True
    """
    if tissue.element not in AT_NODES:
        raise MaterialError(f'element: "{tissue.element}" has no estimate; make the tissue with "smoothed" or "P1"')
    r = 2 * tissue.edge if radius is None else float(radius)
    if not (np.isfinite(r) and r > 0):
        raise DataError(f"radius: {radius} mm; give the radius of the contacts, above 0")
    x = spread_places(tissue, r) if points is None else float64("points", points, (None, 3))
    if len(x) == 0:
        raise DataError("points: no place given; give at least one")
    inward = -surface_normals(tissue, x)
    elements, error, estimate = FiniteElements(tissue), DiscretizationError(tissue), np.empty(len(x))
    for first in range(0, len(x), BATCH):
        found = [
            contacts(tissue, point, way, r)
            for point, way in zip(x[first : first + BATCH], inward[first : first + BATCH], strict=True)
        ]
        loads = np.concatenate([elements.loads(one) for one in found], axis=1)
        columns = elements.solve(loads)
        for k, one in enumerate(found):
            part = slice(3 * k, 3 * k + 3)
            C = loads[:, part].T @ columns[:, part]
            force = one.forces((C + C.T) / 2)
            u = (columns[:, part] @ force.ravel())[elements.nodal]
            estimate[first + k] = error(u, one, force)
            if progress:
                progress("estimating the mesh's error", (first + k + 1) / len(x))
    return ForceErrorMap(tissue, x, estimate, r)


def spread_places(tissue: Tissue, radius: float, seed: int = 0) -> Float64:
    """(P, 3) mm: surface points about `radius` apart, as far from each other as can be, and as far from held nodes.

    Within a radius of where the stiffness jumps they are half as far apart, and the first is the nearest to it: the error
    is larger in the tissue over a stiff lump. Where all of the surface lies closer to held nodes than a radius, the
    further half of it is taken.
    """
    mesh = tissue.mesh
    corners = mesh.nodes[mesh.surface]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    count = int(np.clip(2 * area / (np.pi * radius**2), FEWEST, MOST))
    x = scattered_points(tissue, CANDIDATES * count, seed)
    if len(tissue.fixed):
        apart = np.asarray(cKDTree(mesh.nodes[tissue.fixed]).query(x)[0])
        x = x[apart > min(radius, float(apart.max()) / 2)]
    jump = np.asarray(cKDTree(_jumps(tissue)).query(x)[0])  # infinite if there is none
    density = np.where(jump < radius, 2.0, 1.0)
    chosen = [int(np.argmin(jump))]
    far = np.linalg.norm(x - x[chosen[0]], axis=1)
    while len(chosen) < min(count, len(x)):
        chosen.append(int(np.argmax(density * far)))
        far = np.minimum(far, np.linalg.norm(x - x[chosen[-1]], axis=1))
    return np.asarray(x[chosen])


def _jumps(tissue: Tissue) -> Float64:
    """(n, 3) mm: nodes at which tetrahedra of different Young's moduli in different regions meet."""
    mesh = tissue.mesh
    low, high = np.full(len(mesh.nodes), np.inf), np.zeros(len(mesh.nodes))
    for region in np.unique(mesh.region):
        here = mesh.region == region
        young, nodes = float(tissue.young[here].mean()), np.unique(mesh.tets[here])
        low[nodes], high[nodes] = np.minimum(low[nodes], young), np.maximum(high[nodes], young)
    return np.asarray(mesh.nodes[high > 1.01 * low])
