"""The loop without a page: a tick's time for every resolution and model, the rate kept, the force's steps, memory."""

import json
import subprocess
import sys
from typing import Any

import numpy as np

from palpate import _core
from palpate.arrays import Float64, Int64
from palpate.report.tables import Row
from palpate.simulation.pointer import Command
from palpate.simulation.recorded_session import session_like
from palpate.simulation.scripted_device import ScriptedDevice
from palpate.simulation.session import RATE, Session
from palpate.simulation.session_settings import default_radius, sweep_seconds, sweeps_in_tick
from palpate.studies.deformation.kidney import kidney
from palpate.studies.realtime.config import HAND, RAMP, Setting, path
from palpate.tissue.models.registry import model
from palpate.tissue.tissue import Tissue

STEP = 1e-5  # s, of the loop's tallies


def measured(setting: Setting, resolution: str, edge: float) -> dict[str, list[Row]]:
    """Of one resolution, all models."""
    tissue = kidney(edge)
    size: Row = {"resolution": resolution, "edge_mm": edge, "nodes": len(tissue.mesh.nodes)}
    size |= {"tets": len(tissue.mesh.tets), "triangles": len(tissue.mesh.surface)}
    ticks, loops, memory = [], [], []
    for name in setting.models:
        ticks.append(size | {"model": name} | slid(setting, tissue, name))
        loops.append(size | {"model": name} | looped(setting, tissue, name))
        memory.append(size | {"model": name} | held(edge, name))
    return {"ticks": ticks, "loops": loops, "memory": memory}


def slid(setting: Setting, tissue: Tissue, name: str) -> Row:
    """Wall seconds of finding the contact and of the model's answer, 1000 times a second, under a sliding press."""
    one = model(tissue, name)
    points, press = path(tissue, setting.ticks)
    radius = default_radius(tissue)
    sweep = sweep_seconds(one, radius)
    sweeps = sweeps_in_tick(sweep)
    given = one.native, one.native.make_state(), tissue.surface, radius, points, press.tolist(), RAMP, sweeps
    contact, answer, _, cold, _ = _core.benchmark.time_stroke(*given)
    spent = (contact + answer)[RAMP:]
    told = {f"p{100 * q:g}_ms": 1e3 * float(np.quantile(spent, q)) for q in (0.5, 0.99, 0.999)}
    return {"sweeps": sweeps, "sweep_ms": 1e3 * sweep, **told, "cold_share": float(np.mean(cold[RAMP:]))}


def looped(setting: Setting, tissue: Tissue, name: str) -> Row:
    """The real loop under 60 commands a second, beside a thread that does nothing by the same clock."""
    session = Session(model(tissue, name))
    ticks = int(setting.seconds * RATE)
    points, press = path(tissue, ticks)
    at = list(range(0, ticks, HAND))
    hand = ScriptedDevice(at, [Command(True, _vector(points[t]), _vector(press * min(1, t / RAMP))) for t in at])
    with session:
        session.start(hand)
        woken, empty_late = _core.benchmark.timer_jitter(ticks)
    frame = session.frame()
    worked, computed, late = session.loop.tallies()
    row: Row = {"ticks_a_second": frame.tick / frame.seconds, "late": frame.late / frame.tick}
    row |= {"empty_late": empty_late / ticks}
    for q in (0.5, 0.99, 0.999):
        row[f"work_p{100 * q:g}_ms"] = at_share(worked, q)
        row[f"processor_p{100 * q:g}_ms"] = at_share(computed, q)
        row[f"woken_p{100 * q:g}_ms"] = at_share(late, q)
        row[f"empty_woken_p{100 * q:g}_ms"] = 1e3 * float(np.quantile(woken, q))
    return row | {"faults": frame.faults} | steps(session, tissue)


def steps(session: Session, tissue: Tissue) -> Row:
    """The largest change of the force from tick to tick while it slid, as a share of its mean: from its exact replay."""
    record = session.record()
    force = np.concatenate([f[:, 0] for _, f in session_like(record, tissue).replayed(record, RATE)])
    force = force[min(2 * RAMP, len(force) // 2) : -1]  # on and along; the last tick lets go
    change = np.linalg.norm(np.diff(force, axis=0), axis=1)
    mean = float(np.linalg.norm(force, axis=1).mean())
    return {"mean_force_n": mean, "largest_step": float(change.max()) / mean if mean else None}


def at_share(count: Int64, share: float) -> float | None:
    """ms below which a share of a tally lies, to its step of 10 µs; None beyond its 10 ms."""
    bin_ = int(np.searchsorted(np.cumsum(count), share * count.sum()))
    return 1e3 * STEP * (bin_ + 1) if bin_ < len(count) - 1 else None


_APART = """
import json, sys
from pathlib import Path
def resident():
    words = Path("/proc/self/status").read_text().split()
    return int(words[words.index("VmRSS:") + 1]) / 1024
import palpate as pp
from palpate.simulation.session import Session
from palpate.studies.deformation.kidney import kidney
tissue = kidney(float(sys.argv[1]))
import gc; gc.collect()
before = resident()
session = Session(pp.model(tissue, sys.argv[2]))
point = tissue.surface.closest(tissue.mesh.nodes[0]).point
session.step([pp.Command(True, tuple(point), (0.0, 0.5, 0.0))] * 200)
print(json.dumps({"before_mb": before, "model_mb": resident() - before}))
"""


def held(edge: float, name: str) -> Row:
    """MB that a model and its session add in a process of their own; nothing where the system does not say."""
    if sys.platform != "linux":
        return {"before_mb": None, "model_mb": None}
    run = subprocess.run(
        [sys.executable, "-c", _APART, str(edge), name], capture_output=True, text=True, timeout=600, check=True
    )
    found: dict[str, Any] = json.loads(run.stdout)
    return found


def _vector(x: Float64) -> tuple[float, float, float]:
    return float(x[0]), float(x[1]), float(x[2])
