"""Files that lie about themselves: each must be refused in one line, soon, and within little memory.

    python tests/fuzz/hostile_files.py 13 --seed 1

makes so many files of each format and class and gives each to the command that reads it, in a process of its own. A file is
well refused if the command ends with 2, says one line that names the file, and takes less than ten seconds of the processor
and 1 GB. One that waits is stopped after half a minute.
The classes: streams that swell beyond what is declared, or end before it; pipes, folders and devices; declared lengths of
2^40; sizes that are negative or wrap; headers that are deep or huge; contents that cannot be, such as the same tet twice.
A case is made again from its name and the seed.
"""

import argparse
import os
import resource
import shutil
import signal
import stat
import sys
import tempfile
import time
import traceback
import zlib
from collections import Counter
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

SECONDS = 10  # of the processor
WAIT = 30  # seconds of the clock, for what waits for ever
MEMORY = 1024**3  # bytes, what a refusal may take at its most
ABOVE = (
    3 * 1024**3
)  # bytes of address space beyond the start: the machine is safe, and what takes too much is still seen
LONGEST = 2000  # characters of the one line


def corpus():
    """All cases: (format, class) to the function that makes a file."""
    from fuzz.hostile import meshes, raw_volumes, stl_and_ply, surfaces, tables, texts, tiff_and_dicom, ways  # noqa: F401

    return ways


def prepare(folder):
    """Valid files that cases start from, and all that a command imports, once."""
    import h5py  # noqa: F401
    import meshio  # noqa: F401
    import scipy.io  # noqa: F401
    import skimage.filters  # noqa: F401

    from fuzz.hostile import tables

    (folder / "valid").mkdir(parents=True)
    tables.valid(folder / "valid")


def ask(words, folder):
    """What became of `palpate` with these words, in a process of its own: exit code, said, seconds, memory."""
    start = time.monotonic()
    child = os.fork()
    if child == 0:
        try:
            code = _command(words, folder)
        except BaseException:  # nothing may return into the caller's frames
            code = 70
        os._exit(code)
    while True:
        done, status, used = os.wait4(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() - start > WAIT:
            os.kill(child, signal.SIGKILL)
            _, status, used = os.wait4(child, 0)
            break
        time.sleep(0.002)
    said = (folder / ".said").read_text(errors="replace")
    return os.waitstatus_to_exitcode(status), said, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024


def _command(words, folder):
    os.chdir(folder)
    said = os.open(folder / ".said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(said, 2)
    sys.stderr = os.fdopen(2, "w", buffering=1, closefd=False)
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_AS, (now + ABOVE, now + ABOVE))
    from palpate.commands import main

    sys.argv = ["palpate", *words]
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


def verdict(name, code, said, seconds, memory):
    """ "refused", or what is wrong."""
    lines = [line for line in said.splitlines() if line.strip() and not line.startswith("  ")]  # those are of progress
    last = lines[-1][:300] if lines else ""
    if seconds > SECONDS or code in (-signal.SIGKILL, -signal.SIGXCPU):
        return "too long"
    if memory > MEMORY:
        return f"{memory / 1024**2:.0f} MB (exit {code}: {last})"
    if code != 2:
        return f"exit {code}: {last}"
    if len(lines) != 1:
        return f"{len(lines)} lines: {' | '.join(line[:200] for line in lines[:3])}"
    if len(lines[0]) > LONGEST:
        return f"a line of {len(lines[0])} characters: {last}"
    if not lines[0].startswith("palpate: ") or name not in lines[0]:
        return f"names no file: {last}"
    return "refused"


def run(each, seed, only="", keep=None):
    """How many of each format and class were well refused; the failures: case and what was wrong.

    each: files a format and class. only: part of the names of those that are made. keep: a folder for what failed.
    """
    ways = corpus()
    told, failures = Counter(), []
    with tempfile.TemporaryDirectory() as temporary:
        prepare(Path(temporary))
        folder = Path(temporary) / "case"

        def tell(form, kind, case, name, outcome):
            told[form, kind, outcome == "refused"] += 1
            if outcome != "refused":
                failures.append((case, outcome))
                if keep:
                    _keep(folder, Path(keep) / case.replace(" ", "-"))
            shutil.rmtree(folder)

        for form, kind, n in ((form, kind, n) for form, kind in sorted(ways.CASES) for n in range(each)):
            case = f"{form} {kind} {n}"
            if only in case:
                folder.mkdir()
                name = ways.CASES[form, kind](folder, np.random.default_rng([seed, zlib.crc32(case.encode())]))
                asked = ask(ways.COMMANDS[form].replace("NAME", name).split(), folder)
                tell(form, kind, case, name, verdict(name, *asked))
        for form, make in sorted(ways.VALID.items()):  # what refuses everything would pass otherwise
            if only.split(" ")[0] in form:
                folder.mkdir()
                name = make(folder)
                code, said, *_ = ask(ways.COMMANDS[form].replace("NAME", name).split(), folder)
                if code != 0:
                    tell(form, "whole", f"{form} whole", name, f"a whole file, exit {code}: {said}")
                else:
                    shutil.rmtree(folder)
    return told, failures


def _keep(folder, target):
    target.mkdir(parents=True)
    for path in folder.iterdir():
        if stat.S_ISREG(path.lstat().st_mode) and path.stat().st_size < 2**26:
            shutil.copy(path, target)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("each", type=int, nargs="?", default=13, help="files of each format and class")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help='part of the names of cases, such as "nrrd" or "tissue content 3"')
    parser.add_argument("--keep", help="folder for the files that failed")
    given = parser.parse_args()
    told, failures = run(given.each, given.seed, given.only, given.keep)
    for form, kind in sorted({key[:2] for key in told}):
        good, bad = told[form, kind, True], told[form, kind, False]
        print(f"{good:5d} refused {bad:4d} not   {form}, {kind}")
    for case, outcome in failures:
        print(f"{case}: {outcome}")
    print(f"{sum(told.values())} files, seed {given.seed}: {len(failures)} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
