"""Puts faults into a copy of the last commit, one at a time, and runs the tests of its folder, then those that name it.

    cd tests && python -m mutants --seed 1 -n 100
    cd tests && python -m mutants --seed 1 -n 50 --first 50   # the second half of them

Places are drawn by the seed, each line of code as likely as another, half of them in cpp/ and half in src/. Of a C++
fault the object is compiled again; if that fails, the next fault is drawn. What was done is kept in build/mutants/, so that
a run that was stopped goes on. Prints the faults that lived, and their share.
"""

import argparse
import io
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tarfile
import time
from functools import cache
from pathlib import Path

from mutants import cpp_mutants, python_mutants
from mutants.mutant import Mutant

ROOT = Path(__file__).resolve().parents[2]
HOME = ROOT / "build" / "mutants"
TREE, CORE, KERNELS = HOME / "tree", HOME / "core", HOME / "kernels"
LONGEST = 1200  # s, of the tests of one fault; a fault that takes longer is noticed
NOT_IN_THE_CORE = "cpp/wasm"  # the engine of the exported page is committed as it was compiled
ELASTIC, IMAGES = ["tests/tissue"], ["tests/reconstruction"]
TESTS = {  # of a folder of cpp/ or a package of src/palpate; other packages have a folder of their own name
    "base": IMAGES + ELASTIC,
    "volume": IMAGES + ["tests/volumes"],
    "phantom": ["tests/scans"],
    **dict.fromkeys(("projection", "statistics", "icd", "subspace"), IMAGES),
    **dict.fromkeys(
        ("linalg", "relaxation", "multigrid", "compliance", "hyperelastic", "multirate", "elements"), ELASTIC
    ),
    "cutting": ["tests/meshes/test_cutting.py", "tests/simulation/test_session_cuts.py", *ELASTIC],
    "scatter": ["tests/scans", "tests/reconstruction"],
    "standalone": ["tests/page/test_exported_page.py"],
    **{folder: ["tests/simulation", "tests/haptics", "tests/tissue"] for folder in ("realtime", "net", "bindings")},
    "server": ["tests/server", "tests/page"],
    **{package: ["tests/studies", "tests/commands"] for package in ("report", "studies", "demos", "samples")},
    "palpate": [
        "tests/commands",
        "tests/test_plugins.py",
        "tests/test_arrays.py",
        "tests/test_dlpack.py",
        "tests/volumes",
    ],
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m mutants", description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-n", type=int, default=100, help="how many faults")
    parser.add_argument(
        "--first", type=int, default=0, help="the number of the first: each is drawn by seed and number"
    )
    options = parser.parse_args()
    for name in said(["git", "ls-files", "cpp", "src/palpate/*.py", f":!{NOT_IN_THE_CORE}"], ROOT).split():
        if absent := [tests for tests in tests_of(name) if not (ROOT / tests).exists()]:
            parser.error(f"{name}: its tests are said to be in {absent[0]}, which is not there")
    commit = said(["git", "rev-parse", "--short", "HEAD"], ROOT).strip()
    kept = HOME / f"{commit}-seed-{options.seed}-from-{options.first}.jsonl"
    prepare(commit)
    done = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    for number in range(len(done), options.n):
        done.append(judge(options.seed, options.first + number))
        with kept.open("a") as file:
            print(json.dumps(done[-1]), file=file)
        print(f"{number + 1} of {options.n}: {described(done[-1])}", flush=True)
    lived = [one for one in done if one["verdict"] == "lived"]
    print("\n".join(["", "Lived:", *map(described, lived)]))
    print(f"{len(lived)} of {len(done)} faults lived ({len(lived) / max(len(done), 1):.0%}); {kept}")


def described(one: dict[str, str]) -> str:
    """One line about a fault."""
    where, change = f"{one['file']}:{one['line']}", f"{one['before']} -> {one['after']}"
    return f"{one['verdict']}: {where} {one['operator']}: {change} ({one['s']} s)"


