"""Closed surfaces of balls, and files of several surfaces as other programs write them."""

import base64
import json
import struct

import numpy as np
from skimage.measure import marching_cubes


def ball(radius=1.0, steps=14):
    """Points and triangles of a sphere's isosurface, closed, normals outwards."""
    x = np.linspace(-1.3, 1.3, 2 * steps)
    far = np.linalg.norm(np.stack(np.meshgrid(x, x, x, indexing="ij")), axis=0)
    points, faces, *_ = marching_cubes(-far, -1.0)
    return radius * (points * (x[1] - x[0]) - 1.3), faces.astype(np.int64)


def save_obj(path, *parts, word="g"):
    """An OBJ with a statement (`g`, `o` or whole lines) before the faces of each part: (name, points, faces)."""
    lines, start = [], 1
    for name, points, faces in parts:
        lines += [f"v {x} {y} {z}" for x, y, z in points.tolist()]
        lines += [f"{word} {name}"] if word else name.splitlines()
        lines += [f"f {a} {b} {c}" for a, b, c in (faces + start).tolist()]
        start += len(points)
    path.write_text("\n".join(lines) + "\n")
    return path


class Gltf:
    """A glTF 2.0 file in the making: a scene without nodes."""

    def __init__(self):
        self.body = b""
        lists = ("nodes", "meshes", "materials", "accessors", "bufferViews")
        self.said = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], **{key: [] for key in lists}}

    def numbers(self, values, kind, shape):
        """The number of an accessor for an array."""
        self.body += bytes(-len(self.body) % 4)
        self.said["bufferViews"].append({"buffer": 0, "byteOffset": len(self.body), "byteLength": values.nbytes})
        view = len(self.said["bufferViews"]) - 1
        self.body += values.tobytes()
        self.said["accessors"].append({"bufferView": view, "componentType": kind, "count": len(values), "type": shape})
        return len(self.said["accessors"]) - 1

    def primitive(self, points, faces, **more):
        place = self.numbers(points.astype("<f4"), 5126, "VEC3")
        return {
            "attributes": {"POSITION": place},
            "indices": self.numbers(faces.astype("<u4").ravel(), 5125, "SCALAR"),
        } | more

    def mesh(self, *primitives, **more):
        self.said["meshes"].append({"primitives": list(primitives), **more})
        return len(self.said["meshes"]) - 1

    def node(self, root=True, **said):
        self.said["nodes"].append(said)
        number = len(self.said["nodes"]) - 1
        if root:
            self.said["scenes"][0]["nodes"].append(number)
        return number

    def save(self, path):
        """A .glb, or a .gltf with its bytes inside; in "its bytes.bin" if the name ends with "beside"."""
        said = {**self.said, "buffers": [{"byteLength": len(self.body)}]}
        if path.suffix == ".glb":
            text = json.dumps(said).encode()
            path.write_bytes(packed((b"JSON", text.ljust(-(-len(text) // 4) * 4)), (b"BIN\0", self.body)))
        elif path.stem.endswith("beside"):
            (path.parent / "its bytes.bin").write_bytes(self.body)
            said["buffers"][0]["uri"] = "its%20bytes.bin"
        else:
            data = base64.b64encode(self.body).decode()
            said["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{data}"
        if path.suffix == ".gltf":
            path.write_text(json.dumps(said))
        return path


def packed(*chunks, length=None):
    """The bytes of a .glb from its chunks: (kind, bytes)."""
    body = b"".join(struct.pack("<I4s", len(data), kind) + data for kind, data in chunks)
    return struct.pack("<4s2I", b"glTF", 2, 12 + len(body) if length is None else length) + body
