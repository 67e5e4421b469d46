"""Linear finite elements under the contacts of a tick, to compare a session with."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from palpate.arrays import Float32, Float64, Int32
from palpate.simulation.pointer import ContactState
from palpate.tissue.contact_patches import Contacts, contacts
from palpate.tissue.models.compliance import ComplianceModel


@dataclass(frozen=True, eq=False)
class DisplayedTick:
    """What one tick shows. tools: those that hold, by number. points, displacements: (m, 3) mm; points lie at rest.

    answers: (m, 3) N of the tissue on these tools, of the model alone: without what a sliding hand pays. shown: (S, 3) mm.
    """

    number: int
    tools: tuple[int, ...]
    points: Float64
    displacements: Float64
    answers: Float64
    shown: Float32

    @classmethod
    def of(cls, frame: Any) -> Self:
        """Of a session's frame, which the loop overwrites later: all is copied, and of the same tick."""
        tools = tuple(tool for tool, contact in enumerate(frame.contact) if contact == ContactState.closed)

        def rows(vectors: Any) -> Float64:
            return np.array([vectors[tool] for tool in tools], dtype=np.float64).reshape(-1, 3)

        answers, shown = rows(frame.model_force), np.array(frame.shown, dtype=np.float32)
        return cls(int(frame.tick), tools, rows(frame.point), rows(frame.displacement), answers, shown)


@dataclass(frozen=True, eq=False)
class FemDifference:
    """Between what a tick shows and its reference. distance: (S,) mm. force: (m, 3) N, the reference's.

    off: |answers - force| / |force|, of all tools together; 0 if nothing is touched.
    """

    distance: Float64
    force: Float64
    off: float


def fem_difference(exact: ComplianceModel, tick: DisplayedTick, radius: float, shown: Int32) -> FemDifference:
    """Solves the linear finite elements of `exact` for the contacts of `tick` and compares.

    radius: of the contacts, mm. shown: (S,) nodes. Nothing is displaced where nothing holds. The displacements are those
    of the patches' weighted means, as every model takes them. Raises `DataError` for contacts that no force can tell
    apart.
    """
    if not tick.tools:
        return FemDifference(np.linalg.norm(tick.shown.astype(np.float64), axis=1), np.zeros((0, 3)), 0.0)
    _, force, u = linear_solution(exact, tick, radius)
    size = float(np.linalg.norm(force))
    off = float(np.linalg.norm(tick.answers + force)) / size if size > 0 else 0.0
    return FemDifference(np.linalg.norm(tick.shown - u[shown], axis=1), -force, off)


LinearSolution = tuple[Contacts, Float64, Float64]
"""Contacts, the forces (m, 3) N of their tools on the tissue, and the displacement (N, 3) mm."""


def mesh_error(exact: ComplianceModel, solution: LinearSolution) -> float:
    """Estimated error of the force that the mesh makes, relative to the force."""
    found, force, u = solution
    return exact.discretization(u, found, force)


def force_spread(exact: ComplianceModel, solution: LinearSolution) -> float:
    """Standard deviation of the force that the spread of the stiffness makes, relative to the force."""
    return exact.stiffness_spread(solution[2])


def linearisation_error(exact: ComplianceModel, solution: LinearSolution) -> tuple[float, float]:
    """Error of the force that linear strain makes, relative to it, and the least volume ratio of an element."""
    found, force, u = solution
    return exact.linearisation(found, force), exact.linearisation.least_volume(u)


def linear_solution(exact: ComplianceModel, tick: DisplayedTick, radius: float) -> LinearSolution:
    """The linear solution for the contacts of `tick`. Raises as `fem_difference`."""
    found = contacts(exact.tissue, tick.points, tick.displacements, radius)
    force = found.forces(exact.compliance(found))
    nodes, load = exact.loads(found)
    whole = np.zeros((len(exact.places), 3))
    whole[nodes] = (load @ force.ravel()).reshape(-1, 3)
    u = np.zeros(exact.tissue.mesh.nodes.shape)
    u[~exact.tissue.held] = exact.factors.solve(whole.ravel()).reshape(-1, 3)
    return found, force, u
