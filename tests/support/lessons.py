"""A lesson about a small organ without lumps, in files."""

import numpy as np
import yaml

import palpate as pp
from palpate.meshes.tet_mesh import TetMesh
from support.example_organs import ellipsoid


def lesson_file(folder, size=11, **changes):
    """Writes organ and lesson into a folder; the name of the lesson's file."""
    mesh = ellipsoid(size)
    plain = TetMesh(mesh.nodes, mesh.tets, np.ones(len(mesh.tets), dtype=np.int32), {1: "organ"})
    pp.write_tissue(folder / "tissue.vtu", pp.Tissue(plain, 5.0, 0.45, pp.resting_on(plain, (0, 0, -1), depth=8.0)))
    content = yaml.safe_load(pp.lesson_template("tissue.vtu")) | changes
    (folder / "lesson.yaml").write_text(yaml.safe_dump(content))
    return folder / "lesson.yaml"
