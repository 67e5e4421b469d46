"""The kidney of the sample CT at several resolutions: what a deformation costs, and how wrong it is where."""

from functools import partial

import numpy as np

from palpate import _core
from palpate.arrays import Float64
from palpate.meshes.tet_mesh import TetMesh
from palpate.meshes.tetrahedralize import tetrahedralize
from palpate.report.tables import Row
from palpate.samples import KIDNEY_BED, KIDNEY_LABEL, KIDNEY_POISSON, sample
from palpate.studies.deformation.accuracy_cost import timed
from palpate.studies.deformation.config import DEPTH, Setting
from palpate.tissue.boundary_conditions import resting_on
from palpate.tissue.model_selection import select_model
from palpate.tissue.models.registry import model, names
from palpate.tissue.models.ring_relaxation import RingModel
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.named_tissues import tissue_properties
from palpate.tissue.spring_fitting import fit, scattered_points, surface_normals
from palpate.tissue.tissue import Tissue
from palpate.volumes.io import read_labels

TOLERANCES = (1e-1, 1e-2, 1e-3)
TOUCHES = 6
SHOWN = 10.0  # mm
ASKED = (0.3, 0.05, 10.0)  # mm, share of force, mm of push


def kidney(edge: float) -> Tissue:
    """The left kidney at this edge length, mm, its rear held, springs not fitted."""
    mesh = tetrahedralize(read_labels(sample("abdomen") / "labels.nii.gz"), label=KIDNEY_LABEL, edge=edge)
    young = tissue_properties("kidney").required("young")
    return Tissue(mesh, young, KIDNEY_POISSON, _fixed_nodes(mesh), element="P1")


def _fixed_nodes(mesh: TetMesh) -> np.ndarray:
    return resting_on(mesh, (0.0, 1.0, 0.0), depth=KIDNEY_BED * float(np.ptp(mesh.nodes[:, 1])))


def timings(setting: Setting) -> dict[str, list[Row]]:
    """Processor seconds of pushes from rest at several tolerances, of pulls to 1 %, and of one sweep, by model."""
    rows = []
    for resolution, edge in setting.kidneys:
        solid = kidney(edge)
        radius = 2 * solid.edge
        points = scattered_points(solid, TOUCHES)
        pushes = -DEPTH * surface_normals(solid, points)
        for name in names():
            one, making = timed(partial(model, solid, name))
            _, first = timed(partial(one.push, points[0], pushes[0], radius))
            row: Row = {"resolution": resolution, "edge_mm": edge, "nodes": len(solid.mesh.nodes)}
            row |= {"tets": len(solid.mesh.tets), "surface": len(solid.mesh.surface_nodes)}
            row |= {"model": name, "making_s": making + first}
            for tolerance in TOLERANCES:
                row[f"push_s_{tolerance:g}"] = _median_seconds(one, points, pushes, radius, tolerance, setting.repeats)
            row["pull_s_0.01"] = _median_seconds(one, points, -pushes, radius, 0.01, setting.repeats)
            row["sweep_s"] = sweep_seconds(one, radius)
            rows.append(row)
    return {"kidneys": rows}


def _median_seconds(
    one: TissueModel, points: Float64, tools: Float64, radius: float, tolerance: float, repeats: int
) -> float:
    """Over the points, the least time of the repeats at each."""
    push = partial(one.push, radii=radius, tolerance=tolerance)
    spent = [
        min(timed(partial(push, x, tool))[1] for _ in range(max(2, repeats // 2)))
        for x, tool in zip(points, tools, strict=True)
    ]
    return float(np.median(spent))


def shapes(setting: Setting) -> dict[str, list[Row]]:
    """Where springs take the surface nodes of each kidney that is pushed and pulled by `SHOWN` at one surface node."""
    rows = []
    for resolution, edge in setting.kidneys:
        solid = kidney(edge)
        mesh = solid.mesh
        free = mesh.surface_nodes[~solid.held[mesh.surface_nodes]]
        front = mesh.nodes[free[np.argmin(mesh.nodes[free, 1])]]
        tool = -SHOWN * surface_normals(solid, front[None])[0]
        one = model(solid, "springs")
        ways = {"push": tool, "pull": -tool}
        moved = {way: one.push(front, w, 2 * solid.edge, tolerance=0.01).displacement for way, w in ways.items()}
        for i in mesh.surface_nodes.tolist():
            row: Row = {"resolution": resolution, "edge_mm": edge, "node": i}
            for way, u in moved.items():
                row |= {
                    f"{way}_{axis}": round(float(v), 4) for axis, v in zip("xyz", mesh.nodes[i] + u[i], strict=True)
                }
            rows.append(row)
    return {"kidney_shapes": rows}


def sweep_seconds(one: TissueModel, radius: float) -> float | None:
    """Of one native sweep as the loop's ticks do it; None for models whose ticks are not ring sweeps."""
    return (
        float(_core.simulation.sweep_seconds(one.native, one.tissue.surface, radius))
        if isinstance(one, RingModel)
        else None
    )


def fitted(setting: Setting) -> dict[str, list[Row]]:
    """The first resolution's springs fitted: their error at each surface node, and which model is needed."""
    solid = kidney(setting.kidneys[0][1])
    tissue = fit(solid.mesh, solid.young, solid.poisson, solid.fixed, element=solid.element)
    assert tissue.report is not None
    nodes = tissue.mesh.surface_nodes
    error = [
        {"x": float(x[0]), "y": float(x[1]), "z": float(x[2]), "error_mm": float(e)}
        for x, e in zip(tissue.mesh.nodes[nodes], tissue.report.error_map[nodes], strict=True)
    ]
    found = select_model(tissue, *ASKED, element=tissue.element, contacts=setting.contacts)
    text = [{"line": line} for line in (*tissue.report.text().splitlines(), *found.text().splitlines())]
    return {"kidney_error": error, "kidney_words": text}
