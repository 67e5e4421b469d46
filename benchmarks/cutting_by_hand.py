"""A cut that follows a blade while the loop runs: how far behind it opens, what it does to ticks, and the steps of a force.

    python -m benchmarks.cutting_by_hand

The sample's kidney in several meshes, model `compliance`. A tool holds it beside the way of the blade, which goes 40 mm
along the surface at 20 and at 50 mm/s. The tissue is cut anew each time that the last cut has come, as `palpate touch` does.
Ticks are timed by the clock; the force's steps are those of a replay.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.arrays import Float64
from palpate.samples import KIDNEY_BED, KIDNEY_LABEL, KIDNEY_POISSON, sample
from palpate.server.cutting_stroke import TOLERANCE, simplified
from palpate.simulation.pointer import Command, Pointer
from palpate.simulation.session import RATE, Session
from palpate.tissue.models.compliance import ComplianceModel

EDGES = (6.0, 4.0, 3.2)  # mm
SPEEDS = (20.0, 50.0)  # mm/s
LENGTH, DEPTH = 40.0, 12.0  # mm
YOUNG = 15.0  # kPa
PRESS = 2.0  # mm
STEP = 1e-5  # s, of the loop's tallies


def kidney(edge: float) -> pp.Tissue:
    """The sample's kidney, bedded at its back."""
    labels = pp.read_labels(sample("abdomen") / "labels.nii.gz")
    mesh = pp.tetrahedralize(labels, KIDNEY_LABEL, edge=edge)
    extent = float(np.ptp(mesh.nodes[:, 1]))
    return pp.Tissue(mesh, YOUNG, KIDNEY_POISSON, pp.resting_on(mesh, (0, 1, 0), depth=KIDNEY_BED * extent))


@dataclass(frozen=True)
class Run:
    """One blade. seconds: of each cut. behind: mm from the blade to the end of the cut when that came. slowest: s, of 99 %
    of the ticks. late: ticks. step: N, the largest change of the force in a tick. force: N at the end."""

    seconds: list[float]
    behind: list[float]
    slowest: float
    late: int
    step: float
    force: float


def front_path(tissue: pp.Tissue) -> Float64:
    """(n, 3) mm: a way of `LENGTH` along the surface through the foremost point, about a millimetre from point to point."""
    tip = tissue.mesh.nodes[np.argmin(tissue.mesh.nodes[:, 1])]
    middle = tissue.mesh.nodes.mean(axis=0)
    points = []
    for angle in np.linspace(-1.2, 1.2, 4000):  # about the x axis, seen from the middle
        way = np.array([0.0, -np.cos(angle), np.sin(angle)])
        point = np.array(tissue.surface.closest(np.array([tip[0], *middle[1:]]) + 100 * way).point)
        if not points or np.linalg.norm(point - points[-1]) >= 1:
            points.append(point)
    half = int(LENGTH / 2)
    centre = min(max(half, len(points) // 2), len(points) - half - 1)
    return np.array(points[centre - half : centre + half + 1])


def cut_while_held(tissue: pp.Tissue, model: ComplianceModel, speed: float) -> Run:
    """A run at so many mm/s."""
    session, pointer, way = Session(model), Pointer(), front_path(tissue)
    beside = tissue.surface.closest(way[len(way) // 2] + (8.0, 0, 0))
    inward = -PRESS * np.array(tissue.surface.normal(beside))
    seconds, behind = [], []
    session.start(pointer)
    with session:
        pointer.send(Command(True, tuple(np.array(beside.point).tolist()), tuple(inward.tolist())), None, 0)
        time.sleep(0.5)
        before, began, done = session.tissue, time.monotonic(), 0
        while done < len(way):
            reached = min(len(way), int(speed * (time.monotonic() - began)) + 1)
            if reached < min(done + int(tissue.edge), len(way)) or reached < 2:
                time.sleep(0.005)
                continue
            start = time.monotonic()
            blade = pp.incision(before, simplified(way[:reached], TOLERANCE * tissue.edge), DEPTH)
            while not session.cut(blade, extend=done > 0):
                time.sleep(0.001)
            now = time.monotonic()
            done = reached
            seconds.append(now - start)
            behind.append(min(speed * (now - began), LENGTH) - (done - 1))
        time.sleep(1)
        counts = session.loop.tallies()[0]
        late = int(session.frame().late)
    slowest = STEP * float(np.searchsorted(np.cumsum(counts), 0.99 * counts.sum()) + 1)
    record = session.record()
    again = Session(model, sweeps=int(record.settings["sweeps"]))
    force = np.concatenate([some[:, 0] for _, some in again.replayed(record, 1000)])
    first = record.cuts[0].tick - 1
    steps = np.linalg.norm(np.diff(force[first : record.cuts[-1].tick + RATE // 2], axis=0), axis=1)
    return Run(
        seconds, behind, slowest, late, float(steps.max()), float(np.linalg.norm(force[record.cuts[-1].tick + 400]))
    )


def rows() -> Iterator[str]:
    """The table."""
    yield "| nodes | blade, mm/s | a cut, s | longest | behind the blade, mm | tick, 99 %, µs | late | step, mN a tick |"
    yield "|---|---|---|---|---|---|---|---|"
    for edge in EDGES:
        tissue = kidney(edge)
        model = pp.model(tissue, "compliance")
        for speed in SPEEDS:
            run = cut_while_held(tissue, model, speed)
            yield (
                f"| {len(tissue.mesh.nodes):,} | {speed:g} | {np.median(run.seconds):.2f} | {max(run.seconds):.2f} | "
                f"{max(run.behind):.0f} | {1e6 * run.slowest:.0f} | {run.late} | {1e3 * run.step:.2f} |"
            )


def main() -> None:
    """Prints the table and writes it into the documentation."""
    lines = []
    for row in rows():
        print(row, flush=True)
        lines.append(row)
    head = f"`python -m benchmarks.cutting_by_hand`: kidneys, a blade that goes {LENGTH:g} mm beside a press of {PRESS:g} mm"
    text = f"{head}\n\n" + "\n".join(lines) + "\n"
    (Path(__file__).parents[1] / "docs" / "figures" / "cutting-by-hand.md").write_text(text)


if __name__ == "__main__":
    main()
