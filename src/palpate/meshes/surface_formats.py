"""Writes the surfaces of a mesh, region by region, for printers and viewers: STL, PLY, OBJ, glTF."""

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.arrays import AnyArray, Float64, Int32
from palpate.meshes.tet_mesh import TetMesh, region_faces

# Of glTF's regions, the organ's first: it is seen through.
COLORS = ((0.85, 0.45, 0.40, 0.5), (0.95, 0.85, 0.35, 1.0), (0.35, 0.55, 0.85, 1.0), (0.45, 0.75, 0.45, 1.0))
TO_GLTF = [
    0.001,
    0,
    0,
    0,
    0,
    0,
    -0.001,
    0,
    0,
    0.001,
    0,
    0,
    0,
    0,
    0,
    1,
]  # by columns: m, and its y up is the patient's head
FLOAT, UINT = 5126, 5125  # glTF's numbers of types
ARRAY, INDEX = 34962, 34963  # and of buffers


def region_surfaces(mesh: TetMesh) -> dict[str, tuple[int, Float64, Int32]]:
    """Name to label, points (N, 3) and triangles (F, 3): the mesh's own surface, then that of each region inside."""
    labels, count = np.unique(mesh.region, return_counts=True)
    whole = int(labels[np.argmax(count)])
    found = {}
    for label, faces in {whole: mesh.surface, **region_faces(mesh)}.items():
        used, index = np.unique(faces, return_inverse=True)
        name = mesh.names.get(label, f"region {label}")
        found[name if name not in found else f"{name} {label}"] = (
            label,
            mesh.nodes[used],
            index.reshape(faces.shape).astype(np.int32),
        )
    return found


def write_stl(path: Path, mesh: TetMesh) -> None:
    """Text, a solid for each region: the binary form has no names."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        for name, (_, points, faces) in region_surfaces(mesh).items():
            plain = " ".join(name.split())
            corner = points[faces]
            normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
            normal /= np.linalg.norm(normal, axis=1, keepdims=True)
            file.write(f"solid {plain}\n")
            for n, face in zip(normal.tolist(), corner.tolist(), strict=True):
                vertices = "".join("   vertex {:.9g} {:.9g} {:.9g}\n".format(*v) for v in face)
                file.write("facet normal {:.6g} {:.6g} {:.6g}\n  outer loop\n".format(*n))
                file.write(f"{vertices}  endloop\nendfacet\n")
            file.write(f"endsolid {plain}\n")


def write_ply(path: Path, mesh: TetMesh) -> None:
    """Binary; each face has the label of its region, whose name is in a comment."""
    surfaces = region_surfaces(mesh)
    points = np.concatenate([points for _, points, _ in surfaces.values()])
    faces = np.zeros(
        sum(len(faces) for *_, faces in surfaces.values()), [("n", "u1"), ("nodes", "<i4", 3), ("region", "<i4")]
    )
    faces["n"] = 3
    starts = np.cumsum([0, *(len(points) for _, points, _ in surfaces.values())])
    faces["nodes"] = np.concatenate([f + start for (*_, f), start in zip(surfaces.values(), starts, strict=False)])
    faces["region"] = np.concatenate([np.full(len(f), label) for label, _, f in surfaces.values()])
    names = "".join(f"comment region {label}: {' '.join(name.split())}\n" for name, (label, *_) in surfaces.items())
    head = (
        f"ply\nformat binary_little_endian 1.0\ncomment mm, patient space (LPS)\n{names}element vertex {len(points)}\n"
        f"property double x\nproperty double y\nproperty double z\nelement face {len(faces)}\n"
        f"property list uchar int vertex_indices\nproperty int region\nend_header\n"
    )
    path.write_bytes(head.encode() + points.astype("<f8").tobytes() + faces.tobytes())


def write_obj(path: Path, mesh: TetMesh) -> None:
    """Text, an object for each region."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write("# mm, patient space (LPS)\n")
        start = 1
        for name, (_, points, faces) in region_surfaces(mesh).items():
            file.write(f"o {' '.join(name.split())}\n")
            file.writelines("v {:.9g} {:.9g} {:.9g}\n".format(*point) for point in points.tolist())
            file.writelines("f {} {} {}\n".format(*face) for face in (faces + start).tolist())
            start += len(points)


def write_gltf(path: Path, mesh: TetMesh) -> None:
    """Binary glTF 2.0, in metres: a mesh with a name and a color for each region."""
    body = b""
    views, accessors, meshes, nodes, materials = [], [], [], [], []

    def add(values: AnyArray, target: int, kind: int, shape: str, **bounds: list[float]) -> int:
        nonlocal body
        views.append({"buffer": 0, "byteOffset": len(body), "byteLength": values.nbytes, "target": target})
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": kind, "count": len(values), "type": shape, **bounds}
        )
        body += values.tobytes()
        return len(accessors) - 1

    for k, (name, (_, points, faces)) in enumerate(region_surfaces(mesh).items()):
        xyz = points.astype("<f4")
        place = add(xyz, ARRAY, FLOAT, "VEC3", min=xyz.min(axis=0).tolist(), max=xyz.max(axis=0).tolist())
        index = add(faces.astype("<u4").ravel(), INDEX, UINT, "SCALAR")
        color = COLORS[0] if k == 0 else COLORS[1 + (k - 1) % (len(COLORS) - 1)]
        see_through = {"alphaMode": "BLEND"} if color[3] < 1 else {}
        look = {"baseColorFactor": color, "metallicFactor": 0, "roughnessFactor": 0.8}
        materials.append({"name": name, "pbrMetallicRoughness": look, **see_through})
        meshes.append(
            {"name": name, "primitives": [{"attributes": {"POSITION": place}, "indices": index, "material": k}]}
        )
        nodes.append({"name": name, "mesh": k})
    root = {"name": "patient, mm to m", "matrix": TO_GLTF, "children": list(range(len(nodes)))}
    text = json.dumps(
        {
            "asset": {"version": "2.0", "generator": "palpate"},
            "scene": 0,
            "scenes": [{"nodes": [len(nodes)]}],
            "nodes": [*nodes, root],
            "meshes": meshes,
            "materials": materials,
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{"byteLength": len(body)}],
        }
    ).encode()
    chunks = ((text.ljust(-(-len(text) // 4) * 4), b"JSON"), (body.ljust(-(-len(body) // 4) * 4, b"\0"), b"BIN\0"))
    packed = b"".join(struct.pack("<I4s", len(chunk), kind) + chunk for chunk, kind in chunks)
    path.write_bytes(struct.pack("<4s2I", b"glTF", 2, 12 + len(packed)) + packed)


WRITERS: dict[str, Callable[[Path, TetMesh], None]] = {
    ".stl": write_stl,
    ".ply": write_ply,
    ".obj": write_obj,
    ".glb": write_gltf,
}
