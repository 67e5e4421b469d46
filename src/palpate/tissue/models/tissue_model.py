"""Base class of all tissue models: checks a push, finds its patches, and returns the answer."""

from abc import ABC, abstractmethod
from functools import cached_property
from typing import cast

import numpy as np

from palpate import _core
from palpate.arrays import ArrayLike, Float64
from palpate.errors import DataError, MaterialError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.tissue.contact_patches import Answer, Contacts, contacts
from palpate.tissue.discretization_error import DiscretizationError
from palpate.tissue.stiffness_spread import StiffnessSpread
from palpate.tissue.tissue import AT_NODES, Tissue


class TissueModel(ABC):
    """A tissue that answers pushes. Immutable and thread-safe; what changes is the state that `start` gives.

    native: the C++ model that the real-time loop runs. settings: the numbers that a record must repeat, by name; each
    is a keyword of the class, too.
    """

    slides = False  # whether contacts of finite friction can be answered
    attaches = False  # whether it knows of attachments
    time_dependent = False  # whether its ticks follow the tissue's relaxation and inertia; `push` is for the long term
    linear_elasticity = (
        False  # whether it is: finite elements of the tissue's own element, whose error can be estimated
    )

    def __init__(
        self, tissue: Tissue, native: "_core.tissue.TissueModel", settings: dict[str, float] | None = None
    ) -> None:
        if tissue.attachments and not self.attaches:
            raise MaterialError("attachments: only the model `compliance` takes a tissue that has some; leave them out")
        self.tissue = tissue
        self.native = native
        self.settings = settings or {}

    def start(self) -> "_core.tissue.ModelState":
        """A state at rest, to hand to `push(warm=)`."""
        return self.native.make_state()

    def _repr_html_(self) -> str:
        from palpate.tissue.tissue_card import tissue_card  # only a notebook asks

        settings = ", ".join(f"{name} {value:g}" for name, value in self.settings.items())
        return tissue_card(self.tissue, type(self).__name__, (("Settings", settings),) if settings else ())

    @abstractmethod
    def solve(
        self, found: Contacts, state: "_core.tissue.ModelState", tolerance: float, most_sweeps: int
    ) -> tuple[Float64, float, int]:
        """Moves `state` until the error is below `tolerance`: (m, 3) N on the tools, the error's bound, the sweeps.

        Raises `DataError` for contacts that this model cannot answer.
        """

    def push(
        self,
        points: ArrayLike,
        displacements: ArrayLike,
        radii: ArrayLike,
        normals: ArrayLike | None = None,
        friction: float = np.inf,
        tolerance: float = 1e-3,
        warm: "_core.tissue.ModelState | None" = None,
        most_sweeps: int = 20_000,
    ) -> Answer:
        """Pushes m contacts at once, until the certified error is below `tolerance`.

        points: (m, 3) mm, rest positions on the surface. displacements: (m, 3) mm. radii: (m,) mm. One contact keeps
        (3,), (3,), scalar. friction: inf is glue; with a finite one (Coulomb's) contacts slide and open, for the models
        that `slides` says. normals: (m, 3) outwards, for that; None: the surface's. warm: a state from `start` or an earlier
        answer, which this push moves on. The answer says its certified error, which exceeds the tolerance only if
        `most_sweeps` sweeps (or iterations) were not enough. Raises `DataError` or `MaterialError` for contacts that
        cannot be.
        """
        if not 0 < tolerance < 1:
            raise DataError(f"tolerance: {tolerance}; give a relative error between 0 and 1, such as 1e-3")
        found = contacts(self.tissue, points, displacements, radii, normals, friction)
        if found.normals is not None and not self.slides:
            raise DataError(
                f"friction: {friction:g}: this model's contacts are glued; leave it at inf, or take the model "
                f"`compliance` or `finite_elements`"
            )
        state = self.start() if warm is None else warm
        force, error, done = self.solve(found, state, tolerance, most_sweeps)
        u: Float64 = state.u.copy()
        estimated = self.linear_elasticity and not isinstance(self.tissue.mesh, CutMesh)
        errors = (lambda: (*self.model_errors(u, found, -force), self.stiffness_spread(u))) if estimated else None
        return found.answer(self.tissue, force, u, error, done, state, errors)

    def model_errors(self, u: Float64, found: Contacts, force: Float64) -> tuple[float, float | None]:
        """What the mesh and linear strain (None: not known) make of the force (m, 3) N of the tools, relative to it."""
        return self.discretization(u, found, force), None

    @cached_property
    def stiffness_spread(self) -> StiffnessSpread:
        """What the spread of the stiffness makes of the force; of models of linear elasticity."""
        return StiffnessSpread(self.tissue)

    @cached_property
    def discretization(self) -> DiscretizationError:
        """Estimates the error that the mesh makes; of models of linear elasticity."""
        return DiscretizationError(self.tissue)


class IterativeModel(TissueModel):
    """A model solved by sweeps in growing batches. batch: the least. growth: what part of those done comes next."""

    batch, growth = 4, 4

    @property
    def iterated(self) -> "_core.relaxation.RingRelaxation | _core.multigrid.MultigridModel":
        """The model whose iterations answer a push; the loop's own, if that iterates in its ticks."""
        return cast("_core.relaxation.RingRelaxation", self.native)

    def start(self) -> "_core.tissue.ModelState":
        """A state at rest, to hand to `push(warm=)`."""
        return self.iterated.make_state()

    @abstractmethod
    def certified_error(self, state: "_core.tissue.ModelState", force: Float64, found: Contacts) -> float:
        """Bound on ‖u − u*‖_K/‖u*‖_K for the state that answers `found` with `force` (m, 3) N on the tools."""

    def solve(
        self, found: Contacts, state: "_core.tissue.ModelState", tolerance: float, most_sweeps: int
    ) -> tuple[Float64, float, int]:
        """Each batch from the least energy over what is known, followed by a look at the certified error."""
        if not found.displacement.any():
            state.u[:] = 0  # the exact solution
        done, batch = 0, self.batch if found.displacement.any() else 0
        while True:
            force = self.iterated.solve(state, found.patches, found.displacement, batch)
            if force is None:
                raise too_many_contacts(found)
            done += batch
            error = self.certified_error(state, force, found)
            if error <= tolerance or done >= most_sweeps:
                return force, error, done
            batch = min(max(self.batch, done // self.growth), most_sweeps - done)


def nodal_element(tissue: Tissue) -> str:
    """The tissue's element, "smoothed" or "P1". Raises `MaterialError` for those that real-time models do not have."""
    if tissue.element not in AT_NODES:
        raise MaterialError(
            f'element: "{tissue.element}" is for pp.finite_elements; of the models, `springs` alone takes a tissue of it: '
            f'make the tissue with element="smoothed" (the default) or "P1"'
        )
    return tissue.element


def too_many_contacts(found: Contacts) -> DataError:
    """The error for too many or linearly dependent contacts."""
    return DataError(
        f"{len(found.patches)} contacts with {sum(len(p.nodes) for p in found.patches)} nodes; at most "
        f"{_core.relaxation.RingRelaxation.most_contacts} contacts and {_core.tissue.ContactPatch.capacity} nodes; "
        "give smaller radii"
    )
