"""The whole ladder: how near to finite elements, how soon, on pushes at the centre and on pushes that no fit saw."""

import time
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from palpate.report.tables import Row
from palpate.studies.deformation.config import DEPTH, TOP, Setting, tissue
from palpate.tissue.contact_patches import Answer
from palpate.tissue.model_selection import select_model
from palpate.tissue.models.registry import model, names
from palpate.tissue.reference.solver import finite_elements, finite_strain
from palpate.tissue.spring_fitting import fit
from palpate.tissue.tissue import Tissue

POISSON = 0.45
TOLERANCES = (0.5, 0.1, 0.03, 0.01, 1e-3, 1e-5)
FINITE = "neo-hookean"
ASKED = ((0.3, 0.05, 10.0), (1.0, 0.2, 10.0), (0.05, 0.01, 10.0))  # mm, share of force, mm of push


def fitted(setting: Setting, nodes: int) -> Tissue:
    """The cube with springs fitted to P1 elements, as `palpate fit` does."""
    solid = tissue(nodes, POISSON)
    return fit(solid.mesh, solid.young, solid.poisson, solid.fixed, element="P1", radius=setting.radius, depth=DEPTH)


def front(setting: Setting, nodes: int) -> dict[str, list[Row]]:
    """Processor seconds of a push from rest and its error, model by model and tolerance by tolerance."""
    solid = fitted(setting, nodes)
    down = [0.0, 0.0, -DEPTH]
    direct = finite_elements(solid, "P1")
    true, _ = timed(lambda: direct.push(TOP, down, setting.radius))
    finite = finite_strain(solid, "P1").push(TOP, down, setting.radius)
    finer = finite_elements(solid, "P2").push(TOP, down, setting.radius) if nodes == setting.main else None
    rows: list[Row] = []

    def note(name: str, tolerance: float, answer: Answer, seconds: float, making: float) -> None:
        row: Row = {"nodes": nodes, "model": name, "tolerance": tolerance, "seconds": seconds, "making_s": making}
        row |= {"sweeps": answer.sweeps, "bound": answer.error if np.isfinite(answer.error) else None}
        own = finite if name == FINITE else true
        for who, other in (("", own), ("_p2", finer), ("_finite", finite)):
            if other is not None:
                gap = np.linalg.norm(answer.displacement - other.displacement, axis=1).max() / DEPTH
                row[f"error{who}"] = float(gap)
                off = np.linalg.norm(answer.force - other.force) / np.linalg.norm(other.force)
                row[f"force_error{who}"] = float(off)
        rows.append(row)

    for name in names():
        one, making = timed(partial(_ready, solid, name, setting.radius))
        for tolerance in TOLERANCES:
            push = partial(one.push, TOP, down, setting.radius, tolerance=tolerance)
            tries = [timed(push) for _ in range(setting.repeats)]
            note(name, tolerance, tries[0][0], min(seconds for _, seconds in tries), making)
    answer, seconds = timed(lambda: direct.push(TOP, down, setting.radius))
    _, factoring = timed(lambda: finite_elements(solid, "P1").factors)
    note("direct solve", 0.0, answer, seconds, factoring)
    return {"pareto": rows}


def _ready(solid: Tissue, name: str, radius: float) -> Any:
    one = model(solid, name)
    one.push(TOP, [0, 0, -DEPTH], radius)  # what is made at the first push
    return one


def timed(act: Callable[[], Any]) -> tuple[Any, float]:
    """What `act` gives, and its processor seconds."""
    began = time.process_time()
    done = act()
    return done, time.process_time() - began


def needed(setting: Setting) -> dict[str, list[Row]]:
    """Which model is needed for three accuracies on the main cube: against P1, P2, and P1 at finite strain."""
    solid, rows = fitted(setting, setting.main), []
    for element, strain in (("P1", "linear"), ("P2", "linear"), ("P1", "finite")):
        for within, force, depth in ASKED[: setting.asked]:
            found = select_model(
                solid, within, force, depth, setting.radius, element, strain, contacts=setting.contacts
            )
            best = found.needed
            for rung in found.trials:
                asked = {"truth": found.truth, "within_mm": within, "within_force": force, "depth_mm": depth}
                tried = {k: None if v == np.inf else v for k, v in asdict(rung).items()}
                rows.append({**asked, **tried, "needed": best is not None and best.name == rung.name})
    return {"needed": rows}
