"""The deformed-node index table: which rows pushes of different size move, and the time that it saves."""

from functools import partial

import numpy as np

from palpate.report.tables import Row
from palpate.studies.deformation.accuracy_cost import timed
from palpate.studies.deformation.config import SIDE, Setting, contact, tissue
from palpate.tissue.contact_patches import contacts
from palpate.tissue.models.deformed_rows import ALL_ROWS, DeformedRows, deformed_rows
from palpate.tissue.models.mass_spring import SpringModel
from palpate.tissue.tissue import SpringLaw, Tissue

LAW = SpringLaw("exponential", -0.14, "equal", "rings")
DEPTHS = (0.05, 0.5, 5.0, 10.0, 15.0)  # mm, of pushes
STILL = (0.1, 0.01)  # mm: a row whose nodes move by less is the last, and so ends a sweep of such steps
SHOWN = 5.0  # mm, the push whose table is listed
MOST_SWEEPS = 20_000
TIMES = 10  # of each repeat


def reach(setting: Setting) -> dict[str, list[Row]]:
    """By cube, threshold and push: rows, nodes, sweeps, time and error of the table, and of all nodes by the same rule.

    `row_table`: the table of the coarsest cube. `row_nodes`: the nodes of the plane nearest the contact, main cube.
    """
    rows: list[Row] = []
    for nodes in (setting.main, setting.fine):
        solid, model = _springs(nodes)
        point = contact(solid, "triangle", 0.0)[0]
        for still in STILL:
            for depth in DEPTHS:
                down = [0.0, 0.0, -depth]
                exact = model.push(point, down, 0.0, tolerance=1e-7).displacement
                row: Row = {"nodes": nodes, "still_mm": still, "depth_mm": depth, "all": len(exact)}
                for who, whole in (("", False), ("whole_", True)):
                    found = deformed_rows(model, point, down, 0.0, still, whole)
                    gap = float(np.linalg.norm(found.displacement - exact, axis=1).max())
                    row |= {
                        f"{who}rows": len(found.rows),
                        f"{who}nodes_in_table": found.nodes,
                        f"{who}sweeps": found.sweeps,
                    }
                    row |= {
                        f"{who}error_mm": gap,
                        f"{who}s": _seconds(model, found, point, depth, still, whole, setting),
                    }
                rows.append(row)
    return {"reach": rows, "row_table": _table(setting), "row_nodes": _plane(setting)}


def _springs(nodes: int) -> tuple[Tissue, SpringModel]:
    """The dissertation's iteration is Gauss-Seidel: no over-relaxation."""
    solid = tissue(nodes, 0.3)
    return solid, SpringModel(solid, LAW, relaxation=1.0, rigid=True)


def _seconds(
    model: SpringModel, found: DeformedRows, point: np.ndarray, depth: float, still: float, whole: bool, s: Setting
) -> float:
    """Processor seconds of one native solution from rest, the contact and its rows at hand: least of the repeats."""
    spot = contacts(model.tissue, point, [0.0, 0.0, -depth], 0.0)
    first = ALL_ROWS if whole else 1
    solve = partial(model.springs.solve_rows, found.warm, spot.patches, spot.displacement, still, first, MOST_SWEEPS)
    return min(timed(lambda: [solve() for _ in range(TIMES)])[1] / TIMES for _ in range(s.repeats))


def _table(setting: Setting) -> list[Row]:
    """Row by row: how many nodes, which, and the most that one of them moves."""
    solid, model = _springs(setting.sizes[0])
    found = deformed_rows(model, contact(solid, "triangle", 0.0)[0], [0.0, 0.0, -SHOWN], 0.0, STILL[-1])
    moved = np.linalg.norm(found.displacement, axis=1)
    return [
        {"row": k + 1, "count": len(row), "members": " ".join(map(str, row)), "most_mm": float(moved[row].max())}
        for k, row in enumerate(found.rows)
    ]


def _plane(setting: Setting) -> list[Row]:
    """Row (0: in none) and displacement of the nodes of one plane, for each push."""
    solid, model = _springs(setting.main)
    point, x = contact(solid, "triangle", 0.0)[0], solid.mesh.nodes
    middle = x[np.argmin(np.abs(x[:, 1] - SIDE / 2)), 1]
    rows = []
    for depth in DEPTHS:
        found = deformed_rows(model, point, [0.0, 0.0, -depth], 0.0, STILL[0])
        number = np.zeros(len(x), int)
        for k, members in enumerate(found.rows):
            number[members] = k + 1
        for i in np.flatnonzero(x[:, 1] == middle):
            place = dict(
                zip(("x", "z", "moved_z"), (*x[i, [0, 2]].tolist(), float(found.displacement[i, 2])), strict=True)
            )
            rows.append({"depth_mm": depth, "still_mm": STILL[0], "row": int(number[i])} | place)
    return rows
