"""Model `neo-hookean` by the clock: what a hand feels of deep strokes, against the quasi-static force of each moment.

    python -m benchmarks.multirate_strokes [--edge 5] [--depth 0.3]

Strokes on the sample's kidney: presses and slides at 20 and 100 mm/s. A frame says point, displacement and force of its
tick; the truth is the same tissue, solved to 1e-4 for that contact. Prints solutions a second, what part of the ticks came
late, the differences over the largest force of the stroke, and the largest change of force in a tick, in lockstep.
"""

import argparse
import time
from collections.abc import Iterator

import numpy as np

import palpate as pp
from palpate.simulation.fem_reference import DisplayedTick
from palpate.simulation.scripted_device import ScriptedDevice
from palpate.studies.deformation.kidney import kidney
from palpate.tissue.spring_fitting import scattered_points, surface_normals

RATE, FRAME = 1000, 0.01
TAKEN = 8  # bit of a recorded tick: a solution was taken
MOST_TRUTHS = 40  # ticks of a stroke that are solved for


def press(tissue: pp.Tissue, top: np.ndarray, inwards: np.ndarray, depth: float, speed: float) -> list[pp.Command]:
    """Down at a steady speed, held for 0.3 s, and back."""
    steps = int(depth / speed * RATE)
    way = np.concatenate([np.linspace(0, depth, steps), np.full(300, depth), np.linspace(depth, 0, steps)])
    return [pp.Command(True, tuple(top), tuple(d * inwards)) for d in way]


def slide(tissue: pp.Tissue, top: np.ndarray, inwards: np.ndarray, depth: float, speed: float) -> list[pp.Command]:
    """To a third of the depth at 20 mm/s, then 20 mm along the surface and back at the speed."""
    along = np.cross(inwards, np.eye(3)[np.argmin(np.abs(inwards))])
    along /= np.linalg.norm(along)
    down = np.linspace(0, depth / 3, int(depth / 3 / 20 * RATE))
    way = np.linspace(0, 20, int(20 / speed * RATE))
    commands = [pp.Command(True, tuple(top), tuple(d * inwards)) for d in down]
    for s in [*way, *way[::-1]]:
        at = tissue.surface.closest(np.ascontiguousarray(top + s * along)).point
        commands.append(pp.Command(True, tuple(at), tuple(depth / 3 * inwards)))
    return commands


def by_the_clock(model: object, commands: list[pp.Command], radius: float) -> tuple[list[DisplayedTick], float, float]:
    """Frames of a session, which part of its ticks was late, and the solutions a second."""
    session = pp.Session(model, radius=radius)
    seen: dict[int, DisplayedTick] = {}
    with session:
        session.start(ScriptedDevice(range(len(commands)), commands))
        while session.frame().tick < len(commands):
            time.sleep(FRAME)
            frame = session.frame()
            if any(frame.contact):
                seen[frame.tick] = DisplayedTick.of(frame)
    record, frame = session.record(), session.frame()
    solutions = np.count_nonzero(record.lacking & TAKEN)
    return list(seen.values()), frame.late / frame.tick, solutions / (len(commands) / RATE)


def truth(model: object, ticks: list[DisplayedTick], radius: float) -> np.ndarray:
    """N on the tool."""
    warm, out = None, []
    for tick in ticks:
        answer = model.push(tick.points[0], tick.displacements[0], radius, tolerance=1e-4, warm=warm)
        warm = answer.warm
        out.append(answer.force)
    return np.array(out)


def lines(edge: float, share: float) -> Iterator[str]:
    """One row a stroke."""
    p1 = kidney(edge)
    tissue = pp.Tissue(p1.mesh, p1.young, p1.poisson, p1.fixed)  # smoothed elements
    top = scattered_points(tissue, 1)[0]
    inwards = -surface_normals(tissue, top[None])[0]
    depth, radius = share * float(np.ptp(tissue.mesh.nodes @ inwards)), 2 * tissue.edge
    model, linear = pp.model(tissue, "neo-hookean"), pp.model(tissue, "compliance")
    yield f"{len(tissue.mesh.nodes)} nodes, {depth:.1f} mm deep, radius {radius:.1f} mm\n"
    yield "| stroke | mm/s | solutions/s | late ticks | RMS | worst | linear RMS | largest step |"
    yield "|---|---|---|---|---|---|---|---|"
    for kind in (press, slide):
        for speed in (20.0, 100.0):
            commands = kind(tissue, top, inwards, depth, speed)
            ticks, late, solutions = by_the_clock(model, commands, radius)
            ticks = ticks[:: max(1, len(ticks) // MOST_TRUTHS)]
            exact = truth(model, ticks, radius)
            most = np.linalg.norm(exact, axis=1).max()
            off = np.linalg.norm(np.array([t.answers[0] for t in ticks]) - exact, axis=1) / most
            linear_off = [
                np.linalg.norm(linear.push(t.points[0], t.displacements[0], radius).force - f) / most
                for t, f in zip(ticks[::4], exact[::4], strict=True)
            ]
            force = pp.Session(model, radius=radius).step(commands)
            step = np.linalg.norm(np.diff(force, axis=0), axis=1).max() / np.linalg.norm(force, axis=1).max()
            rms, linear_rms = (100 * np.sqrt(np.mean(np.square(part))) for part in (off, linear_off))
            yield (
                f"| {kind.__name__} | {speed:g} | {solutions:.0f} | {100 * late:.1f} % "
                f"| {rms:.1f} % | {100 * off.max():.1f} % | {linear_rms:.1f} % | {100 * step:.2f} % |"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.multirate_strokes", description=__doc__.splitlines()[0])
    parser.add_argument("--edge", type=float, default=5.0, help="mm, of the mesh")
    parser.add_argument("--depth", type=float, default=0.3, help="of the organ's extent along the push")
    options = parser.parse_args()
    print(f"`python -m benchmarks.multirate_strokes --edge {options.edge:g} --depth {options.depth:g}`:\n")
    for line in lines(options.edge, options.depth):
        print(line, flush=True)
