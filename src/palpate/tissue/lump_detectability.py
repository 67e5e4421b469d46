"""Maps of the force for equal depth, with and without a stiff region."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.arrays import ArrayLike, Bool, Float64, Int64, float64
from palpate.errors import DataError, MaterialError
from palpate.tissue.contact_patches import contacts, patch
from palpate.tissue.models.block_gauss_seidel import BlockModel
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.reference.linear_elasticity import FiniteElements
from palpate.tissue.reference.solver import finite_elements
from palpate.tissue.spring_fitting import surface_normals
from palpate.tissue.tissue import Tissue

THRESHOLDS = (
    (8, "compliance, pinch grasp, fixed displacement: Tan, Durlach, Beauregard & Srinivasan, Percept. Psychophys. 57 "
        "(1995) 495"),
    (15, "Young's modulus, bare finger on rubber; more than three times that without the skin's deformation: Bergmann "
         "Tiest & Kappers, IEEE Trans. Haptics 2 (2009) 189"),
    (22, "compliance, pinch grasp, displacement varied: Tan et al. 1995, as above"),
    (23, "stiffness, forearm matching: Jones & Hunter, Exp. Brain Res. 79 (1990) 150"),
)  # fmt: skip
"""Published difference a hand needs between two stiffnesses, % of the softer, least first, and where from."""

CHECKED = 4  # a push of the model takes as long as twenty by finite elements
CERTIFIED = 2e-5  # error of a model's push, certified


@dataclass(frozen=True, eq=False)
class LumpMap:
    """Force for equal depth with and without a stiff region.

    points, normals: (P, 3) mm and outward unit. stiff, plain: (P,) N along the inward normal by finite elements, with
    the region and with its surroundings in its place. checked: (Q,) indices of the points that the model was asked
    for too. model_stiff, model_plain: (Q,) N by the model `blocks`. mesh_stiff, mesh_plain: (Q,) its estimates of the
    mesh's error (`Answer.estimate`), relative to the force, where the region adds most; NaN elsewhere. depth, radius:
    mm of every push.
    """

    points: Float64
    normals: Float64
    stiff: Float64
    plain: Float64
    checked: Int64
    model_stiff: Float64
    model_plain: Float64
    mesh_stiff: Float64
    mesh_plain: Float64
    depth: float
    radius: float

    @property
    def difference(self) -> Float64:
        """(P,) share by which the region raises the force."""
        return np.asarray(self.stiff / self.plain - 1)

    @property
    def corrected_difference(self) -> Float64:
        """(Q,) the same at the points `checked`, with the mesh's estimated error taken out of both forces, where it is
        known; NaN elsewhere."""
        stiff, plain = self.stiff[self.checked], self.plain[self.checked]
        return np.asarray(stiff / (1 + self.mesh_stiff) / (plain / (1 + self.mesh_plain)) - 1)

    @property
    def model_gap(self) -> float:
        """Greatest error of the model's difference of force, relative to the greatest true difference."""
        true = (self.stiff - self.plain)[self.checked]
        return float(np.abs(self.model_stiff - self.model_plain - true).max() / np.abs(self.stiff - self.plain).max())

    def text(self) -> str:
        """What the map says, and whether a hand could feel it."""
        corrected = self.corrected_difference
        k = int(self.checked[np.nanargmax(corrected)])
        most = 100 * float(np.nanmax(corrected))
        below = [f"{percent} % ({what})" for percent, what in THRESHOLDS if percent <= most]
        above = [f"{percent} % ({what})" for percent, what in THRESHOLDS if percent > most]
        if not below:
            verdict = "below every published threshold: a hand could not tell it by force"
        elif not above:
            verdict = "above every published threshold: a hand could feel it"
        else:
            verdict = "between the published thresholds: a trained hand may feel it, not surely"
        return "\n".join(
            [
                f"pushed {self.depth:.3g} mm in with a patch of radius {self.radius:.3g} mm at {len(self.points)} "
                f"points, the lump raises the force by at most {100 * self.difference[k]:.1f} % ({self.plain[k]:.3f} to "
                f"{self.stiff[k]:.3f} N at {np.round(self.points[k], 1).tolist()} mm), by {most:.1f} % once the mesh's "
                f"estimated error is taken out",
                verdict,
                f"reached: {'; '.join(below) or 'none'}",
                f"not reached: {'; '.join(above) or 'none'}",
                f"the model `blocks` gives the difference of force within {100 * self.model_gap:.1f} % of its maximum "
                f"(at {len(self.checked)} points)",
            ]
        )


