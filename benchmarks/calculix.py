"""How far CalculiX, an independent finite-element code, agrees with ours: linear P1 and P2, and finite strain.

Beside agreement, CPU seconds of each for the whole push: files, assembly, factors and solve.
"""

import resource
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import palpate as pp

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from support.calculix import FOUR_POINTS, MISSING, SPLIT, apart, calculix, cube, there

from palpate.tissue.reference.finite_strain import FiniteStrain

CASES = (
    (11, "P1", 5.0, False),
    (21, "P1", 5.0, False),
    (11, "P2", 5.0, False),
    (11, "P1", 5.0, True),
    (11, "P1", 10.0, True),
    (7, "P2", 5.0, True),
)


def lines() -> Iterator[str]:
    """One row a case, on the 50 mm cube with a stiff ball in it."""
    if not there():
        yield MISSING
        return
    yield "Greatest difference of displacement over the greatest displacement, and of the force; a push of 1 mm sideways and"
    yield "as deep as the table says, patch radius 2.5 cells. At finite strain both have CalculiX's neo-Hookean energy.\n"
    yield "| 50 mm cube | displacement | force | CalculiX, CPU s | ours, CPU s |\n|---|---|---|---|---|"
    for nodes, element, depth, finite in CASES:
        tissue, push, radius = cube(nodes), np.array([1.0, 0.0, -depth]), 2.5 * 50 / (nodes - 1)
        top = np.array([25.0, 25.0, 50.0])
        began = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        theirs = calculix(tissue, element, top, push, radius, finite)
        took, began = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - began, time.process_time()
        ours = (
            FiniteStrain(tissue, element, SPLIT, FOUR_POINTS[element])
            if finite
            else pp.finite_elements(tissue, element)
        ).push(top, push, radius)
        mine = time.process_time() - began
        u, force = apart(theirs, ours)
        what = "neo-Hookean" if finite else "linear"
        yield f"| {nodes}³ {element}, {depth:g} mm, {what} | {u:.1e} | {force:.1e} | {took:.2f} | {mine:.2f} |"
