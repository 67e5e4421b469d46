"""The organ in a notebook: the exported page, and its values as traits."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import traitlets

from palpate.arrays import Float64
from palpate.display.page_widget import PageWidget, numbers, reported
from palpate.errors import DataError
from palpate.simulation.recording import Record, record_of_page
from palpate.standalone.organ_data import organ_data, session_of
from palpate.standalone.organ_page import one_file
from palpate.tissue.tissue import Tissue

TOOLS = ("press", "pull", "grasp", "needle", "measure", "camera")
COLORS = ("plain", "displacement", "strain", "stiffness")
SETTABLE = ("tool", "depth", "view", "color")


@dataclass(frozen=True, eq=False)
class Pick:
    """A place of the surface that was clicked. point: (3,) mm, at rest. region: name of the region there."""

    point: Float64
    region: str


class TouchWidget(PageWidget):
    """The organ, to be touched in the notebook.

    tissue: what it is. radius: of the contact, mm. Set by the hand: force, (3,) N of the tissue on the tool, zero where
    none touches; position, (3,) mm of the tool, None where none touches; point and displacement, (3,) mm as in
    `model.push`: the place it holds, at rest, and how far that is moved; picked, a `Pick`; session, a `Record`, newer each
    time that all tools have let go. Set by the hand or by Python: tool; depth (mm, of the tool); view (azimuth from the
    front and elevation, degrees); color.
    """

    force = traitlets.Instance(np.ndarray, read_only=True)
    position = traitlets.Instance(np.ndarray, allow_none=True, read_only=True)
    point = traitlets.Instance(np.ndarray, allow_none=True, read_only=True)
    displacement = traitlets.Instance(np.ndarray, read_only=True)
    picked = traitlets.Instance(Pick, allow_none=True, read_only=True)
    session = traitlets.Instance(Record, allow_none=True, read_only=True)
    tool = reported(traitlets.Any("press"))
    depth = reported(traitlets.Any(None))
    view = reported(traitlets.Any(None))
    color = reported(traitlets.Any("plain"))
    _touched = reported(traitlets.Dict(allow_none=True, default_value=None))
    _picked = reported(traitlets.Dict(allow_none=True, default_value=None))
    _record = reported(traitlets.Unicode())

    def __init__(self, tissue: Tissue, radius: float | None = None, title: str = "organ", task: str = "") -> None:
        session = session_of(tissue, radius)
        self.tissue, self.radius = tissue, float(session.settings.radius)
        page = one_file(organ_data(session, title, task), title, host="notebook")
        super().__init__(page, tissue._repr_html_(), title, SETTABLE)
        self._follow_touch()
        for private, follow in (
            ("_touched", self._follow_touch), ("_picked", self._follow_pick), ("_record", self._follow_record)
        ):  # fmt: skip
            self.observe(lambda _, follow=follow: follow(), private)

    def _follow_touch(self) -> None:
        touched: dict[str, Any] = self._touched or {}
        with self.hold_trait_notifications():
            for name in ("position", "point"):
                self.set_trait(name, None if not touched else np.array(touched[name], dtype=np.float64))
            for name in ("force", "displacement"):
                self.set_trait(name, np.array(touched.get(name, (0, 0, 0)), dtype=np.float64))

    def _follow_pick(self) -> None:
        if self._picked:
            point = np.array(self._picked["point"], dtype=np.float64)
            self.set_trait("picked", Pick(point, surface_region(self.tissue, point)))

    def _follow_record(self) -> None:
        if self._record:
            self.set_trait("session", record_of_page(self._record))

    def _check_choice(self, proposal: Any) -> str:
        name, value = proposal["trait"].name, proposal["value"]
        allowed = TOOLS if name == "tool" else COLORS
        if value not in allowed:
            raise DataError(f"{name}: {value!r} is not there; choose one of {', '.join(allowed)}")
        return str(value)

    def _check_depth(self, proposal: Any) -> float | None:
        value = proposal["value"]
        return None if value is None else numbers("depth", value, 1, "mm, such as 5")[0]

    def _check_view(self, proposal: Any) -> tuple[float, ...] | None:
        value = proposal["value"]
        return (
            None if value is None else numbers("view", value, 2, "azimuth and elevation in degrees, such as (30, 20)")
        )

    _choice = traitlets.validate("tool", "color")(_check_choice)
    _depth = traitlets.validate("depth")(_check_depth)
    _view = traitlets.validate("view")(_check_view)


def surface_region(tissue: Tissue, point: Float64) -> str:
    """Name of the region at the place of the surface that is nearest to a point (3,) mm."""
    mesh = tissue.mesh
    corners = mesh.surface[tissue.surface.closest(point).triangle]
    owner = np.flatnonzero(np.isin(mesh.tets, corners).sum(axis=1) == 3)[0]
    label = int(mesh.region[owner])
    return mesh.names.get(label, f"region {label}")
