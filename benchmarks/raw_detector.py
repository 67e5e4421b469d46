"""How near `scan correct` comes to the scan that a perfect panel would have made of the same photons.

    python -m benchmarks.raw_detector --first 200 --last 210

Each seed plants a panel: gain within ±20 %, dark, heel effect of ±10 %, lag of 3 %, 1 % of dead pixels, five dead lines, and
a dose within ±10 % for each view, read by a dosimeter. Dark and flat are 20 frames each. Lag is given, or estimated from
frames of after-glow. The error is that of the line integrals against those of a perfect panel, over pixels not masked:

- without noise anywhere, where only the correction can err;
- with noise of photons and read-out in views, dark and flat. Both scans then hold the same photons of the views, so that
  their own noise cancels, while that of dark, flat and read-out counts as error.

It is told in units of the line integral (0.005 is 0.5 % of the intensity) and relative to the RMS of the line integrals.

Rows, columns and rings are judged with noise, by what is left of the line integrals after those of the phantom: the mean over
all views and a row, a column or a ring (one pixel wide, about the panel's middle), over its standard deviation by the noise
of photons in views and flat. Variance / mean is that of the corrected counts (without the background of the read-out) about
the mean that `incident` and the phantom give; 1 for Poisson counts, plus what the flat's noise adds, at most 1/20 here. Of n
independent such numbers the largest exceeds the limit told (Bonferroni) with probability 1 %.
Thresholds of the correction were set on seeds below 200.
"""

import argparse
import warnings

import numpy as np
from scipy import stats
from support.raw_detector import RawCase, raw_case

import palpate as pp

LARGE = 0.01  # chance that the largest of all lines exceeds its limit


def afterglow(case: RawCase, frames: int, rng: np.random.Generator | None) -> np.ndarray:
    """Frames after the beam was on for long."""
    beam = case.incident[0] / case.dose[0]
    lit = np.broadcast_to(beam, (12, *beam.shape))
    lit = lit if rng is None else rng.poisson(lit)
    return case.detector.read(np.concatenate([lit, np.zeros((frames, *beam.shape))]), rng)[12:]


def corrected(case: RawCase, noise: bool, lag: pp.Lag | float) -> pp.Correction:
    gain = None if noise else float(np.median(case.detector.gain))  # noise tells the gain where there is some
    return pp.correct_scan(case.raw, case.views, case.dark, case.flat, gain=gain, lag=lag, dose=case.dose)


def only_dark_and_mean(case: RawCase) -> np.ndarray:
    """Line integrals of the raw frames without any of the pixels' own properties: what has to be mended."""
    level = np.median(case.flat) - np.median(case.dark)
    return -np.log(np.maximum(case.raw - np.median(case.dark), 1) / level)


def rms(a: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(a, dtype=np.float64))))


def line_statistics(case: RawCase, p: np.ndarray, mask: np.ndarray) -> dict[str, tuple[float, float]]:
    """Of rows, columns and rings: largest |mean over its standard deviation|, and its limit."""
    truth = -np.log(case.expected / case.incident)
    good = mask.all(axis=0)
    views, n = len(p), len(case.flat)
    # log of a Poisson number has the mean log(m) - 1/(2m) and the variance 1/m, to the next order
    left = (p - truth - 0.5 / case.expected).mean(axis=0)
    variance = (1 / case.expected).mean(axis=0) / views + 1 / (n * case.incident[0] / case.dose[0])
    rows, columns = np.indices(good.shape)
    middle = (np.array(good.shape) - 1) / 2
    rings = np.hypot(rows - middle[0], columns - middle[1]).astype(int)
    found = {}
    for name, groups in (("rows", rows), ("columns", columns), ("rings", rings)):
        weight = np.bincount(groups[good])
        used = weight >= 20
        total = np.bincount(groups[good], left[good])[used]
        spread = np.sqrt(np.bincount(groups[good], variance[good])[used])
        found[name] = float(np.abs(total / spread).max()), float(stats.norm.isf(LARGE / 2 / used.sum()))
    return found


