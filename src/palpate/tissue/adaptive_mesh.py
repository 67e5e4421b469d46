"""Meshes whose elements are fine enough for a wanted accuracy of the contact force."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from palpate.arrays import ArrayLike, Float64
from palpate.errors import DataError, MeshError, PalpateError
from palpate.meshes.stuffing.sizing_field import CELL, MOST_HALVINGS
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tetrahedralize import tetrahedralize
from palpate.tissue.boundary_conditions import resting_on
from palpate.tissue.force_error_map import MARGIN, ForceErrorMap, force_error_map, spread_places
from palpate.tissue.tissue import Tissue
from palpate.volumes.volume import Labels

ROUNDS = 6
WORST = 1.5  # times the error that is allowed at 95 % of the places may the worst be
AIM = 0.9  # of the error that is allowed: what is refined should then stay below
LEAST_STEP = 0.4  # of an element's size in one round
BASES = 12  # sizes of the coarsest elements that are tried, from `edge` down to half of it
OTHER_BASES = 4  # sizes that are tried where one gives no mesh


@dataclass(frozen=True, eq=False)
class AdaptiveMesh:
    """A mesh and how far it is from what was asked.

    mesh: the mesh. error: its estimated errors of the force, at places that had no part in choosing it. within: the
    error that was allowed, relative to the force. assumed: of the stiffness and the support, in words. rounds: meshes that
    were made. stopped: why no finer one was made, if `within` was not reached; else "".
    """

    mesh: TetMesh
    error: ForceErrorMap
    within: float
    assumed: str
    rounds: int
    stopped: str = ""

    @property
    def reached(self) -> bool:
        """Whether 1.15 times the estimate is at most `within` at 95 % of the places, and nowhere above 1.5 times it."""
        return _excess(self.error, self.within) <= 1

    def text(self) -> str:
        """For people."""
        over = np.flatnonzero(MARGIN * np.abs(self.error.estimate) > self.within)
        worst = over[np.argsort(-np.abs(self.error.estimate[over]))][:3]
        lines = [
            f"{len(self.mesh.nodes)} nodes, {len(self.mesh.tets)} tets after {self.rounds} rounds; assumed: {self.assumed}",
            self.error.text(),
            f"{'reached' if self.reached else 'not reached'}: {MARGIN:g} times the estimate is at most "
            f"{self.error.cautious:.1%} at 95 % of the places and {MARGIN * self.error.share(1):.1%} at the worst, where "
            f"{self.within:.1%} and {WORST * self.within:.1%} were asked",
        ]
        if len(over):
            places = "; ".join(
                f"{self.error.estimate[k]:.1%} at {np.round(self.error.points[k], 1).tolist()}" for k in worst
            )
            lines.append(f"{len(over)} of {len(self.error.points)} places are above; the worst estimates: {places} mm")
        if not self.reached:
            lines.append(f"no finer mesh was made: {self.stopped}")
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class _Sizes:
    """edge: mm, of the coarsest elements. at: shorter ones, and points near which they are wanted. limited: not as short
    as the estimates ask for."""

    edge: float
    at: dict[float, Float64] = field(default_factory=dict)
    limited: bool = False


def adaptive_mesh(
    labels: Labels,
    label: int | str,
    within: float = 0.03,
    edge: float = 4.0,
    radius: float | None = None,
    *,
    poisson: float = 0.45,
    stiffer: Mapping[int | str, float] | None = None,
    rest_on: ArrayLike = (0, 0, -1),
    most_tets: int = 150_000,
    progress: Callable[[str, float], None] | None = None,
    **options: Any,
) -> AdaptiveMesh:
    """Fill a label with tetrahedra that are small enough for a wanted accuracy of the contact force.

    The first mesh has one edge length. Each further one is finer about the places where 1.15 times the estimated error
    (`force_error_map`) exceeds what is allowed, h ∝ √(allowed/error) there, growing with the distance beyond a radius. Each
    mesh is judged at new places. The sizes of an octree are powers of two times the coarsest, which is chosen for the
    fewest tetrahedra.

    Parameters
    ----------
    labels : Labels
        The labels.
    label : int or str
        The organ, by number or name.
    within : float, optional
        Error of the force of a push along the normal that 95 % of the places may have, relative to the force; the worst may
        have 1.5 times as much.
    edge : float, optional
        Longest edge length, mm.
    radius : float, optional
        Radius of the contact, mm. The default is two edges. A session on the mesh must be given it, since its own default
        is two mean edges of the finer mesh.
    poisson : float, optional
        Poisson's ratio that is assumed. The error grows with it.
    stiffer : mapping, optional
        How many times stiffer than the organ some inclusions are. The default is 1.
    rest_on : array_like, (3,), optional
        Way to the table that is assumed to hold the organ.
    most_tets : int, optional
        Most tetrahedra, about.
    progress : callable, optional
        Called with what is done and the share done.
    **options
        As for `tetrahedralize`.

    Returns
    -------
    AdaptiveMesh
        The finest `mesh`, its estimated `error`, and whether it was `reached`. Its `text()` prints well.

    Raises
    ------
    DataError
        If a number is not valid, or as for `tetrahedralize` and `force_error_map`.
    MeshError
        As for `tetrahedralize`.

    References
    ----------
    Zienkiewicz & Zhu, Int. J. Numer. Methods Eng. 24:337, 1987: sizes from an estimated error.

    Examples
    --------
    >>> made = pp.adaptive_mesh(labels, "organ", within=0.1, edge=12)
    >>> made.reached
    True
    """
    say = progress or (lambda what, share: None)
    r = 2 * edge if radius is None else float(radius)
    for name, value, most in (("within", within, 1.0), ("radius", r, np.inf), ("most_tets", most_tets, np.inf)):
        if not 0 < value < most:
            raise DataError(
                f"{name}: {value}; give a number above 0" + (f" and below {most:g}" if most < np.inf else "")
            )
    ratios = _ratios(labels, stiffer or {}, options.get("inclusions", ()))
    assumed = ", ".join(
        [f"Poisson's ratio {poisson:g}", *(f"{labels.names.get(v, v)} {x:g} times stiffer" for v, x in ratios.items())]
    )
    way = np.asarray(rest_on, dtype=np.float64)
    assumed += f", rests on a table towards {','.join(f'{x:g}' for x in way.ravel())}"
    sizes, needs, first, best = _Sizes(edge), np.empty((0, 4)), None, None
    stopped = f"{ROUNDS} rounds are made at most"
    for number in range(1, ROUNDS + 1):
        say(f"mesh {number}", 0.0)
        try:
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always", UserWarning)
                mesh, sizes = _meshed(labels, label, sizes, options)
            say(f"mesh {number}", 1.0)
            young = {int(v): ratios.get(int(v), 1.0) for v in np.unique(mesh.region)}
            tissue = Tissue(mesh, young, poisson, resting_on(mesh, way))
            found = force_error_map(tissue, r, spread_places(tissue, r, seed=number), progress)
        except PalpateError as problem:  # no mesh of these sizes, or a contact of more nodes than models take
            if best is None:
                raise
            stopped = str(problem)
            break
        if best is None or _excess(found, within) < _excess(best.error, within):
            best, notes = AdaptiveMesh(mesh, found, within, assumed, number), said
        if best.reached or number == ROUNDS:
            break
        if sizes.limited:
            stopped = f"about {most_tets} tets are allowed (most_tets)"
            break
        first = mesh if first is None else first
        needs = np.concatenate([needs, _needed(found, sizes, needs, within)])
        sizes = _planned(first, needs, edge, r, most_tets)
    assert best is not None
    for warning in notes:
        warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
    return best if best.reached else replace(best, stopped=stopped)


def _excess(found: ForceErrorMap, within: float) -> float:
    """How far the map is from what is asked: at most 1 if it is reached."""
    return max(found.cautious, MARGIN * found.share(1) / WORST) / within


def _ratios(labels: Labels, stiffer: Mapping[int | str, float], inclusions: Sequence[int | str]) -> dict[int, float]:
    """How many times stiffer each named inclusion is, by its number."""
    known = {labels.value_of(key): key for key in inclusions}
    out = {}
    for key, ratio in stiffer.items():
        value = labels.value_of(key)
        if value not in known:
            raise DataError(
                f"stiffer: {key!r} is not among the inclusions {sorted(map(str, known.values()))}; name it there"
            )
        if not (np.isfinite(ratio) and ratio > 0):
            raise DataError(f"stiffer: {ratio} for {key!r}; give how many times stiffer than the organ it is, above 0")
        out[value] = float(ratio)
    return out


def _meshed(labels: Labels, label: int | str, sizes: _Sizes, options: Mapping[str, Any]) -> tuple[TetMesh, _Sizes]:
    """The mesh of these sizes, or of slightly smaller ones where their cells change size too near a surface."""
    for attempt in range(OTHER_BASES):
        scale = 1 - 0.04 * attempt
        smaller = replace(sizes, edge=scale * sizes.edge, at={scale * h: x for h, x in sizes.at.items()})
        try:
            return tetrahedralize(labels, label, smaller.edge, finer_at=smaller.at, **options), smaller
        except MeshError:
            if not sizes.at or attempt == OTHER_BASES - 1:
                raise
    raise AssertionError


def _needed(found: ForceErrorMap, sizes: _Sizes, needs: Float64, within: float) -> Float64:
    """(n, 4): places and the edge that each needs, mm, where the error is too large: it grows with the edge's square."""
    error = MARGIN * np.abs(found.estimate)
    over = error > within
    if not over.any():
        return np.empty((0, 4))
    x = found.points[over]
    now = _rounded(sizes.edge, _wanted(x, needs, sizes.edge, found.radius))
    step = np.maximum(np.sqrt(AIM * within / error[over]), LEAST_STEP)
    return np.column_stack([x, now * step])


