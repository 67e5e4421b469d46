"""Functions that each write a file, spread over the workers of Dask's scheduler, which carries paths alone."""

import hashlib
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from palpate.cluster.connection import connected, workers_without
from palpate.errors import ClusterError
from palpate.version import __version__

THREAD_LIMITS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
INTERVAL = 0.1  # s between two looks at what has ended
DEATHS = 3  # of workers during one task, before it counts as failed


@dataclass(frozen=True)
class FileTask:
    """A file, and the function that writes it, whole or not at all, when it is called with the path.

    The function must be found by its name in a module, and its arguments are small: they go through the scheduler.
    """

    path: Path
    write: Callable[[Path], None]


def write_files(
    tasks: Sequence[FileTask], on: int | str, progress: Callable[[str, float], None], again: bool = False
) -> None:
    """Writes the files that are not there yet. on: as in `run_archive`. again: those that are there, too.

    Raises what a task does, once all others that have begun are done or given up; what was written stays. Raises
    `ClusterError` if the scheduler is gone or a worker does not see the folder, and `ExtraError` without dask.distributed.
    """
    missing = [task for task in tasks if again or not task.path.exists()]
    if not missing:
        return
    with connected(on) as (client, threads):
        blind = workers_without(missing[0].path.parent.resolve(), client)
        if blind:
            raise ClusterError(f"on: {', '.join(blind[:3])} cannot see {missing[0].path.parent}; share that folder")
        futures = [
            client.submit(
                written, FileTask(task.path.resolve(), task.write), threads, again, key=_key(task), retries=DEATHS
            )
            for task in missing
        ]
        began, done = time.monotonic(), 0
        progress(f"0 of {len(missing)} files", 0.0)
        while done < len(missing):
            now = sum(future.done() for future in futures)
            for future in futures:
                if future.status in ("error", "cancelled", "lost"):
                    _fail(future)
            if now == done:
                time.sleep(INTERVAL)
                continue
            done = now
            left = (time.monotonic() - began) / done * (len(missing) - done)
            progress(f"{done} of {len(missing)} files, {left:.0f} s left", done / len(missing))


def written(task: FileTask, threads: int, again: bool) -> None:
    """On a worker: writes a file, unless it has come meanwhile. again: even so."""
    from threadpoolctl import threadpool_limits

    from palpate import _core

    os.environ.update(dict.fromkeys(THREAD_LIMITS, str(threads)))  # of libraries that are still to be loaded
    _core.base.set_threads(threads)
    if again or not task.path.exists():
        with threadpool_limits(threads):
            task.write(task.path)


def _fail(future: object) -> None:
    """Raises what ended a task."""
    from distributed.client import FutureCancelledError
    from distributed.scheduler import KilledWorker

    try:
        future.result()  # type: ignore[attr-defined]
    except KilledWorker:
        raise ClusterError(
            f"on: {DEATHS} workers died at one task; give them more memory, or fewer at a time"
        ) from None
    except (FutureCancelledError, OSError):
        raise ClusterError("on: the scheduler is gone; the same command with --resume goes on") from None


def _key(task: FileTask) -> str:
    """Of a task, as the dashboard shows it."""
    mark = hashlib.sha256(f"{task.path.resolve()} {__version__}".encode()).hexdigest()[:16]
    return f"{task.path.stem}-{mark}"
