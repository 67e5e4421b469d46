"""Tissue that relaxes or has mass: what that costs a tick, and how right it is.

    python -m benchmarks.tissue_in_time [--edges 5 2.4]

A finger strokes the sample's kidney for ten seconds, by the clock: elastic tissue, one that relaxes, one with 100 modes of
vibration, one with both, and one that relaxes in shear alone. Prints the time that 50 and 99 % of the ticks take at most,
and what part came late or lacked tables.

Then a push on a cube, just after it is made and in the long term, if shear and bulk relax alike, and if shear relaxes alone:
both are elastic then. Prints the rise of the force over its long-term value.

Then taps of 4 mm on a cube with mass, held for 0.1 s and let go, against all its modes: differences of the force over its
largest value, and RMS of the surface in the 0.3 s after it is let go, over its largest value and its RMS.
"""

import argparse
import time
from collections.abc import Iterator
from itertools import chain

import numpy as np

import palpate as pp
from benchmarks.cube_case import PUSH, TOP, YOUNG, AllModes, brick, smooth
from palpate.simulation.scripted_device import ScriptedDevice
from palpate.simulation.starting_model import STEP, stroke
from palpate.studies.deformation.kidney import kidney
from palpate.tissue.contact_patches import patch
from palpate.tissue.reference.linear_elasticity import lame
from palpate.tissue.tissue import KPA

SECONDS, HAND = 10, 8
SPECTRUM = pp.Relaxation((0.3, 0.2), (0.1, 2.0))
IN_SHEAR = pp.Relaxation(SPECTRUM.shares, SPECTRUM.times, bulk=False)


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
    parts = ["relaxing"] * (tissue.relaxation is not None) + ["100 modes"] * (tissue.inertia is not None)
    kind = ", ".join(parts) or "elastic"
    if tissue.relaxation is not None and not tissue.relaxes_alike:
        kind += " in shear"
    return f"| {len(tissue.mesh.nodes)} | {kind} | {half:.0f} | {most:.0f} | {frame.late / frame.tick:.2%} | {lacking:.1%} |"


def lines(edges: list[float]) -> Iterator[str]:
    """Five rows a mesh."""
    yield "| nodes | tissue | 50 %, µs | 99 %, µs | late | lacking tables |"
    yield "|---|---|---|---|---|---|"
    for edge in edges:
        p1 = kidney(edge)
        swinging = pp.Inertia()
        for relaxation, inertia in (
            (None, None),
            (SPECTRUM, None),
            (None, swinging),
            (SPECTRUM, swinging),
            (IN_SHEAR, None),
        ):
            tissue = pp.Tissue(p1.mesh, p1.young, p1.poisson, p1.fixed, relaxation=relaxation, inertia=inertia)
            yield by_the_clock(tissue, 2 * tissue.edge)


def bulk_lines() -> Iterator[str]:
    """One row a Poisson's ratio."""
    yield "| long-term ν | share that relaxes | rise, shear and bulk | rise, shear alone |"
    yield "|---|---|---|---|"
    mesh = brick((10, 10, 10))
    for nu in (0.3, 0.4, 0.45, 0.49):
        for share in (0.3, 0.5):
            lam, mu = lame(YOUNG, nu)
            bulk, shear = lam + 2 * mu / 3, mu / (1 - share)
            at_once = (9 * bulk * shear / (3 * bulk + shear), (3 * bulk - 2 * shear) / (6 * bulk + 2 * shear))
            long, soon = (
                float(
                    pp.finite_elements(pp.Tissue(mesh, E, ratio, mesh.nodes[:, 2] == 0)).push(TOP, PUSH, 12.0).force[2]
                )
                for E, ratio in ((YOUNG, nu), (at_once[0] / KPA, at_once[1]))
            )
            yield f"| {nu:g} | {share:.0%} | {1 / (1 - share) - 1:.0%} | {soon / long - 1:.0%} |"


def tap_lines() -> Iterator[str]:
    """One row a tap."""
    yield "| tap | damping | force RMS | worst | surface, of largest | of RMS |"
    yield "|---|---|---|---|---|---|"
    mesh = brick((10, 10, 10))
    taps = {
        "200 mm/s from rest at once": lambda t: min(t / 20, 1),
        "up to 150 mm/s, smoothly": lambda t: smooth(t, 40),
    }
    for damping in (0.02, 0.1):
        tissue = pp.Tissue(mesh, YOUNG, 0.45, mesh.nodes[:, 2] == 0, inertia=pp.Inertia(damping))
        model, under = pp.model(tissue, "compliance"), patch(tissue, TOP, 12.0)
        for name, depth in taps.items():
            truth, state, last = AllModes(tissue, 12.0), model.native.make_state(), np.zeros(3)
            found, expected, surface, true = [], [], [], []
            for t in range(1, 141):
                d = np.array([0, 0, -4.0 * depth(t)])
                found.append(model.native.relax(state, under, d, 1))
                expected.append(truth.tick(TOP, last, d))
                last = d
            for _ in range(300):
                model.native.relax(state, None, np.zeros(3), 1)
                truth.tick()
                surface.append(model.native.displayed_displacement(state, model.vertices))
                true.append(truth.whole()[model.vertices])
            off = np.linalg.norm(np.subtract(found, expected), axis=1) / np.abs(expected).max()
            apart, size = (np.sqrt(np.mean(np.square(part))) for part in (np.subtract(surface, true), true))
            yield (
                f"| {name} | {damping:g} | {np.sqrt(np.mean(off**2)):.1%} | {off.max():.1%} "
                f"| {apart / np.abs(true).max():.2%} | {apart / size:.1%} |"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tissue_in_time", description=__doc__.splitlines()[0])
    parser.add_argument("--edges", type=float, nargs="+", default=[5.0, 2.4], help="mm, of the meshes")
    options = parser.parse_args()
    print(f"`python -m benchmarks.tissue_in_time --edges {' '.join(f'{e:g}' for e in options.edges)}`:\n")
    for line in chain(
        lines(options.edges), ["", "A push on the cube:", ""], bulk_lines(), ["", "Taps:", ""], tap_lines()
    ):
        print(line, flush=True)