def _wanted(x: Float64, needs: Float64, edge: float, radius: float) -> Float64:
    """(P,) mm at x (P, 3): the shortest edge that a place in `needs` asks for, growing with the distance from it.

    Strain varies as 1/d³ beyond a contact, so sizes ∝ d there cost few tets and keep the error of its own region.
    """
    out = np.full(len(x), edge)
    for place in needs:
        away = np.linalg.norm(x - place[:3], axis=1) / radius
        out = np.minimum(out, place[3] * np.maximum(away, 1))
    return np.asarray(np.maximum(out, edge / 2**MOST_HALVINGS))


def _rounded(base: float, wanted: Float64) -> Float64:
    """The largest power of two times `base`, at most `base`, that is no more than what is wanted."""
    halvings = np.clip(np.ceil(np.log2(base / wanted) - 1e-9), 0, MOST_HALVINGS)
    return np.asarray(base / 2**halvings, dtype=np.float64)


def _planned(mesh: TetMesh, needs: Float64, edge: float, radius: float, most_tets: int) -> _Sizes:
    """The sizes that meet the needs with the fewest tets, or as nearly as `most_tets` allow. mesh: the organ."""
    middle = mesh.nodes[mesh.tets].mean(axis=1)
    wanted = _wanted(middle, needs, edge, radius)

    def tets(base: float, coarser: float) -> float:
        here = _rounded(base, np.minimum(coarser * wanted, edge))
        return float((12 * mesh.volumes / (CELL * here) ** 3).sum())

    bases = edge / 2 ** (np.arange(BASES) / BASES)
    coarser = 1.0
    while min(tets(base, coarser) for base in bases) > most_tets and (coarser * wanted < edge).any():
        coarser *= 1.05
    base = min(bases, key=lambda base: tets(base, coarser))
    at, near = {}, cKDTree(middle)
    low, high = mesh.nodes.min(axis=0) - base, mesh.nodes.max(axis=0) + base
    for level in range(1, MOST_HALVINGS + 1):
        here = base / 2**level
        axes = [np.arange(a, b, here) for a, b in zip(low, high, strict=True)]
        x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        x = x[np.isfinite(near.query(x, distance_upper_bound=1.5 * edge)[0])]
        size = _rounded(base, np.minimum(coarser * _wanted(x, needs, edge, radius), edge))
        x = x[size <= here * (1 + 1e-9)]
        if len(x) == 0:
            break
        at[here] = x
    return _Sizes(float(base), at, coarser > 1)
