"""The cube on every reading of the chapter's set-up, which is inferred: contact, support, measure of error, spring law.

The chapter names one negative RSC0 for both laws. Read here: RSC = -RSC0 r (linear) and 1 - exp(RSC0 r) (exponential),
r the row, 1 at the contact; "both": one RSC0 for both laws, judged by the worse of the two.
"""

from collections.abc import Callable

import numpy as np

from palpate.arrays import Float64
from palpate.report.tables import Row, where
from palpate.studies.deformation.config import DEPTH, MARKS, READ_CONTACTS, Setting, tissue
from palpate.studies.deformation.reference import pushed
from palpate.studies.deformation.report_inputs import ONE
from palpate.studies.deformation.spring_laws import HIGH, LAWS, LOW, SEARCH, spring_law, springs
from palpate.tissue.reference.solver import finite_elements
from palpate.tissue.tissue import Tissue

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
    node at the chapter's own RSC0. `mesh_readings`: the exponential law on an irregular and on a finer mesh at the one
    Poisson's ratio `ONE`, with the RSC0 that is best on the main cube ("kept") and with its own best.
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
    return {"readings": rows, "marks": marks, "mesh_readings": _on_meshes(setting, support, rows)}


def _on_meshes(setting: Setting, support: str, best: list[Row]) -> list[Row]:
    """A row a mesh, contact, measure and choice of RSC0."""
    sizes, rows = searched(setting)[::2], []
    for kind, nodes, element in (("irregular", setting.main, "P2"), ("finer", setting.fine, "P1")):
        solid = tissue(nodes, ONE, kind == "irregular", support)
        truth = finite_elements(solid, element)
        for name in READ_CONTACTS:
            true = pushed(truth, name, setting.radius, DEPTH)[0]

            def gap(size: float, solid: Tissue = solid, name: str = name, true: Float64 = true) -> Float64:
                u = springs(solid, spring_law("exponential", size, "equal"), name, setting.radius)[0]
                return np.asarray(np.linalg.norm(u - true, axis=1))

            gaps = np.stack([gap(size) for size in sizes.tolist()])
            for measure, error in MEASURES.items():
                (row,) = where(best, contact=name, measure=measure, law="exponential", poisson=ONE)
                own = float(sizes[np.argmin(error(gaps))])
                about = {"mesh": kind, "contact": name, "support": support, "measure": measure, "poisson": ONE}
                for choice, size in (("kept", -row["rsc"]), ("own", own)):
                    rows.append({**about, "choice": choice, "rsc": -size, "worst_mm": float(gap(size).max())})
    return rows


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
