"""What a display draws of a session's tissue, before and after each cut."""

from dataclasses import replace
from typing import Any

import numpy as np

from palpate.arrays import Float32
from palpate.errors import DataError
from palpate.meshes.cutting.cut_mesh import CutMesh
from palpate.meshes.display_surfaces import DisplayedSurface, displayed_surface
from palpate.tissue.gaping import opening
from palpate.tissue.models.compliance import ComplianceModel
from palpate.tissue.models.tissue_model import TissueModel
from palpate.tissue.reference.linear_elasticity import FiniteElements

KEPT = 3  # of the last bodies, for frames that are on their way


class DisplayedBodies:
    """The surfaces of a session by the number of its body (`Frame.body`); those before the last few are gone.

    tension: kPa, by which cuts gape. regions: whether what is inside may be drawn. Raises `DataError` for a tension below 0.
    """

    def __init__(self, tension: float, regions: bool) -> None:
        if not (np.isfinite(tension) and tension >= 0):
            raise DataError(f"tension: {tension:g} kPa, expected 0 or more; leave it out for none")
        self.tension, self.regions = float(tension), regions
        self._surfaces: dict[int, DisplayedSurface] = {}

    def add(self, number: int, model: TissueModel) -> DisplayedSurface:
        """Makes the surface of a model's tissue, opened by the tension, that of a body. Before the loop shows that body."""
        mesh = model.tissue.mesh
        drawn = displayed_surface(mesh, self.regions)
        if isinstance(mesh, CutMesh) and self.tension > 0:
            elements = model.elements if isinstance(model, ComplianceModel) else FiniteElements(model.tissue)
            moved = opening(elements, mesh, np.full(len(mesh.tets), self.tension))
            drawn = replace(drawn, gape=drawn.carried(moved[drawn.nodes].astype(np.float32)))
        self._surfaces[number] = drawn
        self._surfaces.pop(number - KEPT, None)
        return drawn

    def moved(self, frame: Any) -> Float32:
        """(S, 3) mm, displacements at a frame of the vertices of the surface that it shows."""
        return self._surfaces[int(frame.body)].carried(frame.shown)
