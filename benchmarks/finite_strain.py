"""Model `neo-hookean` against its truth: time to 1e-3 in the tangent's energy norm, cold, on one core.

The truth is Newton's method on the same P1 elements, to rounding: other code, direct solves of the tangent.
"""

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import numpy as np

import palpate as pp
from palpate import _core
from palpate.tissue.contact_patches import contacts

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.brick_meshes import block

TOP, RADIUS, TOLERANCE = np.array([25.0, 25.0, 50.0]), 10.0, 1e-3
CASES = ((11, 0.3, 5.0), (11, 0.3, 10.0), (11, 0.3, 15.0), (11, 0.45, 5.0), (11, 0.45, 15.0), (21, 0.3, 5.0))


def lines() -> Iterator[str]:
    """One row a push of the 50 mm cube, held at its bottom, patch radius 10 mm."""
    before = _core.base.threads()
    _core.base.set_threads(1)
    yield "CPU ms of a push from rest, first sight of the contact included; Newton's in the last column.\n"
    yield "| cube, ν, depth | steps | median | solves/s | error | estimate | force off | least J | Newton |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for nodes, poisson, depth in CASES:
        tissue = block(nodes, poisson=poisson)
        model, push = pp.model(tissue, "neo-hookean"), np.array([0, 0, -depth])
        began = time.process_time()
        truth = pp.finite_strain(tissue, "P1").push(TOP, push, RADIUS)
        newton, found, times = time.process_time() - began, contacts(tissue, TOP, push, RADIUS), []
        for _ in range(11 if nodes < 20 else 3):
            state = model.start()
            began = time.process_time()
            force, steps = model.equilibrium.solve(state, found.patches, found.displacement, 200, TOLERANCE)
            times.append(time.process_time() - began)
        elements, exact = model.equilibrium.elements, truth.displacement
        off = np.ascontiguousarray(state.u - exact)
        error = np.sqrt((off * elements.tangent(exact, off)).sum() / (exact * elements.tangent(exact, exact)).sum())
        residual, size, _ = model.equilibrium.balance(state)
        wrong = np.linalg.norm(force[0] - truth.force) / np.linalg.norm(truth.force)
        typical = median(times)
        yield (
            f"| {nodes}³, {poisson}, {depth:g} mm | {steps} | {1e3 * typical:.1f} | {1 / typical:.0f} | {error:.1e} "
            f"| {np.sqrt(residual / size):.1e} | {wrong:.1e} | {elements.energy(state.u)[2]:.2f} | {1e3 * newton:.0f} |"
        )
    _core.base.set_threads(before)
