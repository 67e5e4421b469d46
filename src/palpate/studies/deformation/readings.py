"""The cube on every reading of the chapter's set-up, which is inferred: contact, support, measure of error, spring law.

The chapter names one negative RSC0 for both laws. Read here: RSC = -RSC0 r (linear) and 1 - exp(RSC0 r) (exponential),
r the row, 1 at the contact; "both": one RSC0 for both laws, judged by the worse of the two.
"""

from collections.abc import Callable

import numpy as np

from palpate.arrays import Float64
from palpate.report.tables import Row
from palpate.studies.deformation.config import DEPTH, MARKS, READ_CONTACTS, Setting, tissue
from palpate.studies.deformation.reference import pushed
from palpate.studies.deformation.spring_laws import HIGH, LAWS, LOW, SEARCH, spring_law, springs
from palpate.tissue.reference.solver import finite_elements

MEASURES: dict[str, Callable[[Float64], Float64]] = {
    "worst": lambda gap: gap.max(axis=1),
    "RMS": lambda gap: np.sqrt((gap**2).mean(axis=1)),
    "mean": lambda gap: gap.mean(axis=1),
}
ADAPTIVE = {"linear": ("linear",), "exponential": ("exponential",), "both": ("linear", "exponential")}


def searched(setting: Setting) -> Float64:
    """The list of |RSC0| among which the best is sought; it holds the chapter's and the low and high uniform RSC."""
    return np.unique([*np.geomspace(*SEARCH, 4 * setting.steps), LOW, HIGH, *(-mark for mark in MARKS)])


def readings(setting: Setting, support: str) -> dict[str, list[Row]]:
    """By contact, measure, law and Poisson's ratio: the best RSC0, its errors, and those of uniform RSC.

    error_mm is the measure's own; worst_mm the worst node's at the same RSC0. uniform_mm: the measure of the best uniform
    RSC; low_high_mm: of the better of the two uniform ones that stand for the chapter's low and high. `marks`: the worst
    node at the chapter's own RSC0.
    """
    sizes = searched(setting)
    solid = tissue(setting.main, 0.3, support=support)  # springs do not know of Poisson's ratio
    truths = {p: finite_elements(tissue(setting.main, p, support=support), "P2") for p in setting.ratios}
    rows, marks = [], []
    for name in READ_CONTACTS:
        found = {
            law: np.stack([springs(solid, spring_law(law, s, "equal"), name, setting.radius)[0] for s in sizes])
            for law in LAWS
        }
        for poisson, truth in truths.items():
            true = pushed(truth, name, setting.radius, DEPTH)[0]
            gaps = {law: np.linalg.norm(u - true, axis=2) for law, u in found.items()}
            about = {"contact": name, "support": support, "poisson": poisson}
            rows += [about | row for row in best_by_measure(sizes, gaps)]
            for law in ("linear", "exponential"):
                worst = MEASURES["worst"](gaps[law])
                marks += [about | {"law": law, "rsc": m, "worst_mm": float(worst[sizes == -m][0])} for m in MARKS]
    return {"readings": rows, "marks": marks}


def best_by_measure(sizes: Float64, gaps: dict[str, Float64]) -> list[Row]:
    """The |RSC0| of least error for each measure and adaptive law. gaps: (sizes, N) mm by law."""
    rows = []
    for name, measure in MEASURES.items():
        uniform = measure(gaps["uniform"])
        even = {"uniform_rsc": float(sizes[np.argmin(uniform)]), "uniform_mm": float(uniform.min())}
        even["low_high_mm"] = float(min(uniform[sizes == s][0] for s in (LOW, HIGH)))
        for law, laws in ADAPTIVE.items():
            error = np.max([measure(gaps[one]) for one in laws], axis=0)
            k = int(np.argmin(error))
            found: Row = {"measure": name, "law": law, "rsc": -float(sizes[k]), "error_mm": float(error[k])}
            rows.append(found | {"worst_mm": max(float(gaps[one][k].max()) for one in laws)} | even)
    return rows
