"""Runs a command in a process of its own, which ends when the process that waits for it does.

A crash or a lack of memory then ends one run, not the worker.
"""

import contextlib
import json
import os
import platform
import runpy
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from palpate import interrupts
from palpate.bounded_read import parse_json, read_text
from palpate.cluster.command_run import (
    REPORTING,
    RESUMING,
    CommandRun,
    RunRecord,
    command_line,
    is_made,
    read_record,
    run_key,
    size_of,
    write_record,
)
from palpate.errors import PalpateError

THREAD_LIMITS = ("PALPATE_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
LOCK_INTERVAL = 0.1  # s between two looks at a lock that another process holds
LAST_WRITE = 15.0  # s that a command has to write its checkpoint once its worker is gone
LONGEST_REASON = 1600  # characters


def run_command(run: CommandRun, threads: int = 1) -> RunRecord:
    """Runs it, unless an earlier run with the same key has left its output. Returns what became of it.

    A failure is a record too, not an exception. A second call for the same output waits for the first one, on any machine
    that shares the folder.
    """
    began = time.monotonic()
    try:
        with locked(run.output) as lock:
            key = run_key(run)
            before = read_record(run.output)
            if before is not None and before.key == key and is_made(before, run.output):
                return replace(before, state="kept")
            checkpoint = run.output.with_name(f"{run.output.name}.checkpoint.h5")
            resumes = run.command in RESUMING and checkpoint.exists()
            if resumes and (before is None or before.key != key):
                checkpoint.unlink()  # of another run
                resumes = False
            write_record(run.output, RunRecord(key, "begun", worker=platform.node()))
            record = replace(run_in_process(run, threads, resumes, lock), key=key, seconds=time.monotonic() - began)
            write_record(run.output, record)
            return record
    except (PalpateError, OSError) as problem:
        return RunRecord("", "failed", str(problem), time.monotonic() - began, platform.node())


def run_in_process(run: CommandRun, threads: int, resume: bool, lock: int | None) -> RunRecord:
    """Runs it in a process that has so many threads and holds the lock."""
    report = run.output.with_name(f".{run.output.name}.report.json")
    options = (*run.options, *["--resume"] * resume)
    if run.command in REPORTING:
        options += ("--report", str(report))
    words = command_line(replace(run, options=options))
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            [sys.executable, "-m", "palpate.cluster.command_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=said,
            env={**os.environ, **dict.fromkeys(THREAD_LIMITS, str(threads)), "COLUMNS": "200"},
            start_new_session=True,  # Ctrl-C is for the client, which ends the workers
            pass_fds=() if lock is None else (lock,),
        )
        assert process.stdin
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(json.dumps(words).encode() + b"\n")
            process.stdin.flush()  # it stays open: its end is the end of this process
        try:
            process.wait()
        finally:  # Ctrl-C may have ended the wait: the lock is held until the command has ended too
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
            code = process.wait()
        said.seek(max(0, said.tell() - (1 << 20)))
        lines = said.read().decode(errors="replace").splitlines()
    figures = {}
    with contextlib.suppress(OSError, ValueError):
        figures = parse_json(read_text(report))
    report.unlink(missing_ok=True)
    notes = tuple(line for line in lines if line.startswith(("note: ", "warning: ")))
    state, reason = ("done", "") if code == 0 else ("failed", why(code, lines))
    size = size_of(run.output) if code == 0 else None
    return RunRecord("", state, reason, worker=platform.node(), notes=notes, report=figures, size=size)


def why(code: int, lines: list[str]) -> str:
    """The reason of a failure, by the exit code and what the command said."""
    said = [line for line in lines if line.startswith("palpate: ")] or [line for line in lines if line.strip()]
    last = said[-1].removeprefix("palpate: ")[:LONGEST_REASON] if said else ""
    if code >= 0:
        return last or f"the command ended with {code}"
    hint = "; the system ends processes so when memory is short" if code == -9 else ""
    return f"the command was ended by signal {-code}{hint}{'; it last said: ' if last else ''}{last}"


@contextlib.contextmanager
def locked(output: Path) -> Iterator[int | None]:
    """Holds the lock of an output, an empty file beside it, once no other process does. Gives its descriptor.

    Whoever gets that descriptor holds the lock too. None on Windows, where nothing is locked.
    """
    if sys.platform == "win32":
        yield None
        return
    import fcntl

    path = output.with_name(f".{output.name}.lock")
    while True:
        lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if path.exists() and os.path.samestat(os.fstat(lock), path.stat()):  # nobody has removed it meanwhile
                break
        except (BlockingIOError, FileNotFoundError):
            time.sleep(LOCK_INTERVAL)
        os.close(lock)
    try:
        yield lock
    finally:
        path.unlink(missing_ok=True)
        os.close(lock)


def main() -> None:
    """The process: its command line is the first line of its input. The input's end stops it like Ctrl-C."""
    line = b""
    while not line.endswith(b"\n"):  # not by sys.stdin: Python cannot end while a thread waits in its buffer
        line += os.read(0, 1) or b"\n"
    words = json.loads(line)

    def watch() -> None:
        while os.read(0, 1024):
            pass
        print("palpate: the worker that started this is gone", file=sys.stderr, flush=True)
        interrupts.interrupt_main()
        time.sleep(LAST_WRITE)
        os._exit(interrupts.STOPPED)

    threading.Thread(target=watch, daemon=True).start()
    sys.argv = ["palpate", *words]
    runpy.run_module("palpate", run_name="__main__")


if __name__ == "__main__":
    main()
