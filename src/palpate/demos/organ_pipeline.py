"""From labels to a tissue that can be touched, with the report's sections on the way: what all demos share."""

from collections.abc import Sequence

import numpy as np

from palpate.arrays import Int32
from palpate.meshes.io import read_mesh, write_mesh
from palpate.meshes.mesh_quality import mesh_quality
from palpate.meshes.tet_mesh import TetMesh, boundary_faces
from palpate.meshes.tetrahedralize import tetrahedralize
from palpate.report.figures import surface_map, surfaces
from palpate.report.html_report import Section
from palpate.report.stages import Stages
from palpate.tissue.io import read_tissue, write_tissue
from palpate.tissue.lump_detectability import lump_map
from palpate.tissue.named_tissues import Named
from palpate.tissue.spring_fitting import fit
from palpate.tissue.tissue import Tissue
from palpate.volumes.volume import Labels


def mesh_stage(stages: Stages, labels: Labels, name: str, **options: object) -> TetMesh:
    """The mesh of labels in file `name`; options as for `tetrahedralize`."""
    return stages(
        name,
        lambda: tetrahedralize(labels, **options),  # type: ignore[arg-type]
        write_mesh,
        read_mesh,
    )


def fit_stage(
    stages: Stages,
    mesh: TetMesh,
    name: str,
    tissue: Named,
    poisson: float,
    fixed: Int32,
) -> Tissue:
    """The tissue in file `name`, with the stiffness of named tissues, its springs fitted to finite elements."""

    def fitted() -> Tissue:
        say = stages.progress
        return fit(mesh, None, poisson, fixed, tissue=tissue, progress=lambda what, share: say(what, 0.99 * share))

    return stages(name, fitted, write_tissue, read_tissue)


def mesh_section(mesh: TetMesh, labels: Labels, text: Sequence[str]) -> Section:
    """The mesh in figures and pictures, its regions side by side."""
    faces = {"skin": mesh.surface}
    for value in np.unique(mesh.region)[1:] if len(np.unique(mesh.region)) > 1 else []:
        faces[mesh.names.get(int(value), f"region {value}")] = boundary_faces(mesh.tets[mesh.region == value])
    return Section(
        "Labels to tetrahedra",
        [*text, *str(mesh_quality(mesh, labels)).splitlines()],
        pictures=[(surfaces(mesh, faces), "The mesh by isosurface stuffing; inner regions share their faces with it.")],
    )


def tissue_section(tissue: Tissue, text: Sequence[str]) -> Section:
    """The fit of the springs in figures, and where they differ from finite elements."""
    assert tissue.report is not None
    nodes = tissue.mesh.surface_nodes
    error = tissue.report.error_map[nodes]
    return Section(
        "Mesh to tissue",
        [*text, *tissue.report.text().splitlines()],
        pictures=[
            (
                surface_map(tissue.mesh, tissue.mesh.nodes[nodes][::4], error[::4], "mm"),
                "Greatest difference between fitted springs and finite elements at each surface node, over the "
                "contacts of the report. The page uses springs only if asked to: its other models solve the "
                "finite-element equations.",
            )
        ],
    )


def lump_section(title: str, tissue: Tissue, region: str, depth: float, radius: float, stages: Stages) -> Section:
    """What a finger would feel of a stiff region: the force for equal depth with and without it, mapped."""
    found = lump_map(tissue, region, depth, radius, progress=lambda share: stages.progress(title.split(":")[0], share))
    return Section(
        title,
        found.text().splitlines(),
        pictures=[
            (
                surface_map(tissue.mesh, found.points, 100 * found.difference, "% more force", eye=(50, -70)),
                f"Force needed for the same depth of {found.depth:g} mm, with the stiff region against without it, by "
                f"finite elements.",
            )
        ],
    )


def files_section(stages: Stages) -> Section:
    """What the run left, for other programs to open."""
    rows = [(path.name, f"{path.stat().st_size / 1e6:.2f} MB") for path in stages.made]
    return Section("Files of this run", table=[("file", "size"), *rows])
