"""Connects to the scheduler that spreads the runs: one started here, one that runs already, or Slurm."""

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.bounded_read import existing_file
from palpate.errors import ClusterError, DataError, ExtraError

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 30  # s to reach a scheduler
PROTOCOLS = ("tcp://", "tls://", "ws://", "wss://", "ucx://")


def check_on(on: int | str) -> int | str:
    """`on` as a number where it is one. Raises `ClusterError` where it is nothing that `connected` knows."""
    words = str(on)
    if words.isdigit() and int(words) > 0:
        return int(words)
    if words.startswith(PROTOCOLS):
        return words
    if words.endswith(".json"):
        existing_file(words)
        return words
    name, _, count = words.partition(":")
    if name == "slurm" and count.isdigit() and int(count) > 0:
        if shutil.which("sbatch") is None:
            raise ClusterError(f"on: {words}: there is no sbatch here; start it where Slurm takes jobs")
        return words
    raise DataError(
        f"on: {words!r}; expected a number of workers here, the address of a scheduler (tcp://host:8786), its file "
        f"(scheduler.json), or slurm:N for N jobs"
    )


@contextlib.contextmanager
def connected(on: int | str) -> "Iterator[tuple[Client, int]]":
    """A client of Dask's scheduler during the block, and how many threads each run may have.

    on: as in `run_archive`. What was started here is ended with the block. Raises `ClusterError` where nobody answers, and
    `ExtraError` where a package is missing.
    """
    on = check_on(on)
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise ExtraError(
            "on: it needs dask.distributed, which is not installed: pip install 'palpate[cluster]'"
        ) from None
    with contextlib.ExitStack() as stack:
        threads = int(os.environ.get("PALPATE_THREADS", "1"))
        if isinstance(on, int):
            threads = int(os.environ.get("PALPATE_THREADS", max(1, (os.cpu_count() or 1) // on)))
            import dask

            # Its statistical profiler and its ticks take the time of the runs, which are other processes.
            quiet = {"distributed.worker.profile.enabled": False, "distributed.admin.tick.interval": "500ms"}
            stack.enter_context(dask.config.set(quiet))
            cluster = LocalCluster(
                n_workers=on,
                threads_per_worker=1,  # a run at a time; the run has the threads
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                memory_limit=0,  # the work is done by processes that a worker starts
                silence_logs=50,
            )
            stack.enter_context(cluster)
            client = stack.enter_context(Client(cluster))
            stack.callback(_until_all_work, client, on)
        elif on.startswith("slurm"):
            try:
                from dask_jobqueue import SLURMCluster
            except ImportError:
                raise ExtraError(
                    "on: Slurm needs dask-jobqueue, which is not installed: pip install 'palpate[slurm]'"
                ) from None
            cluster = stack.enter_context(SLURMCluster(cores=1, processes=1, **_memory()))
            jobs = int(on.partition(":")[2])
            cluster.adapt(minimum_jobs=jobs, maximum_jobs=jobs)  # a job that ends or is cancelled is sent anew
            client = stack.enter_context(Client(cluster))
        else:
            where = {"scheduler_file": on} if on.endswith(".json") else {"address": on}
            try:
                client = stack.enter_context(Client(**where, timeout=PATIENCE))
            except (OSError, TimeoutError, ValueError) as problem:
                why = str(problem).splitlines()[0] if str(problem) else type(problem).__name__
                raise ClusterError(f"on: no scheduler answers at {on} ({why}); start one: dask scheduler") from None
        yield client, threads


def _until_all_work(client: "Client", workers: int) -> None:
    """Waits for workers that are being started in place of dead ones: Dask cannot end a process that has just been begun."""
    with contextlib.suppress(TimeoutError, OSError):
        client.wait_for_workers(workers, timeout=PATIENCE)


def _memory() -> dict[str, str]:
    """The memory of a Slurm job, where the user's jobqueue.yaml says none."""
    import dask

    return {} if dask.config.get("jobqueue.slurm.memory", None) else {"memory": "4GB"}


def workers_without(folder: Path, client: "Client") -> list[str]:
    """The workers that do not see a folder of this machine."""
    seen: dict[str, bool] = client.run(folder.is_dir)
    return [worker for worker, sees in seen.items() if not sees]
