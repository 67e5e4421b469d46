"""Slices or projections in a notebook: the viewer's page with the values in it."""

from collections.abc import Sequence
from typing import Any

import traitlets

from palpate.display.page_widget import PageWidget, numbers, reported
from palpate.errors import DataError
from palpate.scans.scan import Scan
from palpate.server.view import image_payloads
from palpate.standalone.image_page import image_page
from palpate.volumes.volume import Volume

MOST_VOXELS = 4_000_000  # of all images: a notebook keeps them in its page, beside what else it shows


class ViewWidget(PageWidget):
    """Images in the notebook.

    Set by the hand: value, at the crosshair, None outside. Set by the hand or by Python: position of the crosshair, (3,) mm,
    and window, the values drawn black and white.
    """

    position = reported(traitlets.Any(None))
    window = reported(traitlets.Any(None))
    value = traitlets.Float(None, allow_none=True, read_only=True)
    _value = reported(traitlets.Any(None))

    def __init__(
        self, images: Sequence[Volume | Scan], titles: Sequence[str] = ("A", "B"), water: float | None = None
    ) -> None:
        payloads = image_payloads(images, titles, water, MOST_VOXELS // len(images))
        picture = "".join(image._repr_html_() for image in images)
        title = ", ".join(payload.image.title for payload in payloads)
        super().__init__(image_page(payloads, host="notebook"), picture, title, ("position", "window"))
        self.observe(lambda change: self.set_trait("value", change["new"]), "_value")

    def _check_position(self, proposal: Any) -> tuple[float, ...] | None:
        value = proposal["value"]
        return None if value is None else numbers("position", value, 3, "x, y and z in mm")

    def _check_window(self, proposal: Any) -> tuple[float, ...] | None:
        value = proposal["value"]
        if value is None:
            return None
        low, high = numbers("window", value, 2, "the values drawn black and white")
        if not high > low:
            raise DataError(f"window: {value!r} has no width; give (black, white) with white above black")
        return low, high

    _position = traitlets.validate("position")(_check_position)
    _window = traitlets.validate("window")(_check_window)
