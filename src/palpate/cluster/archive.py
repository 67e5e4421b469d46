"""Many runs at once, spread by Dask's scheduler, which carries paths and records, never images."""

import contextlib
import hashlib
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.atomic_write import writable
from palpate.bounded_read import existing_path
from palpate.cluster.command_process import run_command
from palpate.cluster.command_run import CommandRun, RunRecord, absolute_run, command_line
from palpate.cluster.connection import check_on, connected, workers_without
from palpate.errors import ClusterError, DataError

if TYPE_CHECKING:
    from distributed import Future

INTERVAL = 0.1  # s between two looks at what has ended
LOOK = 5.0  # s between two looks at whether there are workers
DEATHS = 3  # of workers during one run, before it counts as failed


def run_archive(
    runs: Sequence[CommandRun], on: int | str = 1, progress: Callable[[str, float], None] | None = None
) -> list[RunRecord]:
    """Run palpate commands on the workers of Dask's scheduler.

    An output appears whole or not at all, and a record stays beside it. A run whose output is there already, made by the same
    version from the same contents, is not made again. So the same call goes on after a stop. A failure ends its own run only.

    Parameters
    ----------
    runs : sequence of CommandRun
        What is to be done. All must be able to read the inputs and write the outputs under the same paths.
    on : int or str, optional
        How many workers to start on this machine; or the address of a running scheduler, such as "tcp://host:8786", or its
        file, "scheduler.json"; or "slurm:N" for N jobs of Slurm.
    progress : callable, optional
        Is called with what is done, in words, and its share, 0 to 1.

    Returns
    -------
    list of RunRecord
        What became of each run, in their order.

    Raises
    ------
    DataError
        If two runs have one output, or `on` is none of these.
    FileError
        If an input is missing, or an output cannot be written.
    ClusterError
        If no scheduler answers, or the one at work is gone.
    ExtraError
        If dask.distributed is not installed.

    Examples
    --------
    >>> pp.run_archive([])
    []
    """
    on = check_on(on)
    check_runs(runs)
    if not runs:
        return []
    from distributed import as_completed

    places = [absolute_run(run) for run in runs]
    records: dict[int, RunRecord] = {}
    began = time.monotonic()
    say = progress or (lambda what, share: None)
    with connected(on) as (client, threads):
        say(f"0 of {len(runs)}{_dashboard(client.dashboard_link)}", 0.0)
        blind = workers_without(places[0].output.parent, client)
        if blind:
            raise ClusterError(f"on: {', '.join(blind[:3])} cannot see {places[0].output.parent}; share that folder")
        futures = {
            client.submit(run_command, run, threads, key=_name(run), pure=False, retries=DEATHS): k
            for k, run in enumerate(places)
        }
        ended, looked = as_completed(futures), time.monotonic()
        while len(records) < len(runs):
            batch = ended.next_batch(block=False)
            for future in batch:
                records[futures[future]] = record_of(future, len(records), len(runs))
                future.release()
                left = (time.monotonic() - began) / len(records) * (len(runs) - len(records))
                rest = f", {left:.0f} s left" if left >= 1 else ""
                say(f"{summary(records.values())}{rest}", len(records) / len(runs))
            if not batch:
                time.sleep(INTERVAL)
                if time.monotonic() > looked + LOOK:
                    looked = time.monotonic()
                    with contextlib.suppress(OSError):  # the futures say it if the scheduler is gone
                        if not client.nthreads():
                            say(f"{summary(records.values())}; there is no worker now", len(records) / len(runs))
    return [records[k] for k in range(len(runs))]


def record_of(future: "Future", done: int, count: int) -> RunRecord:
    """What became of the run of a future that has ended. Raises `ClusterError` if the scheduler is gone."""
    from distributed.client import FutureCancelledError

    try:
        record: RunRecord = future.result()
    except (FutureCancelledError, OSError):
        raise ClusterError(
            f"on: the scheduler is gone; {done} of {count} runs are done: the same command goes on"
        ) from None
    except Exception as problem:  # its workers died, or the run does not fit them
        return RunRecord("", "failed", f"{type(problem).__name__}: {problem}"[:400])
    return record


def summary(records: Iterable[RunRecord]) -> str:
    """How many runs are done, were kept and failed, in words."""
    counts = Counter(record.state for record in records)
    words = {"done": "done", "kept": "there before", "failed": "failed"}
    return ", ".join(f"{counts[state]} {word}" for state, word in words.items() if counts[state] or state == "done")


def check_runs(runs: Sequence[CommandRun]) -> None:
    """Raises `DataError` or `FileError` for what cannot be done at all."""
    outputs = Counter(run.output.resolve() for run in runs)
    twice = [str(output) for output, count in outputs.items() if count > 1]
    if twice:
        raise DataError(f"{twice[0]}: {outputs[Path(twice[0])]} runs would write it; give each its own output")
    for run in runs:
        existing_path(run.input)
    for folder in {run.output.resolve().parent for run in runs}:
        writable(folder / "probe")


def _name(run: CommandRun) -> str:
    """Of a task, as the dashboard shows it; the same for two clients that ask for the same."""
    mark = hashlib.sha256("\0".join(command_line(run)).encode()).hexdigest()[:16]
    return f"{run.command}-{run.input.name}-{mark}"


def _dashboard(link: str) -> str:
    """Where it is, if the scheduler has one."""
    try:
        import bokeh  # noqa: F401
    except ImportError:
        return ""
    return f" (dashboard: {link})"
