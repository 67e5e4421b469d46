"""Springs against finite elements on the cube: every law, every RSC0, every Poisson's ratio, three meshes."""

import itertools

import numpy as np
from scipy.optimize import minimize_scalar

from palpate.arrays import Float64
from palpate.report.tables import Row, where
from palpate.studies.deformation.config import CONTACTS, DEPTH, MARKS, Setting, contact, tissue, way
from palpate.studies.deformation.reference import pushed
from palpate.tissue.models.mass_spring import SpringModel
from palpate.tissue.reference.solver import finite_elements
from palpate.tissue.tissue import SpringLaw, Tissue

Field = tuple[Float64, Float64]  # displacement (N, 3) mm and force on the tool (3,) N
LAWS, WEIGHTS = ("uniform", "linear", "exponential"), ("equal", "cotangent")
LOW, HIGH = 0.03, 0.5  # the uniform RSC shown beside the adaptive ones
SEARCH = (1e-3, 2.0)  # of |RSC0|
BIN = 2.5  # mm of distance over which the greatest difference is taken
LEAST = 0.01  # share of the push below which a node's own displacement is no measure of its error


def spring_law(law: str, size: float, weights: str, rows: str = "rings") -> SpringLaw:
    """With |RSC0| = size; the exponential law's is negative. Rows are the dissertation's rings unless said."""
    return SpringLaw(law, -size if law == "exponential" else size, weights, rows)


def springs(solid: Tissue, law: SpringLaw, name: str, radius: float) -> Field:
    """The springs' answer to a push of `DEPTH` mm at contact `name`."""
    point, r = contact(solid, name, radius)
    model = SpringModel(solid, law, relaxation=1.3, rigid=name != "patch")
    answer = model.push(point, [0, 0, -DEPTH], r, tolerance=1e-5)
    return answer.displacement, answer.force


def errors(found: Float64, true: Float64, mesh_nodes: Float64) -> Row:
    """Differences of nodal displacement at a push of `DEPTH`: mm, and as a share of the push and of the node's own."""
    gap, moved = np.linalg.norm(found - true, axis=1), np.linalg.norm(true, axis=1)
    worst = int(np.argmax(gap))
    seen = moved > LEAST * DEPTH
    return {
        "worst_mm": float(gap[worst]),
        "rms_mm": float(np.sqrt((gap**2).mean())),
        "worst_share": float(gap[worst] / DEPTH),
        "own_share_rms": float(np.sqrt(((gap[seen] / moved[seen]) ** 2).mean())),
        **{f"worst_{axis}": float(x) for axis, x in zip("xyz", mesh_nodes[worst], strict=True)},
    }


def truths(setting: Setting, poisson: float, nodes: int, element: str, irregular: bool = False) -> dict[str, Field]:
    """By contact."""
    fe = finite_elements(tissue(nodes, poisson, irregular), element)
    return {name: pushed(fe, name, setting.radius, DEPTH) for name in CONTACTS}


class ModelAnswers:
    """Springs of one law on one solid under one contact, by |RSC0|: each solved once."""

    def __init__(self, solid: Tissue, law: str, weights: str, name: str, radius: float) -> None:
        self.solid, self.law, self.weights, self.name, self.radius = solid, law, weights, name, radius
        self._known: dict[float, Float64] = {}

    def errors(self, size: float, true: Float64) -> Row:
        """Of |RSC0| = size against a true displacement (N, 3) mm."""
        if size not in self._known:
            law = spring_law(self.law, size, self.weights)
            self._known[size] = springs(self.solid, law, self.name, self.radius)[0]
        return errors(self._known[size], true, self.solid.mesh.nodes)

    def least(self, true: Float64, of: str, grid: Float64) -> float:
        """|RSC0| of least error `of`: the best of the grid, refined between its neighbours."""

        def error(log: float) -> float:
            return float(self.errors(float(np.exp(log)), true)[of])

        seen = [float(self.errors(size, true)[of]) for size in grid.tolist()]
        k = int(np.argmin(seen))
        a, b = np.log(grid[max(k - 1, 0)]), np.log(grid[min(k + 1, len(grid) - 1)])
        found = minimize_scalar(error, bounds=(float(a), float(b)), method="bounded", options={"xatol": 0.02})
        return float(np.exp(found.x)) if found.fun < seen[k] else float(grid[k])


def sweep(setting: Setting, true: dict[float, dict[str, Field]]) -> dict[str, list[Row]]:
    """Error over RSC0 for each law, weight and contact, and the RSC0 of least error, by Poisson's ratio."""
    curves, best = [], []
    solid = tissue(setting.main, 0.3)  # springs do not know of Poisson's ratio
    grid = np.geomspace(*SEARCH, setting.steps)
    for name, weights, law in itertools.product(CONTACTS, WEIGHTS, LAWS):
        answers = ModelAnswers(solid, law, weights, name, setting.radius)
        for poisson, fields in true.items():
            about = {"contact": name, "weights": weights, "law": law, "poisson": poisson}
            u = fields[name][0]
            curves += [{**about, "rsc": s} | answers.errors(s, u) for s in grid.tolist()]
            sizes = {of: answers.least(u, of, grid) for of in ("worst_mm", "rms_mm")}
            best += [{**about, "least": of, "rsc": s} | answers.errors(s, u) for of, s in sizes.items()]
    return {"rsc": curves, "optimum": best}


