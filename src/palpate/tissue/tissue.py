"""Tissue: a mesh, its elastic constants, and its fixed nodes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from palpate import _core
from palpate.arrays import ArrayLike, Bool, Float64, Int32, as_numpy, float64
from palpate.errors import MaterialError
from palpate.meshes.cutting.cut_mesh import CutMesh, touched_surface
from palpate.meshes.tet_mesh import TetMesh
from palpate.tissue.attachment import Attachment
from palpate.tissue.boundary_conditions import rigid_rank
from palpate.tissue.regional_relaxation import at_rate, by_region
from palpate.tissue.relaxation import Relaxation
from palpate.tissue.spring_fit_report import FitReport
from palpate.tissue.vibration import Inertia

KPA = 1e-3  # N/mm² in a kPa
MOST_STIFFENING = 100.0
MOST_FRICTION = 10.0  # of surfaces on each other
ELEMENTS = ("smoothed", "P1", "P2", "mixed")
AT_NODES = ("smoothed", "P1")
"""Elements whose unknowns are the nodes' displacements alone. All real-time models take these, the references all."""

Constant = float | ArrayLike | Mapping[int, float] | Mapping[str, float] | Mapping[int | str, float]


@dataclass(frozen=True)
class SpringLaw:
    """How the springs of a tissue follow from its mesh. `fit` chooses the numbers.

    Parameters
    ----------
    law : {"uniform", "linear", "exponential"}, optional
        RSC = k_h / k_e as a function of the row r, which is 1 at the contact: RSC₀, RSC₀ r, or 1 − exp(RSC₀ r).
    rsc : float, optional
        RSC₀, no unit. It is negative for "exponential".
    weights : {"equal", "cotangent"}, optional
        Weights of the edge springs. "cotangent" are those of the scalar Laplacian on linear tetrahedra.
    rows : {"rings", "distance"}, optional
        Count r in rings of the mesh, as the dissertation does, or as 1 + distance from the contact in edge lengths.
    scale : float, optional
        Common factor of all springs, no unit.

    References
    ----------
    Chen, PhD dissertation, University of Delaware, 2006.

    Examples
    --------
    >>> pp.SpringLaw("uniform", rsc=0.05).weights
    'cotangent'
    """

    law: str = "exponential"
    rsc: float = -0.14
    weights: str = "cotangent"
    rows: str = "distance"
    scale: float = 1.0

    def __post_init__(self) -> None:
        for name, value, known in (
            ("law", self.law, ("uniform", "linear", "exponential")),
            ("weights", self.weights, ("equal", "cotangent")),
            ("rows", self.rows, ("rings", "distance")),
        ):
            if value not in known:
                raise MaterialError(f"{name}: {value!r} is not known; choose one of {', '.join(known)}")
        right = self.rsc < 0 if self.law == "exponential" else self.rsc > 0
        if not (np.isfinite(self.rsc) and right):
            sign = "negative" if self.law == "exponential" else "positive"
            raise MaterialError(f"rsc: {self.rsc} with the {self.law} law; give a {sign} number, or no node goes home")
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise MaterialError(f"scale: {self.scale} makes springs that push outwards; give a positive number")