def prepare(commit: str) -> None:
    """A copy of the commit with its core built, kept from run to run."""
    mark = HOME / "commit"
    archive = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=True).stdout
    if mark.exists() and mark.read_text() == commit:
        return mend(archive)
    mark.unlink(missing_ok=True)
    shutil.rmtree(TREE, ignore_errors=True)
    TREE.mkdir(parents=True)
    subprocess.run(["tar", "-x"], cwd=TREE, input=archive, check=True)
    print("building the core", flush=True)
    python = f"-DPython_EXECUTABLE={sys.executable}"
    said(["cmake", "-S", str(TREE), "-B", str(CORE), python])
    said(["cmake", "-S", str(TREE), "-B", str(KERNELS), "-DPALPATE_CPP_TESTS=ON"])
    said(["cmake", "--build", str(CORE), "--parallel", str(os.cpu_count())])
    package = TREE / "src" / "palpate"
    shutil.copytree(CORE / "static", package / "server" / "static")
    shutil.copytree(CORE / "palpate" / "_core", package / "_core")
    install()
    mark.write_text(commit)


def mend(archive: bytes) -> None:
    """Takes the fault out of the copy that a run which was killed has left there."""
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        for member in files:
            path, content = TREE / member.name, files.extractfile(member) if member.isfile() else None
            if content and path.suffix in (".cpp", ".h", ".py") and path.read_bytes() != (right := content.read()):
                print(f"taken out: the fault in {member.name} that a killed run has left", flush=True)
                path.write_bytes(right)
                compiles(member.name)


def judge(seed: int, number: int) -> dict[str, str]:
    """Draws the fault of a number and says what became of it."""
    side = ("cpp", "src")[number % 2]
    for attempt in range(10_000):
        rng = random.Random(f"{seed} {number} {attempt}")
        name, line = rng.choice(places(side))
        source = (TREE / name).read_text()
        possible = [fault for fault in faults(name) if fault.line == line]
        if not possible:
            continue
        fault, began = rng.choice(possible), time.monotonic()
        noticed = verdict(name, source, fault.applied(source))
        if noticed is None:
            continue
        before = source.splitlines()[line - 1].strip()
        after = fault.applied(source).splitlines()[line - 1].strip()
        spent = str(round(time.monotonic() - began))
        told = {"verdict": noticed, "file": name, "line": str(line), "operator": fault.operator, "s": spent}
        return {**told, "before": before, "after": after}
    raise SystemExit("no fault can be drawn")


def verdict(name: str, source: str, faulty: str) -> str | None:
    """Whether the tests notice what stands in a file; None if it does not compile.

    A test that fails is run once more without the fault, and left out if it fails then too: a machine that is busy is
    no fault.
    """
    left_out: list[str] = []
    while True:
        try:
            (TREE / name).write_text(faulty)
            if not compiles(name):
                return None
            if not kernels_pass(name):
                return "noticed"
            failed = failing_tests(name, left_out)
        finally:
            (TREE / name).write_text(source)
            if name.startswith("cpp/"):
                compiles(name)
        if not failed:
            return "lived"
        if not failing([*failed, "-n", "0"]):
            return "noticed"
        left_out += failed
        print(f"left out, since it fails without a fault: {' '.join(failed)}", flush=True)


def compiles(name: str) -> bool:
    """Whether the core can be made of what stands in a file, which is put into the copy's package, and its C++ tests."""
    if not name.startswith("cpp/"):
        return True
    if not built(CORE, "_core"):
        return False
    install()
    return not has_kernel_tests(name) or built(KERNELS, kernel_tests(name))


def kernels_pass(name: str) -> bool:
    """Whether the C++ tests of a file's folder pass, if there are any."""
    return not has_kernel_tests(name) or ended_well([str(KERNELS / kernel_tests(name))])


def has_kernel_tests(name: str) -> bool:
    return name.startswith("cpp/") and (TREE / "tests" / name).parent.is_dir()


def kernel_tests(name: str) -> str:
    """The program of a folder's C++ tests."""
    return f"test_{Path(name).parent.name}"