def force_map(
    tissue: Tissue,
    depth: float,
    radius: float,
    points: ArrayLike,
    solver: "FiniteElements | TissueModel | None" = None,
    progress: Callable[[float], None] | None = None,
) -> Float64:
    """Return the force of equal pushes at many surface points.

    Parameters
    ----------
    tissue : Tissue
        The solid.
    depth : float
        Depth along the inward normal, mm.
    radius : float
        Radius of the contact, mm.
    points : array_like, (P, 3)
        Surface points (x, y, z), mm.
    solver : FiniteElements or TissueModel, optional
        The default is finite elements. A model is solved until its certified error is 20 ppm.
    progress : callable, optional
        Called with the share done.

    Returns
    -------
    ndarray, (P,)
        Force along the normal, N.

    Raises
    ------
    DataError, MaterialError
        If a contact is not possible.

    Examples
    --------
    >>> pp.force_map(tissue, depth=2, radius=10, points=[top]).shape
    (1,)
    """
    x = float64("points", points, (None, 3))
    if not (np.isfinite(depth) and depth > 0):
        raise DataError(f"depth: {depth} mm; give how deep to push, more than 0")
    inward = -surface_normals(tissue, x)
    solver = finite_elements(tissue) if solver is None else solver
    force = np.empty(len(x))
    batch = 16 if isinstance(solver, FiniteElements) else 1
    for first in range(0, len(x), batch):
        part = slice(first, first + batch)
        if isinstance(solver, FiniteElements):
            force[part] = depth * _stiffness_along(solver, x[part], inward[part], radius)
        else:
            force[first] = (
                -solver.push(x[first], depth * inward[first], radius, tolerance=CERTIFIED).force @ inward[first]
            )
        if progress:
            progress(min(1.0, (first + batch) / len(x)))
    return force