@dataclass(frozen=True, eq=False, init=False)
class Tissue:
    """An elastic solid that can be pushed.

    Parameters
    ----------
    mesh : TetMesh
        The solid.
    young : float, array_like (M,), or dict
        Young's modulus, kPa: one number, one for each tetrahedron, or by region number or name.
    poisson : float, array_like (M,), or dict
        Poisson's ratio, no unit, 0 ≤ ν < 0.5; 0.5 is allowed with the mixed element.
    fixed : array_like
        Indices of the nodes that are held, or an (N,) mask.
    element : {"smoothed", "P1", "P2", "mixed"}, optional
        The finite element. "smoothed" (the default) has the unknowns of "P1", averages strain over edges and dilatation
        over nodes, and does not lock. "P1" is stiffer than the continuum, and locks near ν = 0.5. "P2" and "mixed" are
        for `finite_elements`, which is no real-time model.
    springs : SpringLaw, optional
        The springs that `fit` found.
    report : FitReport, optional
        The report of `fit`.
    materials : dict of int to str, optional
        Name of the tissue of each region, for those that `fit` was given by name.
    relaxation : Relaxation or dict, optional
        How the stiffness relaxes, in sessions; `young` is what remains in the long term. A dict gives the relaxation of
        regions, by number or name; the others do not relax.
    inertia : Inertia, optional
        The mass, in sessions.
    stiffening : float, array_like (M,), or dict, optional
        Exponent b of the shear energy at finite strain (Demiray's law), no unit, 0 to 100: one number, one for each
        tetrahedron, or by region number or name. 0 is neo-Hookean. Linear elasticity, the limit of small strain, does not
        depend on it.
    attachments : sequence of Attachment, optional
        Springs between places of the surface. The model `compliance` alone takes a tissue that has some.
    surface_friction : float, optional
        Coulomb's coefficient between surfaces that meet, no unit, 0 to 10: of organs beside each other, and of the lips of
        cuts. The default is 0: serous membranes are wet and smooth. In sessions, the model `compliance` alone knows of it.
    young_spread : float, array_like (M,), or dict, optional
        One standard deviation of `young`, kPa, as measured from person to person: one number, one for each tetrahedron, or
        by region number or name. Estimates of the force's error carry it to the force. The default is 0: as if it were
        known.

    Raises
    ------
    MaterialError
        If a constant is not that of a tissue, or the supports leave a rigid motion free.

    Examples
    --------
    >>> fixed = pp.resting_on(mesh, (0, 0, -1))
    >>> tissue = pp.Tissue(mesh, {"organ": 5, "lump": 50}, poisson=0.4, fixed=fixed)
    >>> bool(tissue.held.sum() == len(fixed))
    True
    """

    mesh: TetMesh
    young: Float64
    poisson: Float64
    fixed: Int32
    element: str
    springs: SpringLaw | None
    report: FitReport | None
    materials: dict[int, str]
    relaxation: Relaxation | dict[int, Relaxation] | None
    inertia: Inertia | None
    stiffening: Float64
    attachments: tuple[Attachment, ...]
    surface_friction: float
    young_spread: Float64

    def __init__(
        self,
        mesh: TetMesh,
        young: Constant,
        poisson: Constant,
        fixed: ArrayLike,
        *,
        element: str = "smoothed",
        springs: SpringLaw | None = None,
        report: FitReport | None = None,
        materials: Mapping[int, str] | None = None,
        relaxation: Relaxation | Mapping[int, Relaxation] | Mapping[int | str, Relaxation] | None = None,
        inertia: Inertia | None = None,
        stiffening: Constant = 0.0,
        attachments: Sequence[Attachment] = (),
        surface_friction: float = 0.0,
        young_spread: Constant = 0.0,
    ) -> None:
        modulus = constant_per_tet("young", young, mesh)
        ratio = constant_per_tet("poisson", poisson, mesh)
        exponent = constant_per_tet("stiffening", stiffening, mesh)
        spread = constant_per_tet("young_spread", young_spread, mesh)
        if (modulus <= 0).any():
            bad = int(np.argmin(modulus))
            raise MaterialError(
                f"young: {modulus[bad]:g} kPa at tet {bad}; give a positive stiffness (breast fat: 3.25)"
            )
        if element not in ELEMENTS:
            raise MaterialError(f"element: {element!r} is not built; choose one of {', '.join(ELEMENTS)}")
        _refuse_ratios(ratio, element)
        if not ((exponent >= 0) & (exponent <= MOST_STIFFENING)).all():
            bad = int(np.argmax((exponent < 0) | (exponent > MOST_STIFFENING)))
            raise MaterialError(
                f"stiffening: {exponent[bad]:g} at tet {bad}; give 0 (neo-Hookean) to {MOST_STIFFENING:g}, such as 5"
            )
        if not (np.isfinite(spread) & (spread >= 0)).all():
            bad = int(np.argmin(np.where(np.isfinite(spread), spread, -np.inf)))
            raise MaterialError(
                f"young_spread: {spread[bad]:g} kPa at tet {bad}; give a standard deviation of 0 or more"
            )
        held = _node_indices(fixed, len(mesh.nodes))
        if len(held) == len(mesh.nodes):
            raise MaterialError(
                "fixed: all nodes are held, so nothing can be pushed; hold those that rest on something"
            )
        _refuse_rigid_motions(mesh, held)
        for name, value in (
            ("young", modulus),
            ("poisson", ratio),
            ("stiffening", exponent),
            ("fixed", held),
            ("young_spread", spread),
        ):
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        for name, thing in (("mesh", mesh), ("element", element), ("springs", springs), ("report", report)):
            object.__setattr__(self, name, thing)
        object.__setattr__(self, "materials", dict(materials or {}))
        object.__setattr__(self, "relaxation", _relaxation_by_region(relaxation, mesh))
        object.__setattr__(self, "inertia", inertia)
        object.__setattr__(self, "attachments", tuple(attachments))
        check_surface_friction(surface_friction)
        object.__setattr__(self, "surface_friction", float(surface_friction))
        _refuse_negative_ratios(self)
        if inertia is not None and self.relaxation is not None and not self.relaxes_alike:
            raise MaterialError(
                "inertia: parts that relax differently cannot swing; give one relaxation for shear and bulk of all regions"
            )

    def replace(self, **changes: Any) -> "Tissue":
        """Return a tissue that is like this one but for what is given.

        Parameters
        ----------
        **changes
            Arguments of `Tissue`, by name.

        Returns
        -------
        Tissue
            The other tissue.

        Raises
        ------
        MaterialError
            As `Tissue` does.

        Examples
        --------
        >>> bool((tissue.replace(young=2 * tissue.young).young == 2 * tissue.young).all())
        True
        """
        kept = {field.name: getattr(self, field.name) for field in fields(self)}
        return Tissue(**{**kept, **changes})

    def _repr_html_(self) -> str:
        from palpate.tissue.tissue_card import tissue_card  # only a notebook asks

        return tissue_card(self)

    @property
    def time_dependent(self) -> bool:
        """Whether it relaxes or has inertia."""
        return self.relaxation is not None or self.inertia is not None

    @property
    def relaxes_alike(self) -> bool:
        """Whether one relaxation holds for shear and bulk of all regions."""
        return isinstance(self.relaxation, Relaxation) and self.relaxation.bulk

    @property
    def relaxations(self) -> dict[int, Relaxation]:
        """The relaxation of each region that relaxes."""
        return by_region(self.relaxation, self.mesh.region)

    def at_rate(self, s: float) -> tuple[Float64, Float64]:
        """Return the elastic constants at the Laplace variable s.

        Parameters
        ----------
        s : float
            1/s; 0 gives those of the long term, inf those just after a strain.

        Returns
        -------
        young, poisson : ndarray, (M,)
            Of the tetrahedra: Young's modulus, kPa, and Poisson's ratio.

        Examples
        --------
        >>> bool((tissue.at_rate(0)[0] == tissue.young).all())
        True
        """
        return at_rate(self.young, self.poisson, self.mesh.region, self.relaxations, s)

    @cached_property
    def held(self) -> Bool:
        """True where a node is held, (N,)."""
        mask = np.zeros(len(self.mesh.nodes), dtype=bool)
        mask[self.fixed] = True
        return mask

    @cached_property
    def surface(self) -> "_core.tissue.ContactSurface":
        """The boundary at rest, for nearest points and contact patches. It is native, immutable and thread-safe."""
        places, triangles, held = touched_surface(self.mesh, self.held)
        surface = _core.tissue.ContactSurface(places, np.ascontiguousarray(triangles), held.view(np.uint8))
        if isinstance(self.mesh, CutMesh):
            skin = self.mesh.skin
            surface.carry(self.mesh.tets[skin.tet], np.ascontiguousarray(skin.weight), self.held.view(np.uint8))
        return surface

    @cached_property
    def edges(self) -> Int32:
        """Pairs of nodes that share an edge, (E, 2), lower index first, sorted."""
        return mesh_edges(self.mesh)

    @cached_property
    def edge(self) -> float:
        """Mean edge length, mm."""
        ends = self.mesh.nodes[self.edges]
        return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean())


