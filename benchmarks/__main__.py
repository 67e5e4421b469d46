"""`python -m benchmarks` measures everything and keeps the tables; `python -m benchmarks projector` prints one part."""

import argparse
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib import import_module
from itertools import chain
from pathlib import Path

from benchmarks import THREADS, installed
from palpate import _core

PARTS = (
    "roofline",
    "projector",
    "accuracy",
    "iteration",
    "convergence",
    "meshing",
    "compliance_tables",
    "multigrid",
    "deformation",
)
PACKAGES = ("palpate", "numpy", "scipy", "itk-rtk", "mbirjax", "jax", "pyPBD", "newton", "warp-lang", "mujoco")
LONG = ("clinical", "calculix", "finite_strain", "page_rendering", "soak")  # only if asked for
HERE = Path(__file__).parent


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "parts",
        nargs="*",
        help=f"some of: {', '.join(PARTS + LONG)}; none is all but {', '.join(LONG)}, kept in results/",
    )
    chosen = parser.parse_args().parts
    if unknown := set(chosen) - set(PARTS + LONG):
        parser.error(f"there is no {', '.join(sorted(unknown))}; choose from {', '.join(PARTS + LONG)}")
    began, kept = time.perf_counter(), []
    for line in chain(machine(), measured(chosen or list(PARTS))):
        print(line, flush=True)
        kept.append(line)
    print(f"{time.perf_counter() - began:.0f} s")
    if not chosen:
        file = HERE / "results" / f"{slug()}.md"
        file.parent.mkdir(exist_ok=True)
        file.write_text("\n".join(kept) + "\n")
        print(f"kept in {file.relative_to(HERE.parent)}")


def measured(parts: list[str]) -> Iterator[str]:
    """The parts, one after the other, each under its name."""
    for part in parts:
        yield f"\n## {part.capitalize()}\n"
        yield from import_module(f"benchmarks.{part}").lines()


def machine() -> Iterator[str]:
    """What the figures hang on; no names of machines or people."""
    yield f"# {processor()}, {THREADS} threads, {_core.base.instruction_set()}\n"
    there = ", ".join(f"{name} {known}" for name in PACKAGES if (known := installed(name)))
    yield f"{time.strftime('%Y-%m-%d')}, commit {commit()}, Python {sys.version.split()[0]}, {there}; "
    yield f"load of the machine before: {os.getloadavg()[0]:.1f}. Medians of runs taken in turn.\n"


def processor() -> str:
    """The CPU's name as it gives it."""
    found = re.search(r"model name\s*:\s*(.+)", Path("/proc/cpuinfo").read_text())
    return found[1].strip() if found else "unknown CPU"


def slug() -> str:
    """One file a kind of machine."""
    return re.sub(
        r"[^a-z0-9]+", "-", f"{processor()} {os.cpu_count()} cpus {_core.base.instruction_set()}".lower()
    ).strip("-")


def commit() -> str:
    """Short hash, with a + if there are changes beside it; the results themselves do not count."""

    def git(*words: str) -> str:
        return subprocess.run(["git", "-C", str(HERE), *words], capture_output=True, text=True).stdout.strip()

    changed = git("status", "--porcelain", "--", ":/", ":!results")
    return (git("rev-parse", "--short", "HEAD") or "unknown") + ("+" if changed else "")


if __name__ == "__main__":
    main()
