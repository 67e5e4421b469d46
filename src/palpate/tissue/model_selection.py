"""Selects the fastest tissue model that is accurate enough, by trials of all models."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import Float64
from palpate.errors import DataError
from palpate.tissue.contact_patches import Answer
from palpate.tissue.force_error_map import ForceErrorMap, force_error_map
from palpate.tissue.models.registry import model, names
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.reference.solver import finite_elements, finite_strain
from palpate.tissue.spring_fitting import scattered_points, surface_normals, tilt_half
from palpate.tissue.tissue import AT_NODES, Tissue

SKIPPED = 10  # points on which `fit` chooses the springs; the trials use others
CLOSED = 1e-6  # certified error below which more sweeps do not matter
MOST = 8192


@dataclass(frozen=True)
class ModelTrial:
    """A model tried. sweeps: the fewest tried that are enough, else the most; displacement: mm, greatest nodal error.

    force: greatest relative error of the force, against finite elements on the same mesh. seconds: processor time of a cold
    push, median. making: to make the model and answer a first push.
    """

    name: str
    enough: bool
    sweeps: int
    displacement: float
    force: float
    seconds: float
    making: float


@dataclass(frozen=True)
class ModelSelection:
    """What was asked (mm, share of force, mm of push, mm of patch), of which truth, and how each model does.

    mesh: the estimated error of the force that the mesh makes, of which each model leaves room for `mesh.cautious`; None
    if the truth is the finite elements themselves.
    """

    within: float
    force: float
    depth: float
    radius: float
    truth: str
    contacts: int
    trials: tuple[ModelTrial, ...]
    mesh: ForceErrorMap | None = None

    @property
    def too_coarse(self) -> bool:
        """Whether the mesh alone makes a larger error of the force than was asked, whichever the model."""
        return self.mesh is not None and self.mesh.cautious >= self.force

    @property
    def needed(self) -> ModelTrial | None:
        """The quickest that is enough; None where none is."""
        return min((r for r in self.trials if r.enough), key=lambda r: r.seconds, default=None)

    def text(self) -> str:
        """For people."""
        lines = [
            f"within {self.within:g} mm and {100 * self.force:g} % of force, pushes up to {self.depth:g} mm "
            f"({self.contacts} contacts, patch radius {self.radius:.3g} mm, against finite elements: {self.truth}):"
        ]
        if self.mesh is not None:
            lines.append(f"  {self.mesh.text()}; counted as {self.mesh.cautious:.1%}, as estimates run low")
        for r in self.trials:
            how = f"not, even with {r.sweeps} sweeps"
            if r.enough:
                how = f"with {r.sweeps} sweeps"
            elif self.too_coarse:
                how = f"not, the mesh is too coarse; with {r.sweeps} sweeps"
            if not np.isfinite(r.displacement):
                lines.append(f"  {r.name:>12}: not, some pushes are too deep for it")
                continue
            lines.append(
                f"  {r.name:>12}: {how}: {r.displacement:.2g} mm, {100 * r.force:.2g} % of force, "
                f"{1e3 * r.seconds:.3g} ms a push"
            )
        best = self.needed
        none = "needed: a finer mesh" if self.too_coarse else "no model here is good enough"
        lines.append(f"  needed: {best.name}, {best.sweeps} sweeps" if best else f"  {none}")
        return "\n".join(lines)


def select_model(
    tissue: Tissue,
    within: float = 0.3,
    force: float = 0.05,
    depth: float = 10.0,
    radius: float | None = None,
    element: str | None = None,
    strain: str = "linear",
    models: Sequence[str] | None = None,
    contacts: int = 8,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> ModelSelection:
    """Try all models against finite elements, and find the fewest sweeps that are accurate enough.

    Each push starts from rest. No model was fitted to these pushes. The first half goes along the inward normal, the rest
    45° to it. The force is that of the continuum: what `force_error_map` estimates for the mesh is part of its error.

    Parameters
    ----------
    tissue : Tissue
        The solid.
    within : float, optional
        Largest error of a node's displacement, mm.
    force : float, optional
        Largest error of the force, as a share.
    depth : float, optional
        Depth of the pushes, mm.
    radius : float, optional
        Radius of the contact, mm. The default is two mean edges.
    element : str, optional
        Element of finite elements that are taken for the truth, without the mesh's error. The default is the tissue's, with
        it (of P2 and mixed there is no estimate).
    strain : {"linear", "finite"}, optional
        Strain of the finite elements; "finite" is neo-Hookean, or Demiray's law of a tissue that stiffens.
    models : sequence of str, optional
        Which models. The default is all that take the tissue's element: of P2 and mixed, the springs alone.
    contacts : int, optional
        Number of pushes.
    progress : callable, optional
        Called with what is done and the share done.

    Returns
    -------
    ModelSelection
        Every model tried, and the fastest one that is accurate enough (`needed`). Its `text()` prints well.

    Raises
    ------
    DataError
        If a number is not positive.
    MaterialError
        If a model is unknown.

    Examples
    --------
    >>> found = pp.select_model(tissue, force=0.5, depth=2, contacts=1, models=["multigrid"])
    >>> found.needed.name
    'multigrid'
    """
    for name, value in (("within", within), ("force", force), ("depth", depth), ("contacts", contacts)):
        if not (np.isfinite(value) and value > 0):
            raise DataError(f"{name}: {value}; give a number above 0")
    if strain not in ("linear", "finite"):
        raise DataError(f'strain: {strain!r} is not known; choose "linear" or "finite"')
    r = 2 * tissue.edge if radius is None else float(radius)
    points = scattered_points(tissue, SKIPPED + contacts)[SKIPPED:]
    pushes = tilt_half(-depth * surface_normals(tissue, points))
    truth = finite_elements(tissue, element)
    solver = truth if strain == "linear" else finite_strain(tissue, element)
    mesh = None
    if element is None and tissue.element in AT_NODES:
        mesh = force_error_map(tissue, r, progress=progress)
    coarse = mesh is not None and mesh.cautious >= force
    room = force if mesh is None or coarse else force - mesh.cautious
    progress("finite elements", 0.0)
    true = [solver.push(x, w, r) for x, w in zip(points, pushes, strict=True)]
    every = names() if tissue.element in AT_NODES else ("springs",)
    wanted = every if models is None else tuple(models)
    tried = []
    for k, name in enumerate(wanted):
        progress(f"trying {name}", k / len(wanted))
        found = _fewest_sweeps(tissue, name, _Trial(points, pushes, r, true), within, room)
        tried.append(replace(found, enough=False) if coarse else found)
    progress("models tried", 1.0)
    return ModelSelection(within, force, depth, r, f"{truth.element}, {strain} strain", contacts, tuple(tried), mesh)


@dataclass(frozen=True)
class _Trial:
    points: Float64
    pushes: Float64
    radius: float
    true: list[Answer]

    def __call__(self, one: TissueModel, most: int) -> tuple[float, float, int, float, float]:
        """Worst mm, worst share of force, sweeps done, median seconds, worst certified error."""
        worst = off = bound = 0.0
        seconds, sweeps = [], 0
        for x, w, true in zip(self.points, self.pushes, self.true, strict=True):
            began = time.process_time()
            try:
                found = one.push(x, w, self.radius, tolerance=CLOSED, most_sweeps=most)
            except DataError:  # too deep for this model, or for so few sweeps
                return np.inf, np.inf, most, np.inf, np.inf
            seconds.append(time.process_time() - began)
            worst = max(worst, float(np.linalg.norm(found.displacement - true.displacement, axis=1).max()))
            off = max(off, float(np.linalg.norm(found.force - true.force) / np.linalg.norm(true.force)))
            sweeps, bound = max(sweeps, found.sweeps), max(bound, found.error)
        return worst, off, sweeps, float(np.median(seconds)), bound


def _fewest_sweeps(tissue: Tissue, name: str, trial: _Trial, within: float, force: float) -> ModelTrial:
    """Finds the fewest sweeps that are accurate enough, by doubling and then bisection."""
    began = time.process_time()
    one = model(tissue, name)
    one.push(
        trial.points[0], 1e-3 * trial.pushes[0], trial.radius, tolerance=0.5
    )  # builds what is built at the first push
    making = time.process_time() - began

    def enough(seen: tuple[float, float, int, float, float]) -> bool:
        return seen[0] <= within and seen[1] <= force

    most, seen = 4, trial(one, 4)
    while not enough(seen) and seen[4] > CLOSED and most < MOST:
        most *= 2
        seen = trial(one, most)
    low, high = most // 2, most
    while enough(seen) and high - low > max(1, high // 16) and high > 4:
        middle = (low + high) // 2
        tried = trial(one, middle)
        if enough(tried):
            high, seen = middle, tried
        else:
            low = middle
    return ModelTrial(name, enough(seen), seen[2], seen[0], seen[1], seen[3], making)
