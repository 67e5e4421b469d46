"""A panel of napari that makes an organ of a label and opens it in the simulator, in a browser."""

import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import napari.layers
from magicgui.widgets import ComboBox, Container, FloatSpinBox, Label, PushButton, SpinBox, create_widget
from napari.qt.threading import create_worker
from napari.utils.notifications import show_error

from palpate.errors import DataError, PalpateError
from palpate.meshes.tetrahedralize import tetrahedralize
from palpate.napari_plugin.layers import labels_of, surface_layer
from palpate.tissue.boundary_conditions import resting_on
from palpate.tissue.io import write_tissue
from palpate.tissue.tissue import Tissue
from palpate.volumes.volume import Labels

START, STOP = "Touch", "Close"
WAYS = {  # to what the organ lies on, in patient space (LPS)
    "its back": (0.0, 1.0, 0.0),
    "its front": (0.0, -1.0, 0.0),
    "its lower end": (0.0, 0.0, -1.0),
    "its upper end": (0.0, 0.0, 1.0),
}
ENDING = 10.0  # s that the simulator has to end in


class TouchPanel(Container):  # type: ignore[misc]
    """Made by napari, which gives it its viewer."""

    def __init__(self, napari_viewer: Any) -> None:
        self.viewer = napari_viewer
        self.worker: Any = None  # napari's thread, while it meshes
        self.simulator: subprocess.Popen[bytes] | None = None
        self.folder = tempfile.TemporaryDirectory(prefix="palpate-napari-")
        self.drawn = create_widget(annotation=napari.layers.Labels, label="Labels")
        self.number = SpinBox(label="Label", value=1, min=1, max=1_000_000)
        self.edge = FloatSpinBox(label="Edges, mm", value=4.0, min=0.1, max=100.0)
        self.young = FloatSpinBox(label="Young's modulus, kPa", value=5.0, min=0.01, max=100_000.0)
        self.poisson = FloatSpinBox(label="Poisson's ratio", value=0.45, min=0.0, max=0.499, step=0.01)
        self.rest_on = ComboBox(label="Lies on", choices=list(WAYS), value="its back")
        self.button = PushButton(text=START)
        self.status = Label(value="")
        settings = [self.drawn, self.number, self.edge, self.young, self.poisson, self.rest_on]
        super().__init__(widgets=[*settings, self.button, self.status])
        self.button.changed.connect(self.start_or_stop)
        self.native.destroyed.connect(self.close_simulator)

    def start_or_stop(self, *_: object) -> None:
        """Meshes the label in a thread and opens it, or closes the simulator."""
        if self.simulator is not None:
            self.close_simulator()
        elif self.worker is None:
            try:
                labels = self.chosen()
            except PalpateError as problem:
                show_error(str(problem))
                return
            self.status.value = "meshing"
            constants = self.young.value, self.poisson.value
            self.worker = create_worker(
                tissue_of, labels, self.number.value, self.edge.value, *constants, WAYS[self.rest_on.value],
                _start_thread=False, _progress={"desc": "palpate: meshing"},
            )  # fmt: skip
            self.worker.returned.connect(self.open_simulator)
            self.worker.errored.connect(self.failed)
            self.worker.finished.connect(self.meshed)
            self.worker.start()

    def chosen(self) -> Labels:
        """The labels of the chosen layer. Raises `DataError` and `GeometryError`."""
        layer = self.drawn.value
        if layer is None:
            raise DataError("labels: there is no layer; draw one, or open a label map")
        labels = labels_of(layer)
        if not (labels.values == self.number.value).any():
            raise DataError(f"layer {layer.name}: no voxel has the label {self.number.value}")
        return labels

    def open_simulator(self, tissue: Tissue) -> None:
        """Shows the mesh, and opens the simulator beside napari."""
        name = f"{self.drawn.value.name} {self.number.value}"
        (points, faces), keywords, _ = surface_layer(tissue.mesh, f"{name}, mesh")
        self.viewer.add_surface((points, faces), **keywords)
        path = Path(self.folder.name) / "organ.vtu"
        write_tissue(path, tissue)
        self.simulator = subprocess.Popen([sys.executable, "-m", "palpate", "touch", str(path)])
        self.button.text, self.status.value = STOP, "in the browser"

    def close_simulator(self, *_: object) -> None:
        """Ends the simulator, as Ctrl-C does."""
        if self.simulator is None:
            return
        self.simulator.send_signal(signal.SIGINT if sys.platform != "win32" else signal.SIGTERM)
        try:
            self.simulator.wait(ENDING)
        except subprocess.TimeoutExpired:
            self.simulator.kill()
            self.simulator.wait()
        self.simulator = None
        self.button.text, self.status.value = START, ""

    def failed(self, problem: BaseException) -> None:
        """Says why there is no organ."""
        self.status.value = ""
        show_error(str(problem))

    def meshed(self) -> None:
        """The thread has ended."""
        self.worker = None


def tissue_of(
    labels: Labels, label: int, edge: float, young: float, poisson: float, way: tuple[float, float, float]
) -> Tissue:
    """The organ of a label. Raises what `tetrahedralize` does."""
    mesh = tetrahedralize(labels, label, edge)
    return Tissue(mesh, young, poisson, resting_on(mesh, way))
