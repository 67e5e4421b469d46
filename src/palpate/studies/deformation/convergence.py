"""Do sweeps converge, how fast, and do they stay stable whatever the hand does?"""

from typing import Any

import numpy as np

from palpate.arrays import Float64
from palpate.report.tables import Row
from palpate.studies.deformation.config import DEPTH, TOP, Setting, tissue
from palpate.studies.deformation.reference import spring_limit
from palpate.tissue.models.registry import model, names
from palpate.tissue.reference.solver import finite_elements
from palpate.tissue.tissue import SpringLaw, Tissue

LAW = SpringLaw("exponential", -0.14)
POISSON = 0.3
COUNTS = tuple(np.unique(np.geomspace(4, 512, 22).round().astype(int)).tolist())
SPRINGS_ONLY = 30  # nodes along a side from which on no direct solution of finite elements is at hand here
WILD = 100.0  # mm: nodes thrown about before the sweeps start
SHAKES = 200
FLOOR = 1e-8  # error below which nothing is gained in single precision


def limits(solid: Tissue, radius: float) -> dict[str, Float64]:
    """Where each kind of model must end, by other means: springs, and all others finite elements (P1)."""
    down = np.array([0.0, 0.0, -DEPTH])
    found = {"springs": spring_limit(solid, LAW, np.array(TOP), radius, down)}
    if round(len(solid.mesh.nodes) ** (1 / 3)) < SPRINGS_ONLY:
        found["finite elements"] = finite_elements(solid, "P1").push(TOP, down, radius).displacement
    return found


def linear_names(limit: dict[str, Float64]) -> list[str]:
    """Models whose limit is known."""
    known = [name for name in names() if name != "neo-hookean"]
    return known if "finite elements" in limit else ["springs"]


def options(name: str) -> dict[str, Any]:
    """Of a model in this part of the study."""
    return {"law": LAW} if name == "springs" else {}


def convergence(setting: Setting, nodes: int) -> dict[str, list[Row]]:
    """Error after so many sweeps from rest, and its certified bound, for every model with a known limit."""
    solid = tissue(nodes, POISSON)
    limit = limits(solid, setting.radius)
    rows, stability = [], []
    for name in linear_names(limit):
        one = model(solid, name, **options(name))
        true = limit.get(name, limit.get("finite elements"))
        assert true is not None
        for count in COUNTS:
            answer = one.push(TOP, [0, 0, -DEPTH], setting.radius, tolerance=FLOOR, most_sweeps=count)
            gap = float(np.linalg.norm(answer.displacement - true, axis=1).max() / DEPTH)
            about = {"nodes": nodes, "model": name, "sweeps": answer.sweeps}
            rows.append({**about, "error": gap, "bound": answer.error if np.isfinite(answer.error) else None})
            if answer.error <= FLOOR:
                break
        if answer.sweeps == 0:  # solved directly
            rows = [row for row in rows if row["model"] != name or row["nodes"] != nodes]
            continue
        stability.append({"nodes": nodes, "model": name} | _stability(one, true, setting.radius))
    return {"convergence": rows, "stability": stability}


def _stability(one: Any, true: Float64, radius: float) -> Row:
    """From nodes thrown about, does the error fall; and under a tool that jumps every tick, do nodes stay bounded?"""
    down, rng = [0.0, 0.0, -DEPTH], np.random.default_rng(5)
    answer = one.push(TOP, down, radius, tolerance=FLOOR, most_sweeps=4)
    free = ~one.tissue.held
    answer.warm.u[free] = rng.uniform(-WILD, WILD, answer.warm.u[free].shape)
    found: Row = {"wild_mm": WILD}
    done = 0
    for count in (64, 1024):
        answer = one.push(TOP, down, radius, tolerance=FLOOR, most_sweeps=count - done, warm=answer.warm)
        done = count
        found[f"after_{count}_mm"] = float(np.linalg.norm(answer.displacement - true, axis=1).max())
    warm, most = one.start(), 0.0
    for _ in range(SHAKES):
        answer = one.push(TOP, rng.uniform(-3 * DEPTH, 3 * DEPTH, 3), radius, tolerance=0.9, most_sweeps=1, warm=warm)
        most = max(most, float(np.abs(answer.displacement).max()))
    return {**found, "shaken_mm": most, "shake_mm": 3 * DEPTH}
