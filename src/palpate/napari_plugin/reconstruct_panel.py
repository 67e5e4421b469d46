"""A panel of napari that reconstructs a scan, coarse to fine before the eyes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from magicgui.widgets import Container, FileEdit, FloatSpinBox, Label, PushButton, SpinBox
from napari.qt.threading import create_worker
from napari.utils.notifications import show_error

from palpate.errors import DataError, PalpateError
from palpate.napari_plugin.layers import affine_of, image_layer, name_of
from palpate.reconstruction.default_grid import covering_grid
from palpate.reconstruction.iterate import Step
from palpate.reconstruction.reconstruct import iterates
from palpate.scans.io import read_scan

START, STOP = "Reconstruct", "Stop"


class ReconstructPanel(Container):  # type: ignore[misc]
    """Made by napari, which gives it its viewer."""

    def __init__(self, napari_viewer: Any) -> None:
        self.viewer = napari_viewer
        self.worker: Any = None  # napari's thread, while it runs
        self.layer: Any = None  # with the newest iterate
        self.scan = FileEdit(label="Scan", mode="r", filter="*.h5")
        self.thickness = FloatSpinBox(label="Thickness, mm", value=50.0, min=0.1, max=5000.0)
        self.spacing = FloatSpinBox(label="Pixel, mm", value=0.0, min=0.0, max=100.0, tooltip="0: that of the panel")
        self.resolution = FloatSpinBox(
            label="Resolution, mm", value=0.0, min=0.0, max=100.0, tooltip="0: a prior for smooth objects"
        )
        self.iterations = SpinBox(label="Iterations", value=50, min=1, max=1000)
        self.button = PushButton(text=START)
        self.status = Label(value="")
        settings = [self.scan, self.thickness, self.spacing, self.resolution, self.iterations]
        super().__init__(widgets=[*settings, self.button, self.status])
        self.button.changed.connect(self.start_or_stop)

    def start_or_stop(self, *_: object) -> None:
        """Begins, or ends what runs after its present iteration; the image stays as it is."""
        if self.worker is not None:
            self.worker.quit()
            self.status.value = "stopping"
            return
        path = Path(self.scan.value)
        try:
            steps = self.steps(path)
        except PalpateError as problem:
            show_error(str(problem))
            return
        self.layer = None
        self.worker = create_worker(shown, steps, _start_thread=False, _progress={"desc": f"palpate: {path.name}"})
        self.worker.yielded.connect(lambda step: self.show_step(step, name_of(path)))
        self.worker.errored.connect(lambda problem: show_error(str(problem)))
        self.worker.finished.connect(self.ended)
        self.button.text = STOP
        self.worker.start()

    def steps(self, path: Path) -> Iterator[Step]:
        """The iterates. Raises what `read_scan`, `covering_grid` and `iterates` do, before any work."""
        if not path.is_file():
            raise DataError(f"{path}: no such file; choose a scan (.h5), such as palpate scan import writes")
        scan = read_scan(path)
        grid = covering_grid(scan.views, self.thickness.value, self.spacing.value or None)
        return iterates(scan, grid, resolution=self.resolution.value or None, iterations=self.iterations.value)

    def show_step(self, step: Step, name: str) -> None:
        """The newest iterate takes the place of the one before in one layer."""
        values, keywords, _ = image_layer(step.volume, name)
        if self.layer is None or self.layer not in self.viewer.layers:
            self.layer = self.viewer.add_image(values, **keywords)
        self.layer.data, self.layer.affine = values, affine_of(step.volume.grid)
        self.layer.contrast_limits = keywords["contrast_limits"]
        self.status.value = f"level {step.level}, iteration {step.iteration}, {step.seconds:.1f} s"

    def ended(self) -> None:
        """What ran has ended."""
        self.worker, self.button.text = None, START


def shown(steps: Iterator[Step]) -> Iterator[Step]:
    """Runs in a thread of napari's, which hands each iterate to the panel."""
    yield from steps