def judged(case: RawCase, done: pp.Correction, noise: bool) -> dict[str, float]:
    """The measures of one corrected scan."""
    p, clean, mask = pp.line_integrals(done.scan), pp.line_integrals(case.clean), done.scan.mask
    alive, bad = ~np.broadcast_to(case.detector.dead, p.shape), ~mask.all(axis=0)
    error = rms((p - clean)[mask])
    found = {
        "RMS": error,
        "relative": error / rms(clean[mask]),
        "as read": rms((only_dark_and_mean(case) - clean)[alive]),
        "missed": np.count_nonzero(case.detector.dead & ~bad),
        "false": np.count_nonzero(bad & ~case.detector.dead),
    }
    if noise:
        mean = done.scan.incident * case.expected / case.incident
        variance = np.mean(((done.scan.counts - done.scan.background - mean) ** 2)[mask])
        found["variance / mean"] = variance / np.mean((mean + done.scan.background)[mask])
        lines = line_statistics(case, p.astype(float), mask)
        raw = line_statistics(case, only_dark_and_mean(case), alive)
        for name, (largest, limit) in lines.items():
            found |= {name: largest, f"{name} limit": limit, f"{name} as read": raw[name][0]}
    return found


def row(noise: bool, lag: str, all_found: list[dict[str, float]]) -> str:
    """A line of the table: the worst of all seeds."""

    def worst(name: str) -> float:
        return max(found[name] for found in all_found)

    cells = [
        "yes" if noise else "no",
        lag,
        f"{worst('RMS'):.5f}",
        f"{worst('relative'):.3%}",
        f"{worst('as read'):.3f}",
    ]
    cells.append(f"{sum(f['missed'] for f in all_found)} / {sum(f['false'] for f in all_found)}")
    if noise:
        shares = [found["variance / mean"] for found in all_found]
        cells.append(f"{min(shares):.3f} to {max(shares):.3f}")
        for name in ("rows", "columns", "rings"):
            cells.append(f"{worst(name):.2f} of {worst(f'{name} limit'):.2f} ({worst(f'{name} as read'):.0f})")
    return f"| {' | '.join(cells + ['' for _ in range(10 - len(cells))])} |"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.raw_detector", description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=200)
    parser.add_argument("--last", type=int, default=210)
    parser.add_argument("--shape", type=int, nargs=2, default=(300, 360), help="rows and columns of the panel")
    parser.add_argument("--plot", help="picture of the first seed, before and after")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    shape = tuple(chosen.shape)
    found: dict[tuple[bool, str], list[dict[str, float]]] = {}
    for seed in range(chosen.first, chosen.last):
        for noise in (False, True):
            case = raw_case(seed, shape, pitch=240 / shape[1], noise=noise)
            rng = np.random.default_rng([seed, 2]) if noise else None
            glow = pp.lag_from_afterglow(afterglow(case, 3, rng), case.flat.mean(axis=0), case.dark.mean(axis=0))
            for name, lag in (("given", 0.03), ("measured", glow)):
                done = corrected(case, noise, lag)
                found.setdefault((noise, name), []).append(judged(case, done, noise))
        if seed == chosen.first and chosen.plot:
            pp.plot_correction(case.raw, done).savefig(chosen.plot, dpi=80)
    columns = ("noise", "lag", "RMS", "relative", "RMS as read", "bad pixels missed / false", "variance / mean")
    columns += tuple(f"{name}: largest of limit (as read)" for name in ("rows", "columns", "rings"))
    print(f"Seeds {chosen.first} to {chosen.last - 1}, {shape[0]} x {shape[1]} pixels, the worst of all:\n")
    print(f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")
    for (noise, name), values in sorted(found.items()):
        print(row(noise, name, values))


if __name__ == "__main__":
    main()