def _refuse_ratios(ratio: Float64, element: str) -> None:
    bad = (ratio < 0) | (ratio > 0.5 if element == "mixed" else ratio >= 0.5)
    if bad.any():
        at = int(np.flatnonzero(bad)[0])
        raise MaterialError(
            f"poisson: {ratio[at]:g} at tet {at}; element {element} needs 0 <= poisson < 0.5: for a nearly "
            f'incompressible tissue give 0.45, or up to 0.49; element="mixed" takes up to 0.5'
        )


def mesh_edges(mesh: TetMesh) -> Int32:
    """(E, 2) edges of a mesh, lower node index first, sorted, each once."""
    pairs = np.concatenate([mesh.tets[:, [a, b]] for a in range(4) for b in range(a + 1, 4)]).astype(np.int64)
    numbers = np.unique(pairs.min(axis=1) * len(mesh.nodes) + pairs.max(axis=1))  # whole pairs sort eight times slower
    return np.stack(np.divmod(numbers, len(mesh.nodes)), axis=1).astype(np.int32)


def constant_per_tet(name: str, value: Constant, mesh: TetMesh) -> Float64:
    """(M,) of a constant that is given as one number, for each tet, or by region; raises `MaterialError`."""
    count = len(mesh.tets)
    if not isinstance(value, Mapping):
        array = float64(name, value)
        if array.ndim == 0 or array.shape == (1,):
            return np.full(count, float(array.reshape(())))
        return float64(name, array, (count,)).copy()
    out = np.full(count, np.nan)
    numbers = {text: number for number, text in mesh.names.items()}
    present = sorted({int(r) for r in np.unique(mesh.region)})
    known = [f"{number} ({mesh.names[number]})" if number in mesh.names else str(number) for number in present]
    for key, constant in value.items():
        region = numbers.get(key) if isinstance(key, str) else int(key)
        if region not in present:
            raise MaterialError(f"{name}: the mesh has no region {key!r}; its regions are {', '.join(known)}")
        out[mesh.region == region] = float64(f"{name} of region {key!r}", constant, ())
    if np.isnan(out).any():
        missing = int(mesh.region[np.flatnonzero(np.isnan(out))[0]])
        raise MaterialError(f"{name}: region {missing} has no value; give one for each of {', '.join(known)}")
    return out


