"""What a hand feels of a tissue through a session and a device: dynamic stiffness next to the tissue's own, and Z-width.

    python -m benchmarks.transparency

The sample's kidney, model `compliance`, elastic and relaxing. The hand presses 2 mm and swings by 0.2 mm. A tool in space, as
devices send it; a tool that holds the tissue, as they send it while a button is down; and both behind a coupling. Then the
greatest stiffness at which a device of 0.1 kg and 0.5 N s/m stays stable, without a hand and with one. No clock is read.
"""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

import palpate as pp
from benchmarks.cutting_by_hand import kidney

EDGE, DEPTH, AMPLITUDE = 8.0, 2.0, 0.2  # mm
FREQUENCIES = (0.1, 1.0, 3.0, 10.0, 30.0, 100.0)  # Hz
SPECTRUM = pp.Relaxation((0.3, 0.2), (0.1, 2.0))
CHAINS: dict[str, dict[str, Any]] = {
    "in space": {},
    "held": {"kind": "hold"},
    "in space, coupling 0.4 N/mm": {"coupling": 0.4},
    "in space, coupling 2 N/mm": {"coupling": 2.0},
    "held, coupling 2 N/mm": {"coupling": 2.0, "kind": "hold"},
}
HANDS = {
    "none": None,
    "0.1 kg, 2 N s/m, 0.3 N/mm": pp.HandImpedance(0.1, 2e-3, 0.3),
}  # an example
BENT = 0.05  # of the force is no sinusoid


def cell(felt: pp.Transparency, k: int) -> str:
    """dB and degrees at the k-th frequency; a star where the force is no sinusoid, "gives" where the hand gets energy."""
    loss = felt.rendered[k].imag / np.abs(felt.rendered[k])
    star = "*" if felt.distortion[k] > BENT else ""
    gives = " gives" if loss < -1e-3 else ""
    decibels, degrees = round(felt.decibels[k], 1) + 0.0, round(felt.phase[k]) + 0.0
    return f"{decibels:.1f}, {degrees:.0f}°{star}{gives}"


def transparency_lines(models: dict[str, Any], at: Any, radius: float) -> Iterator[str]:
    """A row for each chain and tissue."""
    yield f"| tissue | tool | {' | '.join(f'{f:g} Hz' for f in FREQUENCIES)} | bandwidth, Hz |"
    yield "|---|---|" + "---|" * (len(FREQUENCIES) + 1)
    for tissue, model in models.items():
        for name, options in CHAINS.items():
            felt = pp.transparency(model, at, radius, FREQUENCIES, amplitude=AMPLITUDE, depth=DEPTH, **options)
            cells = " | ".join(cell(felt, k) for k in range(len(FREQUENCIES)))
            wide = f"{felt.bandwidth:.0f}" if np.isfinite(felt.bandwidth) else f"above {FREQUENCIES[-1]:g}"
            yield f"| {tissue} | {name} | {cells} | {wide} |"


def z_width_lines(model: Any, at: Any, radius: float) -> Iterator[str]:
    """A row for each chain and hand."""
    yield "| tool | hand | greatest, N/mm | of the kidney's | 2b/T, N/mm | ends by |"
    yield "|---|---|---|---|---|---|"
    for name, options in CHAINS.items():
        for hand, moved in HANDS.items():
            found = pp.z_width(model, at, radius, hand=moved, **options)
            yield (
                f"| {name} | {hand} | {found.greatest:.3g} | {found.scale:.3g} | {found.virtual_wall:.3g} | {found.bound} |"
            )


def main() -> None:
    """Prints the tables and writes them into the documentation."""
    elastic = kidney(EDGE)
    relaxing = pp.Tissue(elastic.mesh, elastic.young, elastic.poisson, elastic.fixed, relaxation=SPECTRUM)
    models = {"elastic": pp.model(elastic, "compliance"), "relaxing": pp.model(relaxing, "compliance")}
    at = elastic.mesh.nodes[elastic.mesh.nodes[:, 1].argmin()]  # its front
    radius = 2 * elastic.edge
    own = pp.transparency(models["elastic"], at, radius, [10.0], amplitude=AMPLITUDE, depth=DEPTH).tissue[0].real
    head = (
        f"`python -m benchmarks.transparency`: a kidney of {own:.3g} N/mm under a contact of {radius:.1f} mm radius. "
        f"Rendered over the tissue's own, dB and phase; *: over {BENT:.0%} of the force is no sinusoid; gives: the hand gets "
        f"energy in each period"
    )
    lines = [head, ""]
    print(head, flush=True)
    middle = ["", "Greatest stiffness at which a device of 0.1 kg and b = 0.5 N s/m is stable:", ""]
    for row in chain(transparency_lines(models, at, radius), middle, z_width_lines(models["elastic"], at, radius)):
        print(row, flush=True)
        lines.append(row)
    (Path(__file__).parents[1] / "docs" / "figures" / "transparency.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
