"""How fast, how exact, next to what: see README.md.

Everything runs on the same THREADS processors, ours and the peers'. These settings are read when NumPy, ITK and JAX are
first imported, so they stand here. BLAS has one thread, because the roofline runs one product a thread.
"""

import os
from importlib.metadata import PackageNotFoundError, version

THREADS = 2

_allowed = sorted(os.sched_getaffinity(0))
os.sched_setaffinity(0, _allowed[:THREADS])
os.environ["PALPATE_THREADS"] = str(THREADS)
os.environ["ITK_GLOBAL_DEFAULT_NUMBER_OF_THREADS"] = str(THREADS)
os.environ["MBIRJAX_NUM_CPU_DEVICES"] = str(THREADS)
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["JAX_PLATFORMS"] = "cpu"
os.environ["MPLBACKEND"] = "agg"


def installed(name: str) -> str | None:
    """The version of a package, None if it is not there."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None
