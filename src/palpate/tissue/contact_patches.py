"""Contacts: the smooth patch under each tool, and the answer to a push."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from palpate import _core
from palpate.arrays import ArrayLike, Float64, Int32, float64
from palpate.errors import DataError, MaterialError
from palpate.tissue.force_estimate import ForceEstimate
from palpate.tissue.frictional_contact import contact_states, sliding_forces
from palpate.tissue.tissue import Tissue

ModelErrors = tuple[float, float | None, float]


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer of a tissue to m contacts. For a single contact, force, realised and state have no leading axis.

    force: (m, 3) N of the tissue on the tool. displacement: (N, 3) mm. realised: (m, 3) mm, the weighted mean
    displacement of each patch. state: a contact's "stick" (always, if glued), "slide" or "open". error: certified bound
    on the distance to the exact solution of the model's own equations, in the energy norm, relative to that solution;
    the force's relative error along the push is at most about as large (of `neo-hookean` an estimate). warm: hand it
    to the next push to start from here. model_errors: what `estimate` calls for the parts of mesh and linearisation, and
    for what the stiffness' spread makes.
    """

    force: Float64
    displacement: Float64
    realised: Float64
    state: tuple[str, ...] | str
    error: float
    surface_nodes: Int32
    sweeps: int = 0
    warm: Any = None
    model_errors: Callable[[], ModelErrors] | None = None

    @cached_property
    def estimate(self) -> ForceEstimate | None:
        """Errors of the force, estimated when first asked for; None of a model that is not linear elasticity."""
        if self.model_errors is None:
            return None
        mesh, linearisation, spread = self.model_errors()
        return ForceEstimate(mesh, self.error, linearisation, spread)

    @property
    def corrected_force(self) -> Float64 | None:
        """(m, 3) N: `force` over 1 + `estimate.mesh`, without the mesh's estimated error. It is nearer to the continuum,
        and most so in a difference of two forces on one mesh, such as what a lump adds. None where `estimate` is.
        Such corrections of a functional: Pierce & Giles, SIAM Rev. 42:247, 2000."""
        return None if self.estimate is None else self.force / (1 + self.estimate.mesh)

    @property
    def surface_displacement(self) -> Float64:
        """(S, 3) mm, of the nodes `surface_nodes`, which are the mesh's."""
        return self.displacement[self.surface_nodes]


@dataclass(frozen=True, eq=False)
class Contacts:
    """The patches of a push, and the displacement (m, 3) mm that each is given. single: the caller gave one, bare.

    hits, radii: the patches' centres on the surface, and mm; references integrate over them. normals: (m, 3) unit,
    outwards, where contacts may slide and open with this friction; None: they are glued.
    """

    patches: "list[_core.tissue.ContactPatch]"
    displacement: Float64
    single: bool
    normals: Float64 | None = None
    friction: float = np.inf
    hits: "tuple[_core.tissue.SurfacePoint, ...]" = ()
    radii: tuple[float, ...] = ()

    def forces(self, C: Float64) -> Float64:
        """(m, 3) N of the tools on the tissue, C (3m, 3m) mm/N the compliance of their patches."""
        if self.normals is not None:
            return sliding_forces(C, self.displacement, self.normals, self.friction)
        return np.asarray(np.linalg.solve(C, self.displacement.ravel()), dtype=np.float64).reshape(-1, 3)

    def weights(self, nodes: int) -> Float64:
        """(N, m): column c holds the weights of contact c."""
        W = np.zeros((nodes, len(self.patches)))
        for column, patch in enumerate(self.patches):
            W[patch.nodes, column] = patch.weights
        return W

    def answer(
        self,
        tissue: Tissue,
        force: Float64,
        u: Float64,
        error: float,
        sweeps: int,
        warm: Any,
        model_errors: Callable[[], ModelErrors] | None = None,
    ) -> Answer:
        """The answer in the shape in which the caller asked."""
        realised = np.stack([p.weights @ u[p.nodes] for p in self.patches])
        surface = tissue.mesh.surface_nodes
        state = ("stick",) * len(self.patches)
        if self.normals is not None:
            state = contact_states(-force, self.normals, self.friction)
        if self.single:
            return Answer(force[0], u, realised[0], state[0], error, surface, sweeps, warm, model_errors)
        return Answer(force, u, realised, state, error, surface, sweeps, warm, model_errors)


def surface_point(tissue: Tissue, point: ArrayLike, radius: float) -> "_core.tissue.SurfacePoint":
    """The surface point nearest to `point` (3,) mm, for a contact of `radius` mm. Raises `DataError` as `patch` does."""
    x = float64("point", point, (3,))
    if not (np.isfinite(radius) and radius >= 0):
        raise DataError(f"radius: {radius} mm; give the tool's radius, 0 or more (1.5 to 3 edges of {tissue.edge:.3g})")
    hit = tissue.surface.closest(x)
    if hit.distance > max(radius, tissue.edge):
        raise DataError(
            f"point {x.tolist()} lies {hit.distance:.3g} mm off the surface; the nearest surface point is "
            f"{np.round(hit.point, 3).tolist()}"
        )
    return hit