def _relaxation_by_region(value: Any, mesh: TetMesh) -> Relaxation | dict[int, Relaxation] | None:
    """By region number; one relaxation if all regions have the same."""
    if not isinstance(value, Mapping):
        return None if value is None else _refuse_relaxation(value, "relaxation")
    numbers = {text: number for number, text in mesh.names.items()}
    present = {int(region) for region in np.unique(mesh.region)}
    out = {}
    for key, one in value.items():
        region = numbers.get(key) if isinstance(key, str) else int(key)
        if region not in present:
            raise MaterialError(f"relaxation: the mesh has no region {key!r}; its regions are {sorted(present)}")
        out[region] = _refuse_relaxation(one, f"relaxation of region {key!r}")
    if set(out) == present and len(set(out.values())) == 1:
        return out[min(present)]
    return out or None


def _refuse_negative_ratios(tissue: Tissue) -> None:
    """Where shear alone relaxes, Poisson's ratio is least at once."""
    if tissue.relaxation is None or tissue.relaxes_alike:
        return
    ratio = tissue.at_rate(np.inf)[1]
    if ratio.min() < 0:
        bad = int(np.argmin(ratio))
        raise MaterialError(
            f"relaxation: with a bulk that does not relax, Poisson's ratio of tet {bad} is {ratio[bad]:.2g} just after a "
            f"strain ({tissue.poisson[bad]:g} in the long term); give a larger ratio, smaller shares, or let the bulk relax"
        )


def _refuse_relaxation(value: Any, what: str) -> Relaxation:
    if not isinstance(value, Relaxation):
        raise MaterialError(f"{what}: {value!r}; give a pp.Relaxation, such as pp.Relaxation((0.5,), (0.2,))")
    return value


def _node_indices(fixed: ArrayLike, count: int) -> Int32:
    array = as_numpy("fixed", fixed)
    if array.dtype == bool:
        if array.shape != (count,):
            raise MaterialError(f"fixed: a mask needs shape ({count},), got {array.shape}")
        return np.flatnonzero(array).astype(np.int32)
    if array.size == 0:
        raise MaterialError("fixed: no node is held, so the tissue would float away; pp.resting_on(mesh, direction)")
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise MaterialError(f"fixed: expected node indices or a mask, got shape {array.shape} {array.dtype}")
    if array.min() < 0 or array.max() >= count:
        raise MaterialError(f"fixed: node {int(array.max())} or {int(array.min())}; nodes are 0 to {count - 1}")
    return np.unique(array).astype(np.int32)


def check_surface_friction(friction: float) -> None:
    """Raises `MaterialError` for a coefficient that no surfaces have."""
    if not 0 <= friction <= MOST_FRICTION:
        raise MaterialError(f"surface_friction: {friction:g}; give 0 to {MOST_FRICTION:g}, such as 0.1")


def _refuse_rigid_motions(mesh: TetMesh, fixed: Int32) -> None:
    """A part joined through faces is held by three nodes not in a line; held parts hold the parts they touch."""
    parts, part = mesh.parts
    held = np.zeros(len(mesh.nodes), dtype=bool)
    held[fixed] = True
    members = [np.unique(mesh.tets[part == p]) for p in range(parts)]
    loose = list(range(parts))
    while loose:
        caught = [p for p in loose if rigid_rank(mesh.nodes[members[p][held[members[p]]]]) == 6]
        if not caught:
            p = loose[0]
            mine = members[p][held[members[p]]]
            raise MaterialError(
                f"fixed: {len(mine)} nodes held in part {p} of {parts} of the mesh ({len(members[p])} nodes from node "
                f"{int(members[p][0])}) leave {6 - rigid_rank(mesh.nodes[mine])} rigid motions free; hold three or "
                f"more nodes that are not on one line in each part, for example with pp.resting_on(mesh, (0, 0, -1))"
            )
        for p in caught:
            held[members[p]] = True
        loose = [p for p in loose if p not in caught]
