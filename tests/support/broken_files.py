"""A folder of whole and broken files of every kind, for the tests of what the commands refuse."""

import h5py
import meshio
import numpy as np

import palpate as pp
from support.brick_meshes import brick

GEOMETRY = """
incident: 100
panel: {shape: [4, 5], pitch: [1, 1], centre: [0, 0, 0]}
views: {motion: arc, angles: [-10, 0, 10], radius: 600}
"""
COUNTS = np.full((3, 4, 5), 50.0)


def fill(folder):
    """Writes all of them."""
    _stacks(folder)
    _scans(folder)
    _volumes(folder)
    _labels(folder)
    _meshes(folder)
    _tissues(folder)


def cut(path, share=0.6):
    """A truncated copy of `path`, named cut-*."""
    whole = path.read_bytes()
    path.with_name(f"cut-{path.name}").write_bytes(whole[: int(len(whole) * share)])


def _stacks(folder):
    (folder / "file").write_text("a file where a folder is needed")
    (folder / "breast-demo").mkdir()
    (folder / "breast-demo" / "demo.txt").write_text("breast, palpate 0\n")
    (folder / "g.yaml").write_text(GEOMETRY)
    (folder / "raw.yaml").write_text(GEOMETRY + "stack: {dtype: uint16, shape: [3, 4, 5]}\n")
    (folder / "far.yaml").write_text(GEOMETRY.replace("600", "60_000"))
    (folder / "dark.yaml").write_text(GEOMETRY.replace("incident: 100", "incident: 0"))
    np.save(folder / "stack.npy", COUNTS)
    cut(folder / "stack.npy")
    np.save(folder / "two.npy", COUNTS[:2])
    np.save(folder / "complex.npy", COUNTS * 1j)
    for name, value in (("nan", np.nan), ("negative", -7)):
        counts = COUNTS.copy()
        counts[1, 2, 3] = value
        np.save(folder / f"{name}.npy", counts)
    (folder / "stack.raw").write_bytes(COUNTS.astype("<u2").tobytes())
    cut(folder / "stack.raw")


def _scans(folder):
    views = pp.arc_views(pp.Panel((4, 5), (1, 1), (-2, -1.5, 0)), (-10, 0, 10), radius=600)
    pp.write_scan(folder / "scan.h5", pp.Scan(COUNTS, 100, views))
    cut(folder / "scan.h5")
    (folder / "text.h5").write_text("nothing of the sort")
    (folder / "cut.nii.gz.checkpoint.h5").write_bytes((folder / "cut-scan.h5").read_bytes())
    (folder / "scan.nii.gz.checkpoint.h5").write_bytes((folder / "scan.h5").read_bytes())
    for name, key, value in (
        ("nan", "counts", np.where(np.arange(60).reshape(3, 4, 5) == 33, np.nan, 50)),
        ("negative", "counts", np.where(np.arange(60).reshape(3, 4, 5) == 33, -7, 50)),
        ("dark", "incident", np.zeros((1, 1, 1))),
        ("flat", "counts", np.ones((4, 5))),
        ("complex", "counts", COUNTS * 1j),
        ("far", "views/source", np.full((3, 3), 60_000.0)),
        ("two", "views/source", np.full((2, 3), 600.0)),
    ):
        (folder / f"{name}.h5").write_bytes((folder / "scan.h5").read_bytes())
        with h5py.File(folder / f"{name}.h5", "a") as file:
            del file[key]
            file[key] = value


def _volumes(folder):
    import nibabel

    values = np.zeros((12, 14, 16), dtype=np.float32)
    values[3:9, 3:10, 3:12] = 0.05
    pp.write_volume(folder / "ct.nii.gz", pp.Volume(values, pp.Grid(values.shape, (1, 1, 1))))
    pp.write_volume(folder / "ct.mha", pp.Volume(values, pp.Grid(values.shape, (1, 1, 1))))
    pp.write_volume(folder / "ct.nrrd", pp.Volume(values, pp.Grid(values.shape, (1, 1, 1))))
    for name in ("ct.nii.gz", "ct.mha", "ct.nrrd"):
        cut(folder / name)
    holed = values.copy()
    holed[5, 6, 7] = np.nan
    for name, array, affine in (
        ("nan", holed, np.eye(4)),
        ("four", np.stack([values, values], axis=-1), np.eye(4)),
        ("complex", values.astype(np.complex64), np.eye(4)),
        ("far", values, np.diag([60_000, 1, 1, 1])),
        ("aside", values, np.array([[1, 0, 0, 900], [0, 1, 0, 0], [0, 0, 1, 10], [0, 0, 0, 1]])),
        ("above", values, np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 700], [0, 0, 0, 1]])),
    ):
        nibabel.save(nibabel.Nifti1Image(array, affine), folder / f"{name}.nii.gz")


def _labels(folder):
    import nibabel

    place = np.moveaxis(np.indices((24, 24, 24)), 0, -1)
    ball = np.linalg.norm(place - 11.5, axis=-1)
    grid = pp.Grid(ball.shape, (1, 1, 1))
    names = {1: "kidney_left", 2: "kidney_right", 3: "lump"}
    pp.write_labels(folder / "labels.nii.gz", pp.Labels((ball < 9) * 1 + (ball < 4) * 2, grid, names))
    pp.write_labels(folder / "organ.nii.gz", pp.Labels(np.ones((12, 14, 16)), pp.Grid((12, 14, 16), (1, 1, 1)), names))
    pp.write_labels(folder / "border.nii.gz", pp.Labels((place[..., 0] < 12) * 1, grid, names))
    pp.write_labels(folder / "empty.nii.gz", pp.Labels(np.zeros(grid.shape, dtype=int), grid, names))
    cut(folder / "labels.nii.gz")
    nibabel.save(nibabel.Nifti1Image((ball / 9).astype(np.float32), np.eye(4)), folder / "fraction.nii.gz")


def _meshes(folder):
    mesh = brick((3, 3, 3))
    pp.write_mesh(folder / "mesh.vtu", mesh)
    pp.write_mesh(folder / "mesh.msh", mesh)
    cut(folder / "mesh.vtu")
    cut(folder / "mesh.msh")

    def store(name, nodes, tets, kind="tetra"):
        meshio.Mesh(np.array(nodes, dtype=float), [(kind, np.array(tets))]).write(folder / f"{name}.vtu")

    corners = [[0, 0, 0], [5, 0, 0], [0, 5, 0], [0, 0, 5]]
    store("pinched", [*corners, [-5, 0, 0], [0, -5, 0], [0, 0, -5]], [[0, 1, 2, 3], [0, 5, 4, 6]])
    store("flat", [[0, 0, 0], [5, 0, 0], [0, 5, 0], [2, 2, 0]], [[0, 1, 2, 3]])
    store("skin", corners, [[0, 1, 2], [0, 1, 3]], "triangle")
    nodes = np.array(mesh.nodes)
    nodes[len(nodes) // 2 + 2] += [400, 0, 0]  # an inner node, pulled out through the wall
    store("folded", nodes, mesh.tets)
    nodes[3] = np.nan
    store("nan", nodes, mesh.tets)


def _tissues(folder):
    mesh = brick((3, 3, 3))
    tissue = pp.Tissue(mesh, 5.0, 0.45, mesh.nodes[:, 2] == 0)
    pp.write_tissue(folder / "tissue.vtu", tissue)
    cut(folder / "tissue.vtu")
    session = pp.Session(pp.model(tissue, "blocks"))
    pp.write_record(folder / "session.h5", session.record())
    cut(folder / "session.h5")
