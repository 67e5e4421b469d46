"""`palpate` and `python -m palpate` are the command."""

import os
import sys
import threading

from palpate import interrupts

LIBRARIES = 3  # that start a thread for each processor: NumPy's BLAS, SciPy's BLAS, the kernels


def main() -> None:
    """Runs the command line. Ctrl-C ends it even while its modules are loaded."""
    interrupts.end_at_once()
    if not threads_start(LIBRARIES * (os.cpu_count() or 1)):
        os.environ.update({"OPENBLAS_NUM_THREADS": "1", "PALPATE_THREADS": "1"})
        print("note: the system gives few threads (ulimit -u); one does the work", file=sys.stderr)
    from palpate import commands

    try:
        commands.main()
    except SystemExit as end:
        if end.code == interrupts.STOPPED:
            interrupts.end_process()
        raise


def threads_start(count: int) -> bool:
    """Whether so many threads can be started. OpenBLAS waits without end for one that could not."""
    told, started = threading.Event(), []
    try:
        for _ in range(count):
            thread = threading.Thread(target=told.wait, daemon=True)
            thread.start()
            started.append(thread)
    except RuntimeError:
        return False
    finally:
        told.set()
        for thread in started:
            thread.join()
    return True


if __name__ == "__main__":
    main()
