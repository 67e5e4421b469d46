"""What the best palpation could find in a lesson's cases: presses all over, compared with the organ without lumps."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest

from palpate.arrays import Float64
from palpate.errors import DataError
from palpate.simulation.lesson import EXAM_FORCE, Lesson
from palpate.simulation.lesson_case import lesson_case
from palpate.simulation.target_regions import connected_lumps
from palpate.tissue.contact_patches import patch
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.spring_fitting import scattered_points, surface_normals
from palpate.tissue.tissue import Tissue

DEPTH = 2.0  # mm, of a press
WEBER = 0.07  # of a force
BATCH = 64  # presses solved together


@dataclass(frozen=True)
class Ceiling:
    """How often a bot that presses everywhere finds the lumps.

    Parameters
    ----------
    found, sought : int
        Lumps in all cases.
    cases : int
        How many cases.
    interval : tuple of float
        95 % interval of the share found, of cases drawn like these (Wilson).

    Examples
    --------
    >>> pp.Ceiling(18, 20, 20, (0.7, 0.97)).share
    0.9
    """

    found: int
    sought: int
    cases: int
    interval: tuple[float, float]

    @property
    def share(self) -> float:
        """Of the lumps that were found."""
        return self.found / self.sought


def lesson_ceiling(lesson: Lesson, organ: Tissue, cases: int = 20, presses: int = 200, weber: float = WEBER) -> Ceiling:
    """Measure what the best palpation could find in a lesson: an upper mark for a trainee, not a bound.

    A bot presses by 2 mm all over the skin and reads the forces in the steps of an exam, each with an error as a hand has
    it. It knows the organ, so it claims the places where the force is most above that of the organ without lumps, as
    often as the lesson allows.

    Parameters
    ----------
    lesson : Lesson
        The lesson.
    organ : Tissue
        Its organ.
    cases : int, optional
        Cases, from seed 0 on.
    presses : int, optional
        Places that it presses.
    weber : float, optional
        Standard deviation of a force that is felt, as a share of it. The default is a just noticeable difference of force
        as published. 0: no error, and then the bot finds even what differs by the mesh alone.

    Returns
    -------
    Ceiling
        What it found.

    Raises
    ------
    DataError
        If there are no cases or presses, the share is negative, or a case cannot be drawn.

    References
    ----------
    X.-D. Pang, H. Z. Tan & N. I. Durlach, Percept. Psychophys. 49 (1991) 531: 7 % for forces of 2.5 to 10 N.

    Examples
    --------
    >>> _ = Path("lesson.yaml").write_text(pp.lesson_template("tissue.vtu"))
    >>> plain = pp.tetrahedralize(labels, "organ", edge=6)
    >>> organ = pp.Tissue(plain, 5, poisson=0.4, fixed=pp.resting_on(plain, (0, 0, -1)))
    >>> pp.lesson_ceiling(pp.read_lesson("lesson.yaml"), organ, cases=2, presses=50).sought
    2
    """
    if cases < 1 or presses < 1:
        raise DataError(f"cases, presses: {cases}, {presses}; give 1 or more of each")
    if not (np.isfinite(weber) and weber >= 0):
        raise DataError(f"weber: {weber}; give 0 or more")
    points = scattered_points(organ, presses)
    without = pressed(ComplianceModel(organ), points)
    found = sought = 0
    for seed in range(cases):
        case = lesson_case(lesson, organ, seed)
        lumps = connected_lumps(case.mesh, int(case.mesh.region.max()))
        sought += len(lumps)
        felt = pressed(ComplianceModel(case), points) * np.random.default_rng(seed).normal(1, weber, len(points))
        claims = _claims(points, felt / without, lesson.claims, 2 * organ.edge)
        found += sum(
            any(lump.distance(point) <= lump.depth + lesson.limits.within for point in claims) for lump in lumps
        )
    low, high = binomtest(found, sought).proportion_ci(0.95, "wilson")
    return Ceiling(found, sought, cases, (float(low), float(high)))


def pressed(model: ComplianceModel, points: Float64) -> Float64:
    """(P,) N, of presses by `DEPTH` along the normal, one after the other, in the steps of an exam."""
    tissue = model.tissue
    inward = -DEPTH * surface_normals(tissue, points)
    free, forces = ~tissue.held, []
    for start in range(0, len(points), BATCH):
        some = points[start : start + BATCH]
        weights = np.zeros((len(tissue.mesh.nodes), len(some)))
        for k, point in enumerate(some):
            found = patch(tissue, point, 2 * tissue.edge)
            weights[found.nodes, k] = found.weights
        load: Float64 = np.kron(weights[free], np.eye(3)).astype(np.float64)
        u = model.factors.solve(load)
        for k, way in enumerate(inward[start : start + BATCH]):
            own = slice(3 * k, 3 * k + 3)
            forces.append(float(np.linalg.norm(np.linalg.solve(load[:, own].T @ u[:, own], way))))
    return np.maximum(EXAM_FORCE * np.rint(np.array(forces) / EXAM_FORCE), EXAM_FORCE)


def _claims(points: Float64, ratio: Float64, count: int, apart: float) -> list[Float64]:
    """The places of the largest ratios, no two of them near each other."""
    claims: list[Float64] = []
    for k in np.argsort(-ratio):
        if len(claims) < count and all(np.linalg.norm(points[k] - other) > apart for other in claims):
            claims.append(points[k])
    return claims
