"""A mesh as a notebook shows it."""

from collections.abc import Mapping

from palpate.arrays import Int32
from palpate.meshes.solid_picture import Solid, region_rows, size_rows, solid_png
from palpate.volumes.notebook_card import notebook_card


def mesh_card(mesh: Solid, inside: Mapping[int, Int32]) -> str:
    """Picture, figures, and the tetrahedra of each region. inside: triangles around regions inside, by label."""
    rows = [*size_rows(mesh), *region_rows(mesh, {})]
    return notebook_card("Mesh of tetrahedra", rows, solid_png(mesh, inside))
