"""How many mistakes in a scan's geometry are named, and how many right scans raise an alarm.

    python -m benchmarks.wrong_geometry --first 100 --last 200

Each seed draws a geometry and an object, and makes each of thirty mistakes: fifteen kinds in two sizes. A mistake is named
if the first or the second finding is its cause, or the effect of one that is a gauge. A note counts, so the notes on right
scans are counted too. Every seed's right scan is checked with plain noise, with scatter and with gains that drift. Thresholds
were set on seeds 0-99.
"""

import argparse
import time
import warnings
from collections import Counter
from collections.abc import Iterator

import numpy as np
from support.wrong_scans import KINDS, PLANAR, Setting, disturbed, mistaken, setting

import palpate as pp
from palpate.errors import PalpateError

RIGHT = ("noise", "scatter", "gain drift")


def named(found: Setting, kind: str, size: int, rng: np.random.Generator) -> tuple[bool, list[str]]:
    """Whether a mistake is named, and what was said; a refusal names it if it says what to check."""
    try:
        case = mistaken(found, kind, size, rng)
        said = pp.check_scan(case.scan, case.grid)
    except PalpateError as refusal:
        return "check" in str(refusal), [f"refused: {refusal}"]
    return any(finding.cause in KINDS[kind] for finding in said[:2]), [str(finding) for finding in said]


def said_of(found: Setting, how: str, rng: np.random.Generator) -> tuple[list[str], list[str]]:
    """(alarms, notes) on a right scan: none is deserved."""
    case = disturbed(found, how, rng)
    said = pp.check_scan(case.scan, case.grid)
    return [str(finding) for finding in said if finding.alarm], [str(finding) for finding in said if not finding.alarm]


def real() -> Iterator[tuple[str, list[pp.Finding]]]:
    """What is said of the samples, which are measured or simulated by others."""
    for name in ("breast", "head"):
        scan = pp.import_scan(name)
        yield name, pp.check_scan(scan)
        grid = pp.covering_grid(scan.views, 51.2 if name == "breast" else 220)
        yield f"{name} in a grid", pp.check_scan(scan, grid)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.wrong_geometry", description=__doc__)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--last", type=int, default=200)
    parser.add_argument("--verbose", action="store_true", help="print every mistake that was not named")
    chosen = parser.parse_args()
    warnings.simplefilter("ignore")
    hits, tried, wrong, right, seconds = Counter(), Counter(), 0, 0, []
    gauges, noted = Counter(), 0
    for seed in range(chosen.first, chosen.last):
        found, rng = setting(seed), np.random.default_rng(seed)
        for kind in KINDS:
            for size in (0, 1):
                ok, said = named(found, kind, size, rng)
                hits[kind, size] += ok
                tried[kind, size] += 1
                gauges[kind, size] += not ok and found.motion in PLANAR
                if chosen.verbose and not ok:
                    print(
                        f"{seed} {found.motion} {found.thing} {kind} {size}: {[words[:120] for words in said[:3]]}",
                        flush=True,
                    )
        for how in RIGHT:
            began = time.perf_counter()
            said, notes = said_of(found, how, rng)
            seconds.append(time.perf_counter() - began)
            right, wrong, noted = right + 1, wrong + bool(said), noted + bool(notes)
            if said or notes:
                print(f"{seed} {found.motion} {found.thing} right, {how}: {said}, notes {notes}", flush=True)
    for name, findings in real():
        right, wrong = right + 1, wrong + any(finding.alarm for finding in findings)
        noted += any(not finding.alarm for finding in findings)
        if findings:
            print(f"{name}: {[str(finding) for finding in findings]}")
    print("| mistake | smaller | larger |\n| --- | --- | --- |")
    for kind in KINDS:
        print(f"| {kind} | {hits[kind, 0] / tried[kind, 0]:.0%} | {hits[kind, 1] / tried[kind, 1]:.0%} |")
    mean = 30 * hits.total() / tried.total()
    print(f"\nnamed: {hits.total()} of {tried.total()}, {mean:.1f} of 30 in the mean; false alarms: {wrong} of {right}")
    print(f"notes on right scans: {noted} of {right}")
    print(f"not named, sources in a plane parallel to the panel: {gauges.total()}")
    print(f"a right scan takes {np.median(seconds):.2f} s in the median, {np.max(seconds):.2f} s at most")


if __name__ == "__main__":
    main()