def shown_laws(best: list[Row], name: str, poisson: float, weights: str = "equal") -> dict[str, SpringLaw]:
    """The laws of the profiles: uniform low and high, and each adaptive one at its least worst error."""
    laws = {f"uniform {size:g}": spring_law("uniform", size, weights) for size in (LOW, HIGH)}
    for law in ("linear", "exponential"):
        (row,) = where(best, contact=name, weights=weights, law=law, poisson=poisson, least="worst_mm")
        laws[law] = spring_law(law, row["rsc"], weights)
    return laws


def by_distance(distance: Float64, values: Float64) -> tuple[Float64, Float64]:
    """Greatest value in each bin of distance that has any, and the bin's middle."""
    k = (distance / BIN).astype(int)
    bins = np.unique(k)
    return (bins + 0.5) * BIN, np.array([values[k == b].max() for b in bins])


def _binned_rows(about: Row, solid: Tissue, name: str, radius: float, law: SpringLaw, true: Float64) -> list[Row]:
    """Greatest difference of nodal displacement over the distance to the contact."""
    away = way(solid.mesh.nodes, contact(solid, name, radius)[0])
    gap = np.linalg.norm(springs(solid, law, name, radius)[0] - true, axis=1)
    middles, worst = by_distance(away, gap)
    return [{**about, "distance_mm": float(d), "difference_mm": float(w)} for d, w in zip(middles, worst, strict=True)]


def profiles(setting: Setting, true: dict[float, dict[str, Field]], best: list[Row]) -> dict[str, list[Row]]:
    """Every node: where it is, where finite elements and the springs take it at `DEPTH` under the triangle contact.

    `mark_profiles`: the difference over the distance at the chapter's RSC0, both laws.
    """
    rows, marks, solid = [], [], tissue(setting.main, 0.3)
    x, (point, _) = solid.mesh.nodes, contact(solid, "triangle", setting.radius)
    for poisson, fields in true.items():
        found = {
            law: springs(solid, spec, "triangle", setting.radius)[0]
            for law, spec in shown_laws(best, "triangle", poisson).items()
        }
        for i, distance in enumerate(way(x, point)):
            row: Row = {"poisson": poisson, "node": i, "distance_mm": round(float(distance), 4)}
            row |= dict(zip(("x", "y", "z"), x[i].round(4).tolist(), strict=True))
            for who, u in {"fem": fields["triangle"][0], **found}.items():
                row |= {f"{who}:{axis}": round(float(v), 6) for axis, v in zip("xyz", u[i], strict=True)}
            rows.append(row)
    for law, mark in itertools.product(("linear", "exponential"), MARKS):
        about = {"law": law, "rsc": mark}
        spec, u = spring_law(law, -mark, "equal"), true[0.3]["triangle"][0]
        marks += _binned_rows(about, solid, "triangle", setting.radius, spec, u)
    return {"profiles": rows, "mark_profiles": marks}


def meshes(
    setting: Setting, true: dict[float, dict[str, Field]], best: list[Row], poisson: float
) -> dict[str, list[Row]]:
    """A finer and an irregular mesh at one Poisson's ratio: with the cube's best RSC0 as it is, and with their own.

    `mesh_profiles`: the difference over the distance with equal edges under the triangle.
    """
    rows, bins = [], []
    kinds = (("main", setting.main, "P2"), ("irregular", setting.main, "P2"), ("finer", setting.fine, "P1"))
    for kind, nodes, element in kinds:
        irregular = kind == "irregular"
        solid = tissue(nodes, poisson, irregular)
        fields = true[poisson] if kind == "main" else truths(setting, poisson, nodes, element, irregular)
        grid = np.geomspace(*SEARCH, (setting.steps + 1) // 2)
        for name, weights in itertools.product(CONTACTS, WEIGHTS):
            u = fields[name][0]
            answers = ModelAnswers(solid, "exponential", weights, name, setting.radius)
            kept = shown_laws(best, name, poisson, weights)["exponential"].rsc
            for choice, size in (("the main cube's", -kept), ("its own best", answers.least(u, "worst_mm", grid))):
                about = {"mesh": kind, "nodes": nodes, "element": element, "contact": name, "weights": weights}
                rows.append({**about, "choice": choice, "rsc": size} | answers.errors(size, u))
                if (name, weights) == ("triangle", "equal"):
                    law = spring_law("exponential", size, weights)
                    bins += _binned_rows({"mesh": kind, "choice": choice}, solid, name, setting.radius, law, u)
    return {"meshes": rows, "mesh_profiles": bins}


def stiffness(setting: Setting, ratios: tuple[float, ...]) -> dict[str, list[Row]]:
    """Force at `DEPTH` by finite elements: element, mesh and contact, to show which contacts have a limit."""
    rows = []
    coarse, main = setting.sizes[0], setting.main
    meshes = [(coarse, "P1"), (coarse, "P2"), (main, "P1"), (main, "P2"), (setting.fine, "P1")]
    for poisson, (nodes, element) in itertools.product(ratios, meshes):
        for name, (_, force) in truths(setting, poisson, nodes, element).items():
            about = {"poisson": poisson, "nodes": nodes, "element": element, "contact": name}
            rows.append({**about, "force_n": float(force[2])})
    return {"stiffness": rows}