def lump_map(
    tissue: Tissue,
    region: int | str,
    depth: float,
    radius: float,
    points: ArrayLike | None = None,
    most: int = 150,
    progress: Callable[[float], None] | None = None,
) -> LumpMap:
    """Compare the force of equal pushes with a stiff region and without it.

    "Without" gives the region the mean constants of the rest. The model `blocks` answers at the points where the region
    adds most, where it estimates the mesh's error, too, and at four others.

    Parameters
    ----------
    tissue : Tissue
        The solid.
    region : int or str
        The stiff region.
    depth : float
        Depth along the inward normal, mm.
    radius : float
        Radius of the contact, mm.
    points : array_like, (P, 3), optional
        Surface points, mm. The default is up to `most` surface nodes: those closest to the region, and others.
    most : int, optional
        Number of default points.
    progress : callable, optional
        Called with the share done.

    Returns
    -------
    LumpMap
        Forces with and without; `text()` compares them with published thresholds of touch.

    Raises
    ------
    DataError, MaterialError
        If the region is unknown or a contact is not possible.

    Examples
    --------
    >>> found = pp.lump_map(tissue, "lump", depth=2, radius=10, points=[top])
    >>> bool(found.difference[0] > 0)
    True
    """
    plain = without_region(tissue, region)
    if points is None:
        points = _spread(tissue, most, radius, _centre(tissue, region))
    x = float64("points", points, (None, 3))
    say = progress or (lambda share: None)
    stiff = force_map(tissue, depth, radius, x, progress=lambda share: say(0.35 * share))
    even = force_map(plain, depth, radius, x, progress=lambda share: say(0.35 + 0.35 * share))
    order = np.argsort(-np.abs(stiff - even))
    others = order[CHECKED :: max(1, (len(order) - CHECKED) // CHECKED)][:CHECKED]
    strongest = [*order[:CHECKED], np.argmax(stiff / even)]
    checked = np.unique([*strongest, *others])
    normals = surface_normals(tissue, x)
    asked = (x[checked], -depth * normals[checked], radius, np.isin(checked, strongest))
    model_stiff, mesh_stiff = _answers(tissue, *asked, lambda share: say(0.7 + 0.15 * share))
    model_even, mesh_even = _answers(plain, *asked, lambda share: say(0.85 + 0.15 * share))
    return LumpMap(x, normals, stiff, even, checked, model_stiff, model_even, mesh_stiff, mesh_even, depth, radius)


def _answers(
    tissue: Tissue, points: Float64, pushes: Float64, radius: float, estimated: Bool, say: Callable[[float], None]
) -> tuple[Float64, Float64]:
    """Of each push the force along it, N, by the model `blocks`, and the mesh's relative error where `estimated`, or NaN."""
    model, force, mesh = BlockModel(tissue), np.empty(len(points)), np.full(len(points), np.nan)
    for k, (point, push) in enumerate(zip(points, pushes, strict=True)):
        answer = model.push(point, push, radius, tolerance=CERTIFIED)
        force[k] = -answer.force @ push / np.linalg.norm(push)
        if estimated[k] and answer.estimate:
            mesh[k] = answer.estimate.mesh
        say((k + 1) / len(points))
    return force, mesh


def without_region(tissue: Tissue, region: int | str) -> Tissue:
    """The same tissue with the volume-weighted mean constants of the rest in place of `region`'s."""
    inside = _inside(tissue, region)
    volume = tissue.mesh.volumes[~inside]
    young, poisson = tissue.young.copy(), tissue.poisson.copy()
    young[inside] = np.average(tissue.young[~inside], weights=volume)
    poisson[inside] = np.average(tissue.poisson[~inside], weights=volume)
    return Tissue(tissue.mesh, young, poisson, tissue.fixed, element=tissue.element)


def _stiffness_along(solver: FiniteElements, x: Float64, way: Float64, radius: float) -> Float64:
    """(P,) N/mm along `way` of each contact alone: wᵀ C⁻¹ w, C the 3×3 compliance of its patch."""
    loads = np.concatenate([solver.loads(contacts(solver.tissue, p, np.zeros(3), radius)) for p in x], axis=1)
    columns = solver.solve(loads)
    out = np.empty(len(x))
    for k, w in enumerate(way):
        mine = slice(3 * k, 3 * k + 3)
        out[k] = w @ np.linalg.solve(loads[:, mine].T @ columns[:, mine], w)
    return out


def _inside(tissue: Tissue, region: int | str) -> Bool:
    numbers = {name: number for number, name in tissue.mesh.names.items()}
    number = numbers.get(region, -1) if isinstance(region, str) else region
    inside = tissue.mesh.region == number
    if not inside.any() or inside.all():
        present = ", ".join(f"{r} ({tissue.mesh.names.get(int(r), 'no name')})" for r in np.unique(tissue.mesh.region))
        raise MaterialError(f"region {region!r} is nowhere or everywhere in the mesh; its regions are {present}")
    return np.asarray(inside)


def _spread(tissue: Tissue, most: int, radius: float, centre: Float64) -> Float64:
    """Up to `most` surface nodes: the dozen nearest `centre`, then always the one farthest from those taken."""
    surface = tissue.mesh.surface_nodes[~tissue.held[tissue.mesh.surface_nodes]]
    x = tissue.mesh.nodes[surface]
    chosen: list[Float64] = []
    apart = np.full(len(x), np.inf)
    for k in [*np.argsort(np.linalg.norm(x - centre, axis=1))[:12], *[-1] * len(x)]:
        k = int(np.argmax(apart)) if k < 0 else k
        if len(chosen) == most or apart[k] == 0:
            break
        apart = np.minimum(apart, np.linalg.norm(x - x[k], axis=1))
        try:
            patch(tissue, x[k], radius)
        except MaterialError:  # all nodes of the patch are fixed
            continue
        chosen.append(x[k])
    return np.array(chosen)


def _centre(tissue: Tissue, region: int | str) -> Float64:
    inside = _inside(tissue, region)
    centres = tissue.mesh.nodes[tissue.mesh.tets[inside]].mean(axis=1)
    return np.asarray(np.average(centres, axis=0, weights=tissue.mesh.volumes[inside]))
