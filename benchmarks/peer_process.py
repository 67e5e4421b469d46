"""A peer in a process of its own, which is ended when its time is over, whatever it is at."""

import multiprocessing
import os
from collections.abc import Iterator
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path

from benchmarks.cube_case import cube
from benchmarks.settling_time import Settled, settle
from palpate.arrays import Float64

OFTEN = 0.2  # s between looks at what it has used


def settled(peer: str, n: int, budget: float, goal: Float64 | None, limit: int) -> Iterator[Settled | str]:
    """What each choice of settings of a peer, a module, comes to on the cube of n³ nodes; why it ended, if before the last.

    limit: CPU s of the whole process, importing and set-up of all its choices included. budget, goal: as in `settle`.
    """
    context = multiprocessing.get_context("spawn")
    reader, writer = context.Pipe(duplex=False)
    process = context.Process(target=_measure, args=(peer, n, budget, goal, writer), daemon=True)
    process.start()
    writer.close()
    try:
        while True:
            while not reader.poll(OFTEN):
                if process.pid is None or used(process.pid) > limit:
                    yield f"not within {limit} s of its process"
                    return
            yield reader.recv()
    except EOFError:  # it has ended
        process.join()
        if process.exitcode:
            yield "it failed"
    finally:
        process.kill()


def used(pid: int) -> float:
    """CPU s. (A limit of the system's own on them would make its clock of them coarse.)"""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def _measure(peer: str, n: int, budget: float, goal: Float64 | None, writer: Connection) -> None:
    for run in import_module(peer).runs(cube(n)):
        writer.send(settle(run, budget, goal))
