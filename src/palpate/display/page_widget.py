"""What the widgets have in common: a page in a sandboxed frame, and a picture for readers without a kernel.

A notebook that is opened without a kernel has no widgets: JupyterLab prints an error where one was. So a widget displays a
picture first, and then itself. The front end (web/src/notebook/widget.ts) hides the picture while it runs, and a rule beside
the picture hides what JupyterLab prints in place of a widget that is gone.
"""

import gzip
from typing import Any

import anywidget
import numpy as np
import traitlets

from palpate.errors import DataError
from palpate.server.access_control import STATIC, check_page

WIDGET_VIEW = "application/vnd.jupyter.widget-view+json"
GONE = (
    "<style>.jp-OutputArea-child:has(.palpate-picture) + .jp-OutputArea-child:not(:has(.palpate-widget)) "
    "{ display: none }</style>"
)
HEIGHT = 560  # px


def reported(trait: Any) -> Any:
    """A trait that the page sets. The kernel need not repeat it to the page."""
    return trait.tag(sync=True, echo_update=False)


def numbers(name: str, value: Any, count: int, expected: str) -> tuple[float, ...]:
    """So many finite numbers. Raises `DataError`."""
    try:
        found = np.atleast_1d(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.shape != (count,) or not np.isfinite(found).all():
        raise DataError(f"{name}: {value!r}, expected {expected}")
    return tuple(found.tolist())


class PageWidget(anywidget.AnyWidget):  # type: ignore[misc]
    """A page, as one HTML text, and a picture of what it shows, as HTML. settable: traits that Python may set."""

    title = traitlets.Unicode().tag(sync=True)
    height = traitlets.Int(HEIGHT).tag(sync=True)
    _page = traitlets.Bytes().tag(sync=True)
    _settable = traitlets.List(traitlets.Unicode()).tag(sync=True)
    _picture = traitlets.Unicode().tag(sync=True)

    def __init__(self, page: str, picture: str, title: str, settable: tuple[str, ...]) -> None:
        check_page()
        self._esm = (STATIC / "notebook.js").read_text(encoding="utf-8")
        packed = gzip.compress(page.encode(), 1)  # most of it is packed already
        super().__init__(_page=packed, _settable=list(settable), title=title)
        self._picture = f"palpate-picture-{self.model_id}"
        self._still = f'{GONE}<div class="palpate-picture {self._picture}">{picture}</div>'

    def _ipython_display_(self) -> None:
        from IPython.display import display

        display({"text/html": self._still}, raw=True)
        view = {"version_major": 2, "version_minor": 0, "model_id": self.model_id}
        display({WIDGET_VIEW: view}, raw=True)
