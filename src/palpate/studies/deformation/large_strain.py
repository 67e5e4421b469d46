"""Beyond linear elasticity: large pushes, and a cube that was really measured."""

from typing import Any

import numpy as np

from palpate.arrays import Float64
from palpate.report.tables import Row
from palpate.studies.deformation.config import DEPTHS, TOP, YOUNG, Setting, cube, tissue
from palpate.studies.deformation.reference import solve_with_imposed_nodes
from palpate.tissue.models.registry import model
from palpate.tissue.reference.solver import finite_elements, finite_strain
from palpate.tissue.spring_fitting import fit
from palpate.tissue.tissue import Tissue

POISSON = 0.3
FINITE = "neo-hookean"
# A. E. Kerdok et al., Medical Image Analysis 7 (2003) 283, and biorobotics.harvard.edu/truthcube/truthcube.html
TRUTH_CUBE_SIDE, TRUTH_CUBE_STRAINS = 80.0, (0.05, 0.125, 0.1825)


def large(setting: Setting) -> dict[str, list[Row]]:
    """Every model against finite strain (Newton's method, P1) at every depth: `large` pushed, `pull` pulled."""
    solid = tissue(setting.main, POISSON)
    solid = fit(
        solid.mesh, solid.young, solid.poisson, solid.fixed, element="P1", radius=setting.radius, depth=DEPTHS[0]
    )
    truth = finite_strain(solid, "P1")
    models: dict[str, Any] = {"linear finite elements": finite_elements(solid, "P1")}
    models |= {name: model(solid, name) for name in ("springs", FINITE)}
    tables: dict[str, list[Row]] = {"large": [], "pull": []}
    for table, sign, depth in [(t, s, d) for t, s in (("large", -1.0), ("pull", 1.0)) for d in DEPTHS]:
        tool = [0.0, 0.0, sign * depth]
        true = truth.push(TOP, tool, setting.radius)
        for name, one in models.items():
            found = one.push(TOP, tool, setting.radius, tolerance=1e-5)
            gap = np.linalg.norm(found.displacement - true.displacement, axis=1)
            off = float(np.linalg.norm(found.force - true.force) / np.linalg.norm(true.force))
            row: Row = {"model": name, "depth_mm": depth, "worst_mm": float(gap.max())}
            row |= {"rms_mm": float(np.sqrt((gap**2).mean())), "force_error": off, "true_force_n": float(true.force[2])}
            tables[table].append(row | {"least_volume": float(_volumes(solid, found.displacement).min())})
    return tables


def _volumes(solid: Tissue, displacement: Float64) -> Float64:
    """(M,) volume of each tetrahedron over its volume at rest; below 0 where it is inside out."""
    x = solid.mesh.nodes + displacement
    corner = x[solid.mesh.tets]
    return np.asarray(np.linalg.det(corner[:, 1:] - corner[:, :1]) / 6 / solid.mesh.volumes)


def truth_cube(setting: Setting) -> dict[str, list[Row]]:
    """What linear finite elements predict for the Truth Cube's compressions: how far its sides bulge at mid height."""
    rows = []
    mesh = cube(setting.main - 1 + setting.main % 2, side=TRUTH_CUBE_SIDE)
    x = mesh.nodes
    for poisson in (0.45, 0.49):
        solid = Tissue(mesh, YOUNG, poisson, x[:, 2] == 0, element="P1")
        truth = finite_elements(solid, "P2")
        top = np.flatnonzero(x[:, 2] == TRUTH_CUBE_SIDE).astype(np.int32)
        u, force = solve_with_imposed_nodes(truth, top, np.array([0.0, 0.0, -1.0]))
        side = (x[:, 0] == TRUTH_CUBE_SIDE) & np.isclose(x[:, 2], TRUTH_CUBE_SIDE / 2)
        middle = np.isclose(x[:, 1], TRUTH_CUBE_SIDE / 2) & side
        for strain in TRUTH_CUBE_STRAINS:
            push = strain * TRUTH_CUBE_SIDE
            stress = float(force[2]) * push / TRUTH_CUBE_SIDE**2 / (YOUNG * 1e-3)
            row = {"poisson": poisson, "element": truth.element, "strain": strain, "compressed_mm": push}
            rows.append({**row, "bulge_mm": float(u[middle, 0].mean() * push), "stress_over_young": stress})
    return {"truth_cube": rows}
