"""A tissue as a notebook shows it: the solid, its constants by region, its supports."""

from typing import Protocol

from palpate.arrays import Float64, Int32
from palpate.meshes.solid_picture import region_rows, size_rows, solid_png
from palpate.meshes.tet_mesh import TetMesh, region_faces
from palpate.volumes.notebook_card import notebook_card


class Solid(Protocol):
    """What a card needs of a `Tissue`; this module may not import it."""

    @property
    def mesh(self) -> TetMesh: ...  # noqa: D102
    @property
    def young(self) -> Float64: ...  # noqa: D102
    @property
    def poisson(self) -> Float64: ...  # noqa: D102
    @property
    def fixed(self) -> Int32: ...  # noqa: D102
    @property
    def element(self) -> str: ...  # noqa: D102
    @property
    def time_dependent(self) -> bool: ...  # noqa: D102


def tissue_card(tissue: Solid, title: str = "Tissue", more: tuple[tuple[str, str], ...] = ()) -> str:
    """Picture and figures. more: rows above those of the tissue."""
    mesh = tissue.mesh
    time = ", relaxes or has inertia" if tissue.time_dependent else ""
    rows = [
        *more,
        *size_rows(mesh),
        *region_rows(mesh, {"E": (tissue.young, " kPa"), "ν": (tissue.poisson, "")}),
        ("Supports", f"{len(tissue.fixed):,} of {len(mesh.nodes):,} nodes are held"),
        ("Elements", f"{tissue.element}{time}"),
    ]
    return notebook_card(title, rows, solid_png(mesh, region_faces(mesh), tissue.fixed))
