"""Model `compliance` by the clock with a tissue that relaxes: what the history of its loads costs a tick.

    python -m benchmarks.relaxation_strokes [--edges 5 3]

A finger strokes the sample's kidney for ten seconds, of elastic tissue and of one that relaxes, by turns. Prints the ticks
that 50 and 99 % take at most, what part came late or lacked tables, and the nodes that the history held.
"""

import argparse
import time
from collections.abc import Iterator

import numpy as np

import palpate as pp
from palpate.simulation.scripted_device import ScriptedDevice
from palpate.simulation.starting_model import STEP, stroke
from palpate.studies.deformation.kidney import kidney

SECONDS, HAND = 10, 8
SPECTRUM = pp.Relaxation((0.3, 0.2), (0.1, 2.0))


def by_the_clock(tissue: pp.Tissue, radius: float) -> str:
    """A row of the table."""
    session = pp.Session(pp.model(tissue, "compliance"), radius=radius)
    ticks = list(range(0, 1000 * SECONDS, HAND))
    with session:
        session.start(ScriptedDevice(ticks, stroke(tissue, radius, ticks)))
        for _ in range(10 * SECONDS):
            time.sleep(0.1)
    frame, record = session.frame(), session.record()
    counts = np.cumsum(session.loop.tallies()[0])
    half, most = (1e6 * STEP * (np.searchsorted(counts, share * counts[-1]) + 1) for share in (0.5, 0.99))
    lacking = np.count_nonzero(record.lacking & 1) / max(frame.tick, 1)
    kind = "elastic" if tissue.relaxation is None else "relaxing"
    return f"| {len(tissue.mesh.nodes)} | {kind} | {half:.0f} | {most:.0f} | {frame.late / frame.tick:.2%} | {lacking:.1%} |"


def lines(edges: list[float]) -> Iterator[str]:
    """Two rows a mesh."""
    yield "| nodes | tissue | 50 %, µs | 99 %, µs | late | lacking tables |"
    yield "|---|---|---|---|---|---|"
    for edge in edges:
        p1 = kidney(edge)
        for relaxation in (None, SPECTRUM):
            tissue = pp.Tissue(p1.mesh, p1.young, p1.poisson, p1.fixed, relaxation=relaxation)
            yield by_the_clock(tissue, 2 * tissue.edge)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.relaxation_strokes", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--edges", type=float, nargs="+", default=[5.0, 3.0], help="mm, of the meshes")
    options = parser.parse_args()
    print(f"`python -m benchmarks.relaxation_strokes --edges {' '.join(f'{e:g}' for e in options.edges)}`:\n")
    for line in lines(options.edges):
        print(line, flush=True)
