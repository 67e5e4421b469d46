"""A punch on an organ next to one on a half space: python -m benchmarks.indentation [-o docs/images/indentation.png].

The flat punch presses the sample's kidney, of 4 mm edges, at its front tip: how stiff that is for growing radii, over a half
space of the same tissue. Then Hertz's curve of a sphere of 8 mm on a half space of 22 kPa, with noise of 3 mN, is given to
that tip, as `palpate indent --find-onset` would, and drawn if asked.
"""

import argparse
from pathlib import Path

import numpy as np

import palpate as pp
from palpate.atomic_write import replacing
from palpate.studies.deformation.kidney import kidney
from palpate.tissue.indentation import punch_stiffness
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.tissue import KPA

EDGE, WIDEST, SPHERE, YOUNG, ONSET, NOISE = 4.0, 5.4, 8.0, 22.0, 0.3, 0.003  # mm, mm, mm, kPa, mm, N


def main(output: Path | None) -> None:
    """Prints the table and the fit, and draws it."""
    tissue = kidney(EDGE)
    tip = tissue.mesh.nodes[np.argmin(tissue.mesh.nodes[:, 1])]
    reduced = 1 - tissue.poisson[0] ** 2
    radii, stiffness, _ = punch_stiffness(ComplianceModel(tissue), tip, WIDEST)
    print(f"`python -m benchmarks.indentation`: {len(tissue.mesh.nodes)} nodes\n")
    print("| radius of the punch, mm | stiffness, N/mm | over a half space |\n|---|---|---|")
    for radius, one in zip(radii[1:], stiffness[1:], strict=True):
        print(f"| {radius:.2f} | {one:.4f} | {one * reduced / (2 * tissue.young[0] * KPA * radius):.2f} |")
    depth = np.linspace(-0.5, 4.0, 120)
    hertz = 4 / 3 * YOUNG * KPA / reduced * np.sqrt(SPHERE) * np.maximum(depth, 0) ** 1.5
    curve = pp.IndentationCurve(depth + ONSET, hertz + NOISE * np.random.default_rng(1).standard_normal(len(depth)))
    found = pp.fit_indentation(tissue, curve, tip, sphere=SPHERE, find_onset=True)
    print(f"\n{found.text}")
    if output is not None:
        figure = pp.plot_indentation(
            found, f"Hertz's curve of {YOUNG:g} kPa on a kidney's tip: E = {found.young:.3g} kPa"
        )
        with replacing(output) as temporary:
            figure.savefig(temporary, format="png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.indentation", description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, help="the picture of the fit, .png")
    main(parser.parse_args().output)
