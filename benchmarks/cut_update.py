"""What it costs to cut a body from the factors of the whole one: python -m benchmarks.cut_update

The kernel (cpp/cutting/): appending the three rows of a node when there are r unknowns, and a 3×3 block of the cut body's
compliance. The whole update (`CutCompliance`) next to a factorisation of the cut body, for cuts of several depths through
the sample's kidney. One thread for the kernel; medians.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

import palpate as pp
from palpate import _core
from palpate.samples import KIDNEY_LABEL, KIDNEY_POISSON, sample
from palpate.tissue.cut_compliance import CutCompliance
from palpate.tissue.models.block_gauss_seidel import ordered_by_node
from palpate.tissue.sparse_factor import Factors

UNKNOWNS = (30, 480, 1188, 1500)
BLOCKS = 256


def median(action: Callable[[], object], prepare: Callable[[], object] = lambda: None, times: int = 9) -> float:
    """Seconds."""
    taken = []
    for _ in range(times):
        prepare()
        began = time.perf_counter()
        action()
        taken.append(time.perf_counter() - began)
    return float(np.median(taken))


def kernel() -> None:
    """Rows of the first table."""
    print("| unknowns r | append three rows, ms | a 3×3 block, µs |\n|---|---|---|")
    rng = np.random.default_rng(1)
    for r in UNKNOWNS:
        M = rng.normal(size=(r + 30, r + 30)) / r
        M = M @ M.T + np.eye(r + 30)
        factor = _core.cutting.JumpFactor(r + 30)
        factor.append(np.ascontiguousarray(M[:r, :r]), 1.0, 0.0)
        taken = []
        for k in range(r, r + 30, 3):
            rows = np.ascontiguousarray(M[k : k + 3, : k + 3])
            began = time.perf_counter()
            factor.append(rows, 1.0, 0.0)
            taken.append(time.perf_counter() - began)
        z, w = rng.normal(size=(2, BLOCKS, 3, r + 30))
        block = median(lambda factor=factor, z=z, w=w: factor.blocks(z, w)) / BLOCKS
        print(f"| {r} | {1e3 * np.median(taken):.3f} | {1e6 * block:.1f} |", flush=True)


def kidney(edge: float) -> None:
    """Rows of the second table."""
    mesh = pp.tetrahedralize(pp.read_labels(sample("abdomen") / "labels.nii.gz"), KIDNEY_LABEL, edge)
    fixed = pp.resting_on(mesh, (0, 1, 0), depth=0.25 * float(np.ptp(mesh.nodes[:, 1])))
    front = mesh.nodes[mesh.nodes[:, 1].argmin()]
    print(f"\n{len(mesh.nodes)} nodes.\n")
    print("| element | depth, mm | nodes copied | unknowns r | update, s | factor, s |\n|---|---|---|---|---|---|")
    for element in ("P1", "smoothed"):
        whole = pp.Tissue(mesh, 15.0, KIDNEY_POISSON, fixed, element=element)
        model = pp.model(whole, "compliance")
        for depth in (4.0, 8.0, 12.0):
            blade = pp.incision(whole, [front - (0, 0, 10), front + (0, 0, 10)], depth, (0, 1, 0))
            opened = pp.cut(whole, blade)
            K, free = ordered_by_node(opened), np.repeat(~opened.held, 3)
            K = K.tocsr()[free][:, free]
            places = opened.mesh.nodes[~opened.held]
            update = CutCompliance(model, opened)
            mine = median(lambda model=model, opened=opened: CutCompliance(model, opened), times=3)
            anew = median(lambda K=K, places=places: Factors(K, places), times=3)
            print(
                f"| {element} | {depth:g} | {len(update.copies)} | {update.unknowns} | {mine:.2f} | {anew:.2f} |",
                flush=True,
            )


def main() -> None:
    """Prints both tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.cut_update", description=__doc__.splitlines()[0])
    parser.add_argument("--edge", type=float, default=4.0, help="of the kidney's elements, mm")
    options = parser.parse_args()
    kernel()
    kidney(options.edge)


if __name__ == "__main__":
    main()
