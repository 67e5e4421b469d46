"""RTK's matched Joseph pair (itk-rtk) on a geometry of ours: another code, other threads, the same rays.

Joseph's method takes one ray through each pixel's centre and interpolates between voxel centres, so it agrees with
exact means over pixels on smooth volumes only.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

import palpate as pp


class Joseph:
    """Forward and back projector; each call of `forward` or `back` gives a function that does the work anew."""

    def __init__(self, views: pp.Views, grid: pp.Grid) -> None:
        import itk  # seconds to load: only when asked for
        from itk import RTK

        self.itk, self.rtk, self.views, self.grid = itk, RTK, views, grid
        self.geometry = RTK.ThreeDCircularProjectionGeometry.New()
        for source, panel in zip(views.source, views.panels, strict=True):
            point, vector = itk.Point[itk.D, 3], itk.Vector[itk.D, 3]
            if not self.geometry.AddProjection(
                point(source.tolist()),
                point(np.asarray(panel.origin).tolist()),
                vector(np.asarray(panel.column_axis).tolist()),
                vector(np.asarray(panel.row_axis).tolist()),
            ):
                raise ValueError("RTK refused a view")

    def _volume(self, x: np.ndarray) -> Any:
        image = self.itk.image_from_array(x)
        image.SetSpacing(self.grid.spacing[::-1])
        image.SetOrigin(np.asarray(self.grid.origin).tolist())
        return image

    def _projections(self, p: np.ndarray) -> Any:
        image = self.itk.image_from_array(p)
        pitch = self.views.panels[0].pitch
        image.SetSpacing((pitch[1], pitch[0], 1.0))
        image.SetOrigin((0.0, 0.0, 0.0))
        return image

    def forward(self, x: np.ndarray) -> Callable[[], np.ndarray]:
        """x (z, y, x) -> projections (views, rows, columns)."""
        blank = self._projections(np.zeros(self.views.shape, np.float32))
        return self._runs("JosephForwardProjectionImageFilter", blank, self._volume(x))

    def back(self, p: np.ndarray) -> Callable[[], np.ndarray]:
        """p (views, rows, columns) -> volume (z, y, x), the transpose."""
        blank = self._volume(np.zeros(self.grid.shape, np.float32))
        return self._runs("JosephBackProjectionImageFilter", blank, self._projections(p))

    def _runs(self, name: str, blank: Any, given: Any) -> Callable[[], np.ndarray]:
        image = self.itk.Image[self.itk.F, 3]
        filter = getattr(self.rtk, name)[image, image].New()
        filter.SetInput(0, blank)
        filter.SetInput(1, given)
        filter.SetGeometry(self.geometry)
        filter.InPlaceOff()

        def run() -> np.ndarray:
            filter.Modified()
            filter.Update()
            return self.itk.array_view_from_image(filter.GetOutput())

        return run
