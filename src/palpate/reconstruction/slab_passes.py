"""Passes over volumes, slab after slab: where they lie in files, each slice is read once a pass, and written once."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import ContextVar

from palpate import _core
from palpate.arrays import Float32

LARGE = 4  # a volume larger than this part of the limit is passed over in slabs
AT_ONCE = 10  # slabs in memory: of three volumes, each read ahead, in use, and on its way back, and some more
DEPTH = 16  # slices that the backprojector takes at once

Slab = tuple[int, int]  # the first slice, and the one after the last
Passing = _core.base.Passing
TOLD: ContextVar[Callable[[int, int], None] | None] = ContextVar("told of each slab", default=None)


@contextlib.contextmanager
def telling_slabs(told: Callable[[int, int], None]) -> Iterator[None]:
    """In the block, `told` gets the number of each slab that is passed over, from 1 on, and how many the pass has.

    A pass with one slab tells nothing. One takes seconds to minutes, where volumes lie in files.
    """
    before = TOLD.get()
    TOLD.set(told)
    try:
        yield
    finally:
        TOLD.set(before)


def slabs_of(shape: tuple[int, int, int], ends: Sequence[int] | None = None) -> list[Slab]:
    """The slabs in which a pass goes over volumes of a shape: one, unless there is a limit of memory that they are large for.

    ends: where slabs may end; anywhere by default.
    """
    slices, limit = shape[0], _core.base.scratch_limit()
    slice_bytes = 4 * shape[1] * shape[2]
    if slices * slice_bytes <= limit // LARGE:
        return [(0, slices)]
    depth = max(1, limit // (AT_ONCE * slice_bytes))
    depth -= depth % DEPTH if depth > DEPTH else 0
    slabs: list[Slab] = []
    first = 0
    ends = range(1, slices + 1) if ends is None else ends
    for k, end in enumerate(ends):
        if k + 1 == len(ends) or ends[k + 1] - first > depth:
            slabs.append((first, end))
            first = end
    return slabs


def passes(slabs: Sequence[Slab], reads: Sequence[Float32], writes: Sequence[Float32] = ()) -> Iterator[Slab]:
    """Each slab in turn, once it is in memory; the one before the last goes back to its file meanwhile.

    reads: volumes (z, y, x) that are read, and may be written to. writes: those of which every voxel is written in the pass
    before it is read. The slices beside a slab may be read and written, too. Threads of its own wait for the disk.
    """
    if len(slabs) == 1:
        yield slabs[0]
        return
    told = TOLD.get()
    with ThreadPoolExecutor(2) as threads:
        coming: Future[None] | None = None
        going: list[Future[None]] = []
        for k, slab in enumerate(slabs):
            if coming is None:
                _fetch(slab, reads, writes)
            else:
                coming.result()
            if told:
                told(k + 1, len(slabs))
            if k + 1 < len(slabs):
                coming = threads.submit(_fetch, slabs[k + 1], reads, writes)
            yield slab
            if k > 0:
                for done in going:
                    done.result()
                going = [threads.submit(_send_back, slabs[k - 1], (*reads, *writes))]
        threads.submit(_send_back, slabs[-1], (*reads, *writes))


def _fetch(slab: Slab, reads: Sequence[Float32], writes: Sequence[Float32]) -> None:
    first, end = slab
    for volume in reads:
        _core.base.pass_over(volume[first:end], Passing.read)
    for volume in writes:  # the slice after the slab, too: it may be written to before the next slab comes
        _core.base.pass_over(volume[first + (first > 0) : end + 1], Passing.written)


def _send_back(slab: Slab, volumes: Sequence[Float32]) -> None:
    first, end = slab
    for volume in volumes:
        _core.base.pass_over(volume[first:end], Passing.done)
