"""An organ of 100,000 nodes under the hand: python -m benchmarks.large_mesh [--edge 1.32] [--seconds 60].

The sample's kidney is meshed, given the model `multigrid`, and stroked at 50 mm/s by the clock. Forces that were shown on the
way are compared with pushes of the same displacement, solved to 1e-3.
"""

import argparse
import resource
import time
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.simulation.fem_reference import DisplayedTick
from palpate.simulation.scripted_device import ScriptedDevice
from palpate.simulation.starting_model import stroke

FRAME, HAND, RATE = 0.1, 16, 1000  # s, ticks, a second
TAKEN = 8  # bit of a recorded tick: a solution was taken
SETTLED = 2000  # ticks, from which on forces are compared
COMPARED = 12


def strokes(model: object, seconds: float) -> tuple[pp.Session, list[DisplayedTick]]:
    """A session by the clock, and frames of it."""
    session = pp.Session(model)
    radius, ticks = session.settings.radius, range(0, int(RATE * seconds), HAND)
    seen = []
    with session:
        session.start(ScriptedDevice(ticks, stroke(model.tissue, radius, list(ticks))))
        while session.frame().tick < ticks[-1]:
            time.sleep(FRAME)
            frame = session.frame()
            if frame.tick > SETTLED and any(frame.contact):
                seen.append(DisplayedTick.of(frame))
    return session, seen


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.large_mesh", description=__doc__.splitlines()[0])
    parser.add_argument("--edge", type=float, default=1.32, help="mm, of the mesh")
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    labels = pp.read_labels(Path(pp.__file__).parent / "samples" / "abdomen" / "labels.nii.gz")
    began = time.perf_counter()
    mesh = pp.tetrahedralize(labels, "kidney_left", edge=options.edge)
    meshed = time.perf_counter() - began
    tissue = pp.Tissue(mesh, 15.0, 0.45, pp.resting_on(mesh, (0, 1, 0)))
    began = time.perf_counter()
    model = pp.model(tissue, "multigrid")
    made = time.perf_counter() - began
    session, seen = strokes(model, options.seconds)
    peak, frame, record = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6, session.frame(), session.record()
    off = []
    for tick in seen[:: max(1, len(seen) // COMPARED)]:
        exact = model.push(tick.points[0], tick.displacements[0], session.settings.radius).force
        off.append(100 * np.linalg.norm(tick.answers[0] - exact) / np.linalg.norm(exact))
    print(f"`python -m benchmarks.large_mesh --edge {options.edge:g} --seconds {options.seconds:g}`:\n")
    print("| nodes | meshed, s | made, s | peak, GB | late ticks | solutions/s | force off: median, worst |")
    print("|---|---|---|---|---|---|---|")
    print(
        f"| {len(mesh.nodes)} | {meshed:.1f} | {made:.1f} | {peak:.1f} | {frame.late / frame.tick:.3%} "
        f"| {np.count_nonzero(record.lacking & TAKEN) / options.seconds:.1f} | {np.median(off):.1f}, {max(off):.1f} % |"
    )
