"""The prior for smooth objects against rivals at their best: python -m benchmarks.smooth_prior [--seeds 5] [--bodies 3].

Slabs with inserts of 8 to 30 mm, that of the tomosynthesis study and random ones, by 8 views of 20,000 and 2,000 photons a
pixel. The rule that chooses the prior was settled on four other random slabs, after a look at the study's. The prior is
what the data alone choose when they are told that the object is smooth (`Prior(smooth=True)`), with the default stop. Each
rival has the strength, the cut-off and the iteration that are best by the truth, for each measure by itself, which no user
has.
"""

import argparse
from collections.abc import Iterator

import numpy as np

import palpate as pp
from palpate.scans.analytic_phantoms import Box, Ellipsoid, Phantom, slab_phantom
from palpate.studies.tomosynthesis.config import FULL, MOTIONS
from palpate.studies.tomosynthesis.image_quality import ImageQuality

DOSES = (20_000, 2_000)
TV = (2e-5, 1e-4, 4e-4, 1.6e-3, 6.4e-3)  # strengths; by default 4e-5 and 4e-4 at the two doses
LONG = {"levels": 1, "tolerance": 0.0}
TARGET = 0.98


def random_slab(seed: int) -> Phantom:
    """Up to eight ellipsoids and boxes, apart from each other, in a slab."""
    rng = np.random.default_rng([2025, seed])
    parts, placed = [(Box((0, 0, 54), (116, 108, 40)), 0.022)], []
    for _ in range(400):
        at, r = np.array([*rng.uniform(-40, 40, 2), rng.choice([40.0, 50.0, 60.0, 67.0])]), rng.uniform(4, 11)
        if len(placed) == 8 or any(np.hypot(*(at - other)[:2]) < r + far + 7 for other, far in placed):
            continue
        placed.append((at, r))
        half = np.array([r, r * rng.uniform(0.5, 1), min(r, rng.uniform(2, 5))])
        step = float(rng.choice([-1, 1]) * rng.uniform(0.006, 0.02))
        parts.append((Ellipsoid(at, half) if rng.random() < 0.5 else Box(at, 1.6 * half), step))
    return Phantom(parts)


def rivals(scan: pp.Scan, grid: pp.Grid) -> Iterator[tuple[str, np.ndarray]]:
    """Every iterate of every rival by name."""
    for strength in TV:
        options = {"method": "tv", "prior": pp.Prior(strength=strength), "iterations": 40}
        yield from (("tv", step.volume.values) for step in pp.iterates(scan, grid, **LONG, **options))
    for method, iterations in (("sirt", 40), ("sart", 5), ("ml", 40)):
        steps = pp.iterates(scan, grid, method=method, iterations=iterations, **LONG)
        yield from ((method, step.volume.values) for step in steps)
    for cutoff in (0.3, 0.6, 1.0):
        yield "fbp", pp.reconstruct(scan, grid, method="fbp", cutoff=cutoff).values
    yield "backprojection", pp.reconstruct(scan, grid, method="backprojection").values


def judged(quality: ImageQuality, values: np.ndarray) -> np.ndarray:
    """SSIM and contrast to noise."""
    return np.array([quality.similarity(values), quality.contrast(values)])


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.smooth_prior", description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5, help="scans of the study's slab, a dose")
    parser.add_argument("--bodies", type=int, default=3, help="random slabs, a scan each")
    chosen = parser.parse_args()
    cases = [("the study's slab", slab_phantom(), "circular", seed) for seed in range(chosen.seeds)]
    for k in range(chosen.bodies):
        cases.append((f"random slab {k + 1}", random_slab(k), MOTIONS[k % 3], k))
    print(f"`python -m benchmarks.smooth_prior --seeds {chosen.seeds} --bodies {chosen.bodies}`:\n")
    print(
        "| body | motion | photons | SSIM: default | smooth | best rival | contrast to noise: default | smooth | best rival |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    over: dict[int, list[np.ndarray]] = {dose: [] for dose in DOSES}
    for name, body, motion, seed in cases:
        quality, passed = ImageQuality(FULL, body), FULL.passed(motion, body)
        for dose in DOSES:
            scan = FULL.scan(passed, motion, dose, 500 + seed)
            plain, smooth = (
                judged(quality, pp.reconstruct(scan, FULL.grid, prior=prior).values)
                for prior in (pp.Prior(), pp.Prior(smooth=True))
            )
            best: dict[str, np.ndarray] = {}
            for rival, values in rivals(scan, FULL.grid):
                best[rival] = np.maximum(best.get(rival, 0), judged(quality, values))
            over[dose].append(smooth / np.max(list(best.values()), axis=0))
            cells = []
            for k, digits in ((0, 3), (1, 1)):
                winner = max(best, key=lambda one, k=k: best[one][k])
                cells += [
                    f"{plain[k]:.{digits}f}",
                    f"{smooth[k]:.{digits}f}",
                    f"{best[winner][k]:.{digits}f} ({winner})",
                ]
            print(f"| {name} | {motion} | {dose:,} | {' | '.join(cells)} |", flush=True)
    for dose, ratios in over.items():
        ssim, cnr = np.transpose(ratios)
        met = int(((ssim >= TARGET) & (cnr >= TARGET)).sum())
        print(
            f"\n{dose:,} photons, over the best rival: SSIM {ssim.mean():.3f} ({ssim.min():.3f} at least), contrast to noise "
            f"{cnr.mean():.2f} ({cnr.min():.2f} at least); both at least {TARGET:g} in {met} of {len(ratios)}."
        )


if __name__ == "__main__":
    main()
