"""Fits springs to finite elements."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from palpate.arrays import ArrayLike, Float64
from palpate.errors import DataError, MaterialError
from palpate.meshes.cutting.cut_mesh import refuse_cut, touched_surface
from palpate.meshes.tet_mesh import TetMesh
from palpate.tissue.contact_patches import Answer
from palpate.tissue.models.mass_spring import SpringModel
from palpate.tissue.named_tissues import Named, named_materials, poisson_of, spread_of, young_of
from palpate.tissue.reference.linear_elasticity import FiniteElements
from palpate.tissue.reference.solver import finite_elements
from palpate.tissue.relaxation import Relaxation
from palpate.tissue.spring_fit_report import FitReport
from palpate.tissue.tissue import Constant, SpringLaw, Tissue
from palpate.tissue.vibration import Inertia

_SEARCH = {"uniform": (3e-3, 3.0), "linear": (1e-3, 1.0), "exponential": (3e-3, 2.0)}  # of |RSC0|, by its logarithm
_TRAINING, _HELD_OUT = 10, 8


def fit(
    mesh: TetMesh,
    young: Constant | None = None,
    poisson: Constant | None = None,
    fixed: ArrayLike = (),
    law: str = "exponential",
    weights: str = "cotangent",
    rows: str = "distance",
    element: str = "smoothed",
    radius: float | None = None,
    depth: float | None = None,
    progress: Callable[[str, float], None] | None = None,
    *,
    tissue: Named | None = None,
    relaxation: Relaxation | Mapping[int | str, Relaxation] | None = None,
    inertia: Inertia | None = None,
    stiffening: Constant = 0.0,
    young_spread: Constant | None = None,
) -> Tissue:
    """Return a tissue whose springs are as close to finite elements as their law allows.

    RSC₀ minimizes the difference of nodal displacements, and the scale that of forces, over 10 pushes along the
    inward normal.
    The report is on 8 other pushes.

    Parameters
    ----------
    mesh : TetMesh
        The solid.
    young, poisson, fixed : optional
        As for `Tissue`. A region without a value has that of its named tissue; without one, Poisson's ratio is 0.45.
    law, weights, rows : str, optional
        As for `SpringLaw`.
    element : {"smoothed", "P1", "P2", "mixed"}, optional
        Element of the tissue, and of the finite elements that its springs are fitted to.
    radius : float, optional
        Radius of the contacts, mm. The default is two mean edges.
    depth : float, optional
        Depth of the pushes, mm. The default is 5 % of the mesh's diagonal.
    progress : callable, optional
        Called with what is done and the share done.
    tissue : str or dict, optional
        Name of a tissue of `tissue_properties`, or a dict of names by region. What is given in numbers wins.
    relaxation : Relaxation or dict, optional
        How the stiffness relaxes, in sessions; `young` is what remains in the long term, and what springs are fitted to.
    inertia : Inertia, optional
        The mass, in sessions.
    stiffening : float, array_like (M,), or dict, optional
        Exponent of the shear energy at finite strain, as for `Tissue`. Springs are fitted to small strain.
    young_spread : float, array_like (M,), or dict, optional
        One standard deviation of the stiffness, kPa, as for `Tissue`. The default is that of the named tissues, where the
        stiffness is theirs.

    Returns
    -------
    Tissue
        With `springs` and `report`, and `materials` where tissues are named.

    Raises
    ------
    MaterialError
        If a constant or support is not valid, or Young's modulus is neither given nor known.
    DataError
        If a contact is not possible.
    MeshError
        If the mesh has been cut.

    References
    ----------
    Chen, PhD dissertation, University of Delaware, 2006, chapter 3.

    Examples
    --------
    >>> soft = pp.fit(mesh, young=5, poisson=0.4, fixed=pp.resting_on(mesh, (0, 0, -1)))
    >>> soft.springs.law
    'exponential'
    >>> pp.fit(mesh, tissue={"organ": "liver", "lump": "liver-carcinoma"}, fixed=soft.fixed).materials
    {1: 'liver', 2: 'liver-carcinoma'}
    """
    refuse_cut(mesh, "fit", "fit the tissue before it is cut")
    say = progress or (lambda what, share: None)
    materials = named_materials(mesh, tissue)
    E, nu = young_of(mesh, young, materials), poisson_of(mesh, poisson, materials)
    spread = spread_of(mesh, E, materials, young_spread)
    solid = Tissue(mesh, E, nu, fixed, element=element, materials=materials, stiffening=stiffening, young_spread=spread)
    start = SpringLaw(law, {"exponential": -0.1}.get(law, 0.1), weights, rows)
    size = float(np.linalg.norm(np.ptp(mesh.nodes, axis=0)))
    r = 2 * solid.edge if radius is None else radius
    d = 0.05 * size if depth is None else depth
    if not (np.isfinite(d) and d > 0):
        raise DataError(f"depth: {d} mm; give how deep the fit's contacts push, more than 0")
    points = scattered_points(solid, _TRAINING + _HELD_OUT)
    held_out = np.arange(len(points)) >= _TRAINING
    inward = -d * surface_normals(solid, points)
    say("finite elements", 0.0)
    truth = finite_elements(solid)
    true = []
    for k, (x, w) in enumerate(zip(points[~held_out], inward[~held_out], strict=True), 1):
        true.append(truth.push(x, w, r))
        say("finite elements", 0.4 * k / _TRAINING)
    springs = _fitted(solid, start, points[~held_out], inward[~held_out], r, true, say)
    say("report on other contacts", 0.8)
    report = compare(truth, SpringModel(solid, springs), points[held_out], tilt_half(inward[held_out]), r, d)
    say("springs fitted", 1.0)
    constants = (solid.young, solid.poisson, solid.fixed)
    return Tissue(
        mesh,
        *constants,
        element=element,
        springs=springs,
        report=report,
        materials=materials,
        relaxation=relaxation,
        inertia=inertia,
        stiffening=solid.stiffening,
        young_spread=spread,
    )


def compare(truth: FiniteElements, model: SpringModel, points: Float64, push: Float64, r: float, d: float) -> FitReport:
    """The report of `model` against `truth` on contacts at points (C, 3) mm, pushed by (C, 3) mm, radius r mm."""
    worst, rms, expected, found = [], [], [], []
    error_map = np.zeros(len(truth.tissue.mesh.nodes))
    for x, w in zip(points, push, strict=True):
        a, b = truth.push(x, w, r), model.push(x, w, r)
        gap = np.linalg.norm(a.displacement - b.displacement, axis=1)
        worst.append(gap.max())
        rms.append(np.sqrt((gap**2).mean()))
        expected.append(a.force)
        found.append(b.force)
        error_map = np.maximum(error_map, gap)
    arrays = (np.array(worst), np.array(rms), np.array(expected), np.array(found))
    return FitReport(truth.element, r, d, points, push, *arrays, error_map)


def scattered_points(tissue: Tissue, count: int, seed: int = 0) -> Float64:
    """(count, 3) mm: points at random over the surface that no held node borders, the same for each seed.

    Raises `MaterialError` when all of the surface is held.
    """
    places, surface, held = touched_surface(tissue.mesh, tissue.held)
    triangles = surface[~held[surface].any(axis=1)]
    if len(triangles) == 0:
        raise MaterialError("fixed: no room left to touch, all of the surface is held; hold fewer nodes")
    a, b, c = (places[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    rng = np.random.default_rng(seed)
    t = rng.choice(len(triangles), count, p=area / area.sum())
    s, q = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    return np.asarray((1 - s) * a[t] + s * (1 - q) * b[t] + s * q * c[t])


def surface_normals(tissue: Tissue, points: Float64) -> Float64:
    """(P, 3) outward unit normals at surface points (P, 3) mm."""
    surface = tissue.surface
    return np.stack([surface.normal(surface.closest(np.ascontiguousarray(x))) for x in points])


def _fitted(
    tissue: Tissue,
    start: SpringLaw,
    points: Float64,
    push: Float64,
    r: float,
    true: list[Answer],
    say: Callable[[str, float], None],
) -> SpringLaw:
    tried = 0

    def answers(law: SpringLaw) -> list[Answer]:
        model = SpringModel(tissue, law, relaxation=1.5)
        return [model.push(x, w, r) for x, w in zip(points, push, strict=True)]

    def law_of(log: float) -> SpringLaw:
        return replace(start, rsc=float(np.exp(log)) * (-1 if start.law == "exponential" else 1))

    def misfit(log: float) -> float:
        nonlocal tried
        tried += 1
        say("fitting the springs", 0.4 + 0.4 * tried / (tried + 10))  # some 20 trials
        pairs = zip(true, answers(law_of(log)), strict=True)
        return float(sum(((a.displacement - b.displacement) ** 2).sum() for a, b in pairs))

    low, high = np.log(_SEARCH[start.law])
    grid = np.linspace(low, high, 9)  # the misfit may have several local minima in this wide range
    best = int(np.argmin([misfit(g) for g in grid]))
    bounds = (grid[max(best - 1, 0)], grid[min(best + 1, 8)])
    law = law_of(float(minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 0.01}).x))
    f = np.array([a.force for a in true]).ravel()
    g = np.array([a.force for a in answers(law)]).ravel()
    return replace(law, scale=float(f @ g / (g @ g)))


def tilt_half(push: Float64) -> Float64:
    """The same pushes, the second half tilted by 45° towards the axis that is most perpendicular."""
    out = push.copy()
    for k, w in list(enumerate(push))[(len(push) + 1) // 2 :]:
        axis = np.eye(3)[int(np.argmin(np.abs(w)))]
        side = np.cross(w, axis)
        out[k] = (w + side * np.linalg.norm(w) / np.linalg.norm(side)) / np.sqrt(2)
    return out
