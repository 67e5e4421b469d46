"""Whether this is a notebook, and whether it can show widgets."""

import sys
from importlib.util import find_spec

from palpate.errors import ExtraError

EXTRA = ("anywidget", "ipywidgets")


def in_notebook() -> bool:
    """Whether IPython runs here as the kernel of a notebook, and not in a terminal."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return getattr(shell, "kernel", None) is not None


def require_extra(otherwise: str) -> None:
    """Raises `ExtraError` if a package is missing that widgets need; otherwise: what does the same without it."""
    missing = [name for name in EXTRA if find_spec(name) is None]
    if missing:
        raise ExtraError(
            f"a widget needs {' and '.join(missing)}: pip install 'palpate[notebook]', restart the kernel and load the page "
            f"again; or open a browser instead: {otherwise}"
        )
