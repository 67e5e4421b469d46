"""Which rung of the ladder of models is needed for a wanted accuracy, found by trying all of them."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.arrays import Float64
from palpate.errors import DataError
from palpate.tissue.base import TissueModel
from palpate.tissue.contact import Answer
from palpate.tissue.finite_strain import finite_strain
from palpate.tissue.fit import half_tilted, scattered_points, surface_normals
from palpate.tissue.models import model, names
from palpate.tissue.tissue import Tissue
from palpate.tissue.truth import finite_elements

SKIPPED = 10  # points on which `fit` chooses the springs: those after them are new to it
CLOSED = 1e-6  # certified error below which more sweeps change nothing that is looked at
MOST = 8192


@dataclass(frozen=True)
class Rung:
    """A model tried. sweeps: the fewest tried that are enough, else the most; displacement: mm, greatest nodal error.

    force: greatest relative error of the force. seconds: processor time of a cold push, median. making: to make the
    model and answer a first push.
    """

    name: str
    enough: bool
    sweeps: int
    displacement: float
    force: float
    seconds: float
    making: float


@dataclass(frozen=True)
class Ladder:
    """What was asked (mm, share of force, mm of push, mm of patch), of which truth, and how each model does."""

    within: float
    force: float
    depth: float
    radius: float
    truth: str
    contacts: int
    rungs: tuple[Rung, ...]

    @property
    def needed(self) -> Rung | None:
        """The quickest that is enough; None where none is."""
        return min((r for r in self.rungs if r.enough), key=lambda r: r.seconds, default=None)

    def text(self) -> str:
        """For people."""
        lines = [
            f"within {self.within:g} mm and {100 * self.force:g} % of force, pushes up to {self.depth:g} mm "
            f"({self.contacts} contacts, patch radius {self.radius:.3g} mm, against finite elements: {self.truth}):"
        ]
        for r in self.rungs:
            how = f"with {r.sweeps} sweeps" if r.enough else f"not, even with {r.sweeps} sweeps"
            if not np.isfinite(r.displacement):
                lines.append(f"  {r.name:>12}: not, some pushes are too deep for it")
                continue
            lines.append(
                f"  {r.name:>12}: {how}: {r.displacement:.2g} mm, {100 * r.force:.2g} % of force, "
                f"{1e3 * r.seconds:.3g} ms a push"
            )
        best = self.needed
        lines.append(f"  needed: {best.name}, {best.sweeps} sweeps" if best else "  no model here is good enough")
        return "\n".join(lines)


def ladder(
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
) -> Ladder:
    """Tries every model on pushes that no fit saw, and finds the fewest sweeps that keep its error within what is asked.

    within: mm, greatest nodal difference of displacement to finite elements on this mesh. force: share, greatest
    difference of the force. strain: of the truth, "linear" or "finite" (neo-Hookean). depth: mm of the pushes, the
    first half along the inward normal, the rest 45° to it. radius: mm; None: two mean edges. element: of the truth;
    None: the tissue's. models: names; None: all that there are. Each push starts from rest. Raises `DataError` on
    numbers that ask for nothing, `MaterialError` for unknown names.
    """
    for name, value in (("within", within), ("force", force), ("depth", depth), ("contacts", contacts)):
        if not (np.isfinite(value) and value > 0):
            raise DataError(f"{name}: {value}; give a number above 0")
    if strain not in ("linear", "finite"):
        raise DataError(f'strain: {strain!r} is not known; choose "linear" or "finite"')
    r = 2 * tissue.edge if radius is None else float(radius)
    points = scattered_points(tissue, SKIPPED + contacts)[SKIPPED:]
    pushes = half_tilted(-depth * surface_normals(tissue, points))
    truth = finite_elements(tissue, element)
    solver = truth if strain == "linear" else finite_strain(tissue, element)
    progress("finite elements", 0.0)
    true = [solver.push(x, w, r) for x, w in zip(points, pushes, strict=True)]
    wanted = names() if models is None else tuple(models)
    tried = []
    for k, name in enumerate(wanted):
        progress(f"trying {name}", k / len(wanted))
        tried.append(_rung(tissue, name, _Trial(points, pushes, r, true), within, force))
    progress("models tried", 1.0)
    return Ladder(within, force, depth, r, f"{truth.element}, {strain} strain", contacts, tuple(tried))


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


def _rung(tissue: Tissue, name: str, trial: _Trial, within: float, force: float) -> Rung:
    """Doubles the sweeps until they are enough or change nothing, then halves the last step."""
    began = time.process_time()
    one = model(tissue, name)
    one.push(trial.points[0], 1e-3 * trial.pushes[0], trial.radius, tolerance=0.5)  # what is made at the first push
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
    return Rung(name, enough(seen), seen[2], seen[0], seen[1], seen[3], making)