def patch(tissue: Tissue, point: ArrayLike, radius: float) -> "_core.tissue.ContactPatch":
    """The contact patch of `radius` mm about the surface point nearest to `point` (3,) mm: `.nodes` and `.weights`.

    w_a = ∫N_a φ / ∫φ over the surface, φ = (1 − d²/r²)² where d < r, else 0: the weighted mean of nodal values is the
    field's own mean with the weight φ, and nodes just outside r have a share. Held nodes 0, sum 1; with no node inside,
    the barycentric weights of the point. Raises `MaterialError` for a patch of held nodes
    only, `DataError` for points off the surface and radii that are negative or hold more than 256 nodes.
    """
    return _patch_at(tissue, surface_point(tissue, point, radius), radius)


def _patch_at(tissue: Tissue, hit: "_core.tissue.SurfacePoint", radius: float) -> "_core.tissue.ContactPatch":
    found = tissue.surface.patch(hit, float(radius))
    if found == "held":
        raise MaterialError(
            f"contact at {np.round(hit.point, 3).tolist()}, radius {radius:g} mm: every node of the patch is held "
            f"still; touch elsewhere, or hold fewer nodes"
        )
    if found == "crowded":
        raise DataError(
            f"radius: {radius:g} mm holds more than {_core.tissue.ContactPatch.capacity} nodes of edge {tissue.edge:.3g} mm; "
            f"give a smaller radius (1.5 to 3 edges) or a coarser mesh"
        )
    assert isinstance(found, _core.tissue.ContactPatch)
    return found


def contacts(
    tissue: Tissue,
    points: ArrayLike,
    displacements: ArrayLike,
    radii: ArrayLike,
    normals: ArrayLike | None = None,
    friction: float = np.inf,
) -> Contacts:
    """The patches of a push. points, displacements: (m, 3) mm or one (3,). radii: (m,) mm or one for all.

    normals: (m, 3) or one (3,), out of the tissue, any length; None: the surface's. They matter for finite friction.
    """
    if not friction >= 0:
        raise DataError(f"friction: {friction}; give Coulomb's coefficient, 0 or more, or inf (glue)")
    x = float64("points", points)
    bare = x.ndim == 1
    x = np.atleast_2d(float64("points", x, (3,) if bare else (None, 3)))
    d = np.atleast_2d(float64("displacements", displacements, (3,) if bare else (len(x), 3)))
    r = float64("radii", radii)
    if r.ndim > 1 or (r.ndim == 1 and len(r) not in (1, len(x))):
        raise DataError(f"radii: expected one number or shape ({len(x)},), got {r.shape}")
    if len(x) == 0:
        raise DataError("points: no contact given; give at least one point")
    every = [float(radius) for radius in np.broadcast_to(r, len(x))]
    hits = tuple(surface_point(tissue, point, radius) for point, radius in zip(x, every, strict=True))
    patches = [_patch_at(tissue, hit, radius) for hit, radius in zip(hits, every, strict=True)]
    outwards = _unit_normals(tissue, x, normals, bare)
    sliding = outwards if np.isfinite(friction) else None
    found = Contacts(patches, np.ascontiguousarray(d), bare, sliding, friction, hits, tuple(every))
    _refuse_overlap(found, len(tissue.mesh.nodes), x)
    return found


def _unit_normals(tissue: Tissue, points: Float64, normals: ArrayLike | None, bare: bool) -> Float64:
    """(m, 3) outwards."""
    if normals is None:
        return np.stack([tissue.surface.normal(tissue.surface.closest(x)) for x in points])
    n = np.atleast_2d(float64("normals", normals, (3,) if bare else (len(points), 3)))
    length = np.linalg.norm(n, axis=1, keepdims=True)
    if not (length > 0).all():
        raise DataError(f"normals: that of contact {int(np.argmin(length))} is zero; give the way out of the tissue")
    return np.asarray(n / length)


def _refuse_overlap(found: Contacts, nodes: int, points: Float64) -> None:
    """Two patches of nearly the same weights cannot be moved apart by any force that a tool has."""
    if len(found.patches) < 2:
        return
    W = found.weights(nodes)
    W /= np.linalg.norm(W, axis=0)
    gram = W.T @ W
    if np.linalg.eigvalsh(gram)[0] > 1e-3:
        return
    np.fill_diagonal(gram, 0)
    a, b = (int(i) for i in np.unravel_index(np.argmax(gram), gram.shape))
    raise DataError(
        f"contacts {a} and {b} at {points[a].tolist()} and {points[b].tolist()} press the same nodes "
        f"({100 * gram[a, b]:.0f} % overlap); move them apart, or give smaller radii"
    )
