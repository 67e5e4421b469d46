"""Springs with rest length beside the linear ones: edges pull along themselves, k_e (|x_j - x_i| - l_0).

The chapter's force equation is not at hand. Its linear edge spring pulls with k_e (u_j - u_i) in every direction; one
with rest length has no resistance across itself at rest, and stiffens or softens as it turns.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array

from palpate.arrays import Float64, Int32
from palpate.errors import DataError
from palpate.report.tables import Row
from palpate.studies.deformation.config import DEPTH, Setting, contact, tissue
from palpate.studies.deformation.readings import MEASURES
from palpate.studies.deformation.reference import pushed
from palpate.studies.deformation.spring_laws import Field, spring_law, springs
from palpate.tissue.contact_patches import patch
from palpate.tissue.models.mass_spring import SpringModel, edge_stiffness
from palpate.tissue.reference.solver import finite_elements
from palpate.tissue.sparse_factor import Factors
from palpate.tissue.tissue import SpringLaw, Tissue

SEARCH = (0.004, 2.0)  # of |RSC0|
STEP = 1.0  # mm of a push that one load step takes
TOLERANCE = 1e-8  # of the force out of balance, relative to that of a spring pulled by the push
MOST_STEPS = 200  # of Newton's method
WAYS = {"push": 1.0, "pull": -1.0}
NAMES = ("node", "triangle")  # the contacts under which it is judged


@dataclass(frozen=True, eq=False)
class RestLengthSprings:
    """ends: (E, 2) nodes. stiffness: (E,) N/mm. home: (N,) N/mm. places: (N, 3) mm at rest. free: (F,) nodes."""

    ends: Int32
    stiffness: Float64
    home: Float64
    places: Float64
    free: Int32

    def energy(self, u: Float64) -> float:
        """N mm."""
        length, rest, _ = self._edges(u)
        return float(self.stiffness @ (length - rest) ** 2 + self.home @ (u**2).sum(axis=1)) / 2

    def force(self, u: Float64) -> Float64:
        """(N, 3) N that each node needs from outside: the gradient of the energy."""
        length, rest, way = self._edges(u)
        pull = (self.stiffness * (length - rest))[:, None] * way
        out = self.home[:, None] * u
        np.add.at(out, self.ends[:, 1], pull)
        np.add.at(out, self.ends[:, 0], -pull)
        return out

    def tangent(self, u: Float64, definite: bool) -> bsr_array:
        """(3F, 3F) N/mm. definite: without what a compressed spring takes from the stiffness across itself."""
        length, rest, way = self._edges(u)
        across = 1 - rest / length
        across = np.maximum(across, 0) if definite else across
        along = way[:, :, None] * way[:, None, :]
        block = self.stiffness[:, None, None] * (along + across[:, None, None] * (np.eye(3) - along))
        n, (a, b) = len(self.places), self.ends.T
        diagonal = self.home[:, None, None] * np.eye(3)
        np.add.at(diagonal, a, block)
        np.add.at(diagonal, b, block)
        row, column = np.concatenate([a, b, np.arange(n)]), np.concatenate([b, a, np.arange(n)])
        data = np.concatenate([-block, -block, diagonal])
        number = np.full(n, -1)
        number[self.free] = np.arange(len(self.free))
        row, column = number[row], number[column]
        keep = (row >= 0) & (column >= 0)
        row, column, data = row[keep], column[keep], data[keep]
        order = np.lexsort((column, row))
        start = np.searchsorted(row[order], np.arange(len(self.free) + 1))
        return bsr_array((data[order], column[order], start), shape=(3 * len(self.free),) * 2)

    def _edges(self, u: Float64) -> tuple[Float64, Float64, Float64]:
        """Length, length at rest, and direction from the first end to the second."""
        a, b = self.ends.T
        rest = np.linalg.norm(self.places[b] - self.places[a], axis=1)
        vector = (self.places + u)[b] - (self.places + u)[a]
        length = np.maximum(np.linalg.norm(vector, axis=1), 1e-9 * rest)
        return length, rest, vector / length[:, None]


def rest_length_push(
    solid: Tissue, law: SpringLaw, point: Float64, displacement: Float64, radius: float, rigid: bool
) -> Field:
    """As `SpringModel.push`, with the same home and edge stiffness. Raises `DataError` where Newton's method fails.

    The tool moves by steps of `STEP`; each is solved by Newton's method on the energy with a line search.
    """
    model = SpringModel(solid, law, relaxation=1.3, rigid=rigid)
    home = model.springs.home(model.push(point, displacement, radius).warm)
    K = edge_stiffness(solid, law.weights) * law.scale
    ends = solid.edges
    k = np.asarray(K[ends[:, 0], ends[:, 1]]).ravel()
    free = np.flatnonzero(~solid.held).astype(np.int32)
    system = RestLengthSprings(ends[k > 0], k[k > 0], home, solid.mesh.nodes, free)
    W = _constraints(solid, point, radius, rigid)
    u = np.zeros_like(solid.mesh.nodes)
    count = max(1, round(float(np.linalg.norm(displacement)) / STEP))
    for _ in range(count):
        wanted = np.tile(displacement / count, W.shape[1] // 3)
        u = _balanced(system, W, _moved(system, W, u, wanted))
    force = np.linalg.lstsq(W, system.force(u)[free].ravel())[0].reshape(-1, 3).sum(axis=0)
    return u, -force


def _constraints(solid: Tissue, point: Float64, radius: float, rigid: bool) -> Float64:
    """(3F, 3m): every touched node's displacement (rigid), or the patch's mean."""
    spot = patch(solid, point, radius)
    free = np.flatnonzero(~solid.held)
    columns = np.diag(spot.weights > 0).astype(np.float64) if rigid else spot.weights[:, None]
    W = np.zeros((len(free), 3, columns.shape[1], 3))
    for axis in range(3):
        W[np.searchsorted(free, spot.nodes), axis, :, axis] = columns
    return W.reshape(3 * len(free), -1)


def _factors(system: RestLengthSprings, u: Float64) -> Factors:
    """Of the tangent, or of its definite part where it is not."""
    places = system.places[system.free]
    full = Factors(system.tangent(u, definite=False), places)
    return full if full.positive else Factors(system.tangent(u, definite=True), places)


def _moved(system: RestLengthSprings, W: Float64, u: Float64, wanted: Float64) -> Float64:
    """`u` with the contacts moved by `wanted` (3m,), the rest following to first order."""
    columns = _factors(system, u).solve(W)
    out = u.copy()
    out[system.free] += (columns @ np.linalg.solve(W.T @ columns, wanted)).reshape(-1, 3)
    return out


def _balanced(system: RestLengthSprings, W: Float64, u: Float64) -> Float64:
    """The equilibrium near `u`, its contacts held where they are."""
    unit = float(system.stiffness.max()) * STEP
    for _ in range(MOST_STEPS):
        force = system.force(u)[system.free].ravel()
        factors = _factors(system, u)
        solved = factors.solve(np.column_stack([force, W]))
        multiplier = np.linalg.solve(W.T @ solved[:, 1:], W.T @ solved[:, 0])
        residual = force - W @ multiplier
        if np.abs(residual).max() <= TOLERANCE * unit:
            return u
        step = (solved[:, 1:] @ multiplier - solved[:, 0]).reshape(-1, 3)
        u = _lowered(system, u, step, float(residual @ step.ravel()))
    raise DataError("springs with rest length: no equilibrium found; push less far, or raise the home springs")


def _lowered(system: RestLengthSprings, u: Float64, step: Float64, slope: float) -> Float64:
    """The first of whole, half, quarter ... steps that lowers the energy as its slope promises (Armijo)."""
    energy, share = system.energy(u), 1.0
    while share > 1e-6:
        out = u.copy()
        out[system.free] += share * step
        if system.energy(out) <= energy + 1e-4 * share * slope + 1e-13 * abs(energy):
            return out
        share /= 2
    return out


def judged(setting: Setting) -> dict[str, list[Row]]:
    """The exponential law with rest length and without, each at its best of one list, held at the bottom.

    way: the push, or the pull of as much; linear springs and elements answer it with the negative displacement.
    `rest_length_force`: the force on the tool by RSC0, none where no equilibrium was found.
    """
    sizes = np.geomspace(*SEARCH, setting.rest_steps)
    laws = [spring_law("exponential", size, "equal") for size in sizes.tolist()]
    solid = tissue(setting.main, 0.3)
    truths = {p: finite_elements(tissue(setting.main, p), "P2") for p in setting.ratios}
    rows: list[Row] = []
    forces: list[Row] = []
    for name in NAMES:
        point, radius = contact(solid, name, setting.radius)
        linear = [springs(solid, law, name, setting.radius) for law in laws]
        true = {p: pushed(truth, name, setting.radius, DEPTH)[0] for p, truth in truths.items()}
        for way, sign in WAYS.items():
            tool = np.array([0.0, 0.0, -sign * DEPTH])
            rest = [_or_none(solid, law, point, tool, radius) for law in laws]
            for law, found, straight in zip(laws, rest, linear, strict=True):
                row = {"contact": name, "way": way, "rsc": law.rsc, "linear_n": float(sign * straight[1][2])}
                forces.append({**row, "force_n": None if found is None else float(found[1][2])})
            kept = [k for k, found in enumerate(rest) if found is not None]
            bent = np.stack([found[0] for found in rest if found is not None])
            for poisson, u in true.items():
                gap = np.linalg.norm(bent - sign * u, axis=2)
                straight_gap = np.linalg.norm(np.stack([field[0] for field in linear]) - u, axis=2)
                about = {"contact": name, "support": "bottom", "law": "exponential", "way": way, "poisson": poisson}
                rows += [about | row for row in _best(sizes[kept], gap, sizes, straight_gap)]
    return {"rest_length": rows, "rest_length_force": forces}


def _or_none(solid: Tissue, law: SpringLaw, point: Float64, tool: Float64, radius: float) -> Field | None:
    """Of the rigid contact; None where no equilibrium is found."""
    try:
        return rest_length_push(solid, law, point, tool, radius, rigid=True)
    except DataError:
        return None


def _best(bent: Float64, rest: Float64, straight: Float64, linear: Float64) -> list[Row]:
    """A row a measure. bent, straight: |RSC0|. rest, linear: the gaps at them, (sizes, N) mm."""
    rows = []
    for name, measure in MEASURES.items():
        k, j = int(np.argmin(measure(rest))), int(np.argmin(measure(linear)))
        found: Row = {"measure": name, "rsc": -float(bent[k]), "error_mm": float(measure(rest)[k])}
        found |= {"worst_mm": float(rest[k].max()), "linear_rsc": -float(straight[j])}
        rows.append(found | {"linear_mm": float(measure(linear)[j]), "linear_worst_mm": float(linear[j].max())})
    return rows