def failing_tests(name: str, left_out: list[str]) -> list[str]:
    """The tests of a file's folders that fail, at most the first few; if none does, those elsewhere that name the file.

    In the folders, too, those that name it go first.
    """
    words = {Path(name).stem, *re.findall(r"^(?:def|class) ([A-Za-z]\w+)", (TREE / name).read_text(), re.M)}
    holds = {path: set(re.findall(r"\w+", path.read_text())) for path in sorted((TREE / "tests").rglob("test_*.py"))}
    own = [path for where in tests_of(name) for path in sorted((TREE / where).rglob("test_*.py")) or [TREE / where]]
    own.sort(key=lambda path: not words & holds[path])
    apart = [path for path in holds if path not in own and distinct(words) & holds[path]]
    deselected = [word for test in left_out for word in ("--deselect", test)]
    for files in (own, apart):
        if files and (failed := failing([*(str(path.relative_to(TREE)) for path in files), *deselected])):
            return failed
    return []


def distinct(words: set[str]) -> set[str]:
    """Those of more than one word: `mesh` stands in most tests, `mesh_within` in those that are about it."""
    return {word for word in words if re.search(r"[a-z]_?[A-Z_]", word)}


def failing(tests: list[str]) -> list[str]:
    """Of tests those that fail, at most the first few; the files if nothing more is known."""
    run = ended([sys.executable, "-m", "pytest", "-x", "-q", "-rfE", *tests])
    if run is None or run.returncode == 0:
        return [] if run else [test for test in tests if "::" not in test][:1]
    return re.findall(r"^(?:FAILED|ERROR) (tests/.+?)(?: - .*)?$", run.stdout, re.M) or tests


@cache
def places(side: str) -> list[tuple[str, int]]:
    """(file, line) of every line of code."""
    kinds = (".cpp", ".h") if side == "cpp" else (".py",)
    found = []
    for path in sorted((TREE / side).rglob("*")):
        if path.suffix in kinds and NOT_IN_THE_CORE not in str(path):
            lines = cpp_mutants.code_lines if side == "cpp" else python_mutants.code_lines
            found += [(str(path.relative_to(TREE)), line) for line in sorted(lines(path.read_text()))]
    return found


@cache
def faults(name: str) -> list[Mutant]:
    """All that can be put into a file."""
    source = (TREE / name).read_text()
    return cpp_mutants.mutants(source) if name.startswith("cpp/") else python_mutants.mutants(source)


def tests_of(name: str) -> tuple[str, ...]:
    """Folders or files of tests that ought to notice a fault in a file."""
    parts = Path(name).parts
    package = parts[1] if parts[0] == "cpp" else parts[2] if len(parts) > 3 else "palpate"
    if package == "bindings" and Path(name).stem in TESTS:  # of a folder of kernels
        package = Path(name).stem
    of_all = ["tests/test_core_calls.py"] if parts[0] == "cpp" else []
    return (*TESTS.get(package, [f"tests/{package}"]), *of_all)


def install() -> None:
    """Puts the built core into the copy's package."""
    for module in (CORE / "palpate").glob("_core*.so"):
        shutil.copy(module, TREE / "src" / "palpate")


def built(where: Path, target: str) -> bool:
    """Whether a target compiles."""
    return ended_well(["cmake", "--build", str(where), "--target", target, "--parallel", str(os.cpu_count())])


def ended_well(command: list[str]) -> bool:
    """Whether a command ends with 0 in time."""
    run = ended(command)
    return run is not None and run.returncode == 0


def ended(command: list[str]) -> "subprocess.CompletedProcess[str] | None":
    """A command that has ended; None if it takes too long."""
    environment = {**os.environ, "PYTHONPATH": f"{TREE / 'src'}", "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= {"OPENBLAS_NUM_THREADS": "1", "PALPATE_THREADS": "1"}  # as in the gate
    try:
        return subprocess.run(command, cwd=TREE, env=environment, capture_output=True, text=True, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return None


def said(command: list[str], where: Path = ROOT) -> str:
    """What a command prints; ends the run with what it complained of if it fails."""
    run = subprocess.run(command, cwd=where, capture_output=True, text=True)
    if run.returncode:
        raise SystemExit(f"{' '.join(command)}:\n{run.stdout[-2000:]}{run.stderr[-2000:]}")
    return run.stdout


if __name__ == "__main__":
    main()
