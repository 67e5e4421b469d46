"""What a hand would notice: ripple of the stiffness while sliding, and work that a loop should not give."""

from typing import Any

import numpy as np

from palpate.arrays import Float64
from palpate.report.tables import Row
from palpate.simulation.pointer import Command
from palpate.simulation.session import Session
from palpate.studies.deformation.config import SIDE, Setting, tissue
from palpate.tissue.models.registry import model, names
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.reference.solver import finite_elements

POISSON = 0.45
PRESS = 3.0  # mm

Path = tuple[Float64, Float64]  # points (n, 3) on the surface at rest, displacements (n, 3)


def ripple(setting: Setting) -> dict[str, list[Row]]:
    """Stiffness along a line over more than four edges of the top, for every model and radius of the patch."""
    solid = tissue(setting.ripple, POISSON)
    edge = SIDE / (setting.ripple - 1)
    s = np.linspace(0, 1, setting.points)
    start, along = np.array([0.39 * SIDE, 0.46 * SIDE]), np.array([4.6 * edge, 1.7 * edge])
    path = np.column_stack([start + s[:, None] * along, np.full(len(s), SIDE)])
    models: dict[str, Any] = {
        "finite elements": finite_elements(solid, "P1"),
        **{name: model(solid, name) for name in names()},
    }
    rows = []
    for radius in setting.radii:
        for name, one in models.items():
            force, warm = [], None
            for x in path:
                answer = one.push(x, [0, 0, -1.0], radius * edge, tolerance=1e-3, warm=warm)
                warm = answer.warm
                force.append(answer.force[2])
            for x, f in zip(path, force, strict=True):
                where = {"x": float(x[0]), "y": float(x[1]), "force_n": float(f)}
                rows.append({"model": name, "radius_edges": radius, "radius_mm": radius * edge, **where})
    return {"ripple": rows}


def without_parabola(force: Float64) -> Float64:
    """Force along a line less the parabola through it: the cube is softer towards its rim."""
    s = np.linspace(0, 1, len(force))
    return np.asarray(force - np.polyval(np.polyfit(s, force, 2), s))


def peak_to_peak(force: Float64) -> float:
    """Of the stiffness along a line, a parabola taken out, as a share of the mean."""
    return float(np.ptp(without_parabola(force)) / np.mean(force))


def paths(count: int) -> dict[str, Path]:
    """Closed loops of a hand that presses, moves, and lets go; `count` steps each."""
    s = np.linspace(0, 1, count)
    press = np.clip(np.minimum(s, 1 - s) * 4, 0, 1)  # down, a while, up
    inner = np.clip((s - 0.25) * 2, 0, 1)  # the while
    centre, down = np.array([SIDE / 2, SIDE / 2, SIDE]), np.array([0.0, 0.0, -PRESS])
    still = np.tile(centre, (count, 1))
    turn = np.column_stack([np.sin(2 * np.pi * inner), 1 - np.cos(2 * np.pi * inner), np.zeros(count)])
    rim = np.array([0.84 * SIDE, SIDE / 2, SIDE])
    ways = {
        "press and let go": (still, press[:, None] * down),
        "press, stir sideways": (still, press[:, None] * down + 2.0 * turn),
        "press, slide in a circle": (centre + 0.2 * SIDE * turn, press[:, None] * down),
        "press at the centre, slide to the rim": (centre + inner[:, None] * (rim - centre), press[:, None] * down),
        "press at the rim, slide to the centre": (rim + inner[:, None] * (centre - rim), press[:, None] * down),
    }
    return {name: (np.ascontiguousarray(x), np.ascontiguousarray(d)) for name, (x, d) in ways.items()}


def work(points: Float64, displacements: Float64, force: Float64) -> tuple[float, float]:
    """N·mm that the hand puts in along a path, and the most that the tissue held on it. force: (n, 3) N on the tool."""
    tool = points + displacements
    middle = (force[1:] + force[:-1]) / 2
    stored = -(force * displacements).sum(axis=1) / 2
    return float(-(middle * np.diff(tool, axis=0)).sum()), float(stored.max())


def loops(setting: Setting) -> dict[str, list[Row]]:
    """Net work of each loop by each model: in equilibrium at every step, and in a session as it runs, in lockstep."""
    solid, radius = tissue(setting.main, POISSON), 2 * SIDE / (setting.main - 1)
    rows = []
    for name in names():
        one = model(solid, name)
        for path, (x, d) in paths(setting.steps_of_path).items():
            force = np.array([one.push(a, b, radius, tolerance=1e-3).force for a, b in zip(x, d, strict=True)])
            net, held = work(x, d, force)
            rows.append({"model": name, "how": "equilibrium", "path": path, "net_nmm": net, "stored_nmm": held})
        for path, (x, d) in paths(setting.ticks).items():
            for sweeps in (None, 1):
                net, held, done = _session(one, x, d, radius, sweeps)
                how = f"session, {'one sweep' if sweeps else 'as by default'}"
                about = {"model": name, "how": how, "path": path, "sweeps": done}
                rows.append({**about, "net_nmm": net, "stored_nmm": held})
    return {"loops": rows}


def _session(one: TissueModel, x: Float64, d: Float64, radius: float, sweeps: int | None) -> tuple[float, float, int]:
    """Net work and greatest stored energy of a path held in lockstep, half a second of stillness at its end."""
    session = Session(one, radius=radius, sweeps=sweeps)
    still = 500
    x, d = (np.concatenate([v, np.repeat(v[-1:], still, axis=0)]) for v in (x, d))
    commands = [Command(True, tuple(a), tuple(b)) for a, b in zip(x.tolist(), d.tolist(), strict=True)]
    force = session.step(commands)
    settings = session.settings
    pace = settings.approach, settings.reach
    net, held = work(_limited_pace(x, pace, x[0]), _limited_pace(d, pace, np.zeros(3)), force)
    return net, held, int(settings.sweeps)


def _limited_pace(wanted: Float64, pace: tuple[float, float], start: Float64) -> Float64:
    """Where the tool really was: each tick covers a part of the way, and no more than so many mm."""
    at, out = start.copy(), np.empty_like(wanted)
    for i, to in enumerate(wanted):
        length = float(np.linalg.norm(to - at))
        part = 1.0 if length < 1e-6 else min(pace[0], pace[1] / length)
        at = at + part * (to - at)
        out[i] = at
    return out
