"""How near a calibration comes to the true geometry, from starts that are wrong by ten times as much.

    python -m benchmarks.calibration balls --first 100 --last 130
    python -m benchmarks.calibration balls --worse 3 --pixels 1 --first 130 --last 138
    python -m benchmarks.calibration shifts --first 100 --last 110

balls: random phantoms of 16 to 27 balls of 2, 3 or 4 mm, before an arc of 14 to 50 degrees above a still panel or a C-arm's
orbit of 100 to 200 degrees, 15 views each, pixels of 0.2 to 1 mm, 2,000 photons a pixel, panels tilted by up to 5 degrees.
The start has the panel tilted by 1 degree more, each end of the arc off by 2 degrees, distances by 2 %, and the phantom 3 mm
and 1 degree from its place. It is fitted as it is said to be (each view alone on an orbit, one still panel under an arc) and
as one rotation (rigid). Errors are the RMS over the views of a scan; the table has percentiles over scans. Fits
that were refused are counted, and so is the number of those that were returned with an error above five times a target.

shifts: `pp.calibrate` on random bodies, panels shifted by up to 1.5 pixels, each view for itself. What no data can tell
(`pp.calibration_gauge`: a displacement of the object) is taken out of truth and answer.

Thresholds were set on seeds below 100.
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from support.ball_phantoms import ball_case, errors
from support.shifted_scans import shifted_case

import palpate as pp

TARGETS = {"tilt": 0.1, "arc": 0.2, "source to balls": 0.2, "source to panel": 0.2}
PITCHES = (0.2, 0.3, 0.5, 0.7, 1.0)


def rms(a: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(a))))


def shifts(first: int, last: int, motions: list[str]) -> None:
    print(
        "| views | photons | scans | start, pixels | left: median | largest | seconds |\n|---|---|---|---|---|---|---|"
    )
    for motion in motions:
        for incident in (2_000, 20_000):
            left, began, took = [], [], []
            for seed in range(first, last):
                views, body, grid, true = shifted_case(seed, motion)
                seen = pp.simulate_scan(body, pp.shift_panels(views, true), incident, seed)
                start = time.perf_counter()
                found = pp.calibrate(pp.Scan(seen.counts, seen.incident, views), grid, drift=False)
                took.append(time.perf_counter() - start)
                pitch = views.panels[0].pitch[0]
                want, got = (pp.without_displacement(views, s, grid) / pitch for s in (true, found.shifts))
                began.append(rms(want))
                left.append(rms(got - want))
            cells = (f"{min(began):.2f} to {max(began):.2f}", f"{np.median(left):.3f}", f"{max(left):.3f}")
            print(
                f"| {motion} | {incident} | {last - first} | {' | '.join(cells)} | {np.median(took):.1f} |", flush=True
            )


def measured(seed: int, motion: str, pitch: float, worse: float) -> list[dict[str, Any]]:
    """The errors of both fits of a case, or why one was refused."""
    case = ball_case(seed, motion, pitch, worse)
    scan, rows = case.scan(2000, seed), []
    for rigid in (False, True):
        row = {
            "seed": seed,
            "views": motion,
            "fit": "rigid" if rigid else "as said",
            "pitch": PITCHES[seed % len(PITCHES)],
        }
        begun = time.perf_counter()
        try:
            answer = pp.calibrate_from_balls(scan, case.balls, diameter=case.diameter, rigid=rigid)
        except pp.errors.PalpateError as problem:
            rows.append(row | {"refused": str(problem)})
            continue
        row |= errors(answer.views, case.views, case.balls)
        row |= {f"start {name}": value for name, value in errors(case.start, case.views, case.balls).items()}
        row["seconds"] = time.perf_counter() - begun
        row["residual over noise"] = float(np.sqrt(np.nanmean(answer.residuals**2) / np.nanmean(answer.noise**2)))
        row["undetermined"] = len(answer.undetermined)
        rows.append(row)
    return rows


def balls(first: int, last: int, keep: Path | None, pitches: tuple[float, ...], worse: float) -> None:
    """Measures the seeds that `keep` does not hold yet."""
    rows = [json.loads(line) for line in keep.read_text().splitlines()] if keep and keep.exists() else []
    there = {(row["seed"], row["views"]) for row in rows}
    for seed in range(first, last):
        for motion in ("arc", "orbit"):
            if (seed, motion) in there:
                continue
            new = measured(seed, motion, pitches[seed % len(pitches)], worse)
            rows += new
            if keep:
                with keep.open("a") as file:
                    file.writelines(json.dumps(row) + "\n" for row in new)
    table([row for row in rows if first <= row["seed"] < last])


def table(rows: list[dict[str, Any]]) -> None:
    told, found = [r for r in rows if "refused" in r], [r for r in rows if "refused" not in r]
    print("| views | fit | pixel, mm | scans | error | start | median | 90 % | 95 % | largest | within the target |")
    print("|" + " --- |" * 11)
    for motion, fit in sorted({(r["views"], r["fit"]) for r in found}):
        for low, high in ((0.0, 0.8), (0.8, 2.0)):
            some = [r for r in found if (r["views"], r["fit"]) == (motion, fit) and low <= r["pitch"] < high]
            pitches = ", ".join(f"{p:g}" for p in sorted({r["pitch"] for r in some}))
            for name, target in TARGETS.items() if some else ():
                values, unit = np.array([r[name] for r in some]), "°" if name in ("tilt", "arc") else "%"
                cells = [f"{np.median([r[f'start {name}'] for r in some]):.2f}"]
                cells += [f"{np.quantile(values, q):.4f}" for q in (0.5, 0.9, 0.95, 1.0)]
                cells += [f"{np.mean(values <= target):.0%} of {target:g}"]
                print(f"| {motion} | {fit} | {pitches} | {len(some)} | {name}, {unit} | {' | '.join(cells)} |")
    print(f"\nRefused, and told: {len(told)} of {len(rows)}")
    for r in told[:5]:
        print(f"- seed {r['seed']}, {r['views']}, {r['fit']}: {r['refused']}")
    if not found:
        return
    wrong = [r for r in found if any(r[name] > 5 * target for name, target in TARGETS.items())]
    print(f"Returned with an error above five times its target: {len(wrong)} of {len(found)}")
    ratios = [r["residual over noise"] for r in found]
    seconds = np.median([r["seconds"] for r in found])
    print(f"Residual over noise: {min(ratios):.2f} to {max(ratios):.2f}; median time of a scan: {seconds:.1f} s")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.calibration", description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=("balls", "shifts"))
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--last", type=int, default=110)
    parser.add_argument("--keep", type=Path, help="file of what was measured; a second run goes on from it")
    parser.add_argument("--pixels", type=float, nargs="+", default=PITCHES, help="mm, by turns")
    parser.add_argument("--motions", nargs="+", default=["rotating", "arc", "orbit"], help="of shifts")
    parser.add_argument("--worse", type=float, default=1.0, help="times as wrong a start")
    chosen = parser.parse_args()
    print(f"Seeds {chosen.first} to {chosen.last - 1}:\n")
    if chosen.part == "balls":
        balls(chosen.first, chosen.last, chosen.keep, tuple(chosen.pixels), chosen.worse)
    else:
        shifts(chosen.first, chosen.last, chosen.motions)


if __name__ == "__main__":
    main()
