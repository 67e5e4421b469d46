"""Reads the triangles of glTF 2.0 files, .glb and .gltf: node by node, moved by the nodes' transforms."""

import base64
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.arrays import AnyArray, Float64, Int64, UInt8
from palpate.bounded_read import TEXT, existing_file, parse_json, read_text
from palpate.errors import FileError
from palpate.meshes.surface_formats import FLOAT, TO_GLTF
from palpate.meshes.surface_parts import Part, StoredSurface

MOST = 100_000  # nodes, and primitives of meshes: each takes time, and an organ has few
CORNERS = 15_000_000  # of all triangles; a mesh of few bytes may be there many times
INDICES = {5121: "<u1", 5123: "<u2", 5125: "<u4"}  # glTF's numbers of types
TRIANGLES, STRIP, FAN = 4, 5, 6  # and of ways to draw
HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_")  # extensions that move no point


def read_gltf(path: Path) -> StoredSurface:
    """The surfaces that the file's scene shows, mm in patient space; each primitive is a part, each node an object.

    Lengths in the file are metres, its y is towards the head and its z towards the front, as `write_mesh` writes them.
    Raises `ValueError` and `FileError`.
    """
    file = GltfFile(path)
    found: list[tuple[Part, Float64, dict[str, Any]]] = []
    corners = 0
    for home, (node, placing) in enumerate(file.placed_nodes()):
        mesh = file.entry("meshes", node["mesh"])
        for primitive in _list(mesh, "primitives"):
            corners += file.count_corners(primitive)
            material = file.entry("materials", primitive["material"]) if "material" in primitive else {}
            found.append((Part(home, _name(node) or _name(mesh), _name(material)), placing, primitive))
            if len(found) > MOST or corners > CORNERS:
                raise ValueError(f"more than {MOST:,} primitives or {CORNERS:,} corners of triangles are shown")
    points, triangles, part = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    start = 0
    for number, (_, placing, primitive) in enumerate(found):
        own, faces = file.triangles(primitive)
        points.append(own @ placing[:3, :3].T + placing[:3, 3])
        triangles.append(faces + start)
        part.append(np.full(len(faces), number))
        start += len(own)
    return StoredSurface(
        np.concatenate(points), np.concatenate(triangles), np.concatenate(part), [p for p, *_ in found]
    )


class GltfFile:
    """The JSON of a glTF file, and numbers out of its buffers. What is not as it should be raises `ValueError`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.buffers: dict[int, UInt8] = {}
        text: str | bytes = read_text(path) if path.suffix.lower() == ".gltf" else self._chunks()
        said = parse_json(text)
        if not isinstance(said, dict) or not str(said.get("asset", {}).get("version", "")).startswith("2."):
            raise ValueError("not glTF of version 2")
        self.said: dict[str, Any] = said
        for name in _list(said, "extensionsRequired"):
            if not str(name).startswith(HARMLESS):
                raise ValueError(f"it needs {str(name)[:60]}, which is not read; export it without")
        if len(_list(said, "nodes")) > MOST:
            raise ValueError(f"{len(said['nodes'])} nodes, expected {MOST:,} at most")

    def _chunks(self) -> bytes:
        """The JSON of a .glb, whose other chunk becomes buffer 0."""
        data: UInt8 = np.memmap(self.path, np.uint8, "r")  # textures may be large, and stay on the disk
        magic, version, length = struct.unpack("<4s2I", data[:12].tobytes())
        if (magic, version) != (b"glTF", 2):
            raise ValueError("not binary glTF of version 2")
        if length > len(data):
            raise ValueError(f"it says {length} bytes and holds {len(data)}")
        text, after = self._chunk(data[:length], 12, b"JSON")
        if len(text) > TEXT:
            raise ValueError(f"{len(text)} bytes of JSON, expected {TEXT} at most")
        if after < length:
            self.buffers[0] = self._chunk(data[:length], after, b"BIN\0")[0]
        return text.tobytes()

    @staticmethod
    def _chunk(data: UInt8, at: int, kind: bytes) -> tuple[UInt8, int]:
        length, found = struct.unpack("<I4s", data[at : at + 8].tobytes())
        if found != kind or at + 8 + length > len(data):
            raise ValueError(f"no whole chunk {kind[:4].decode()!r} at byte {at}")
        return data[at + 8 : at + 8 + length], at + 8 + length

    def entry(self, kind: str, number: object) -> dict[str, Any]:
        """The object of that number in one of the file's lists."""
        every = _list(self.said, kind)
        if type(number) is not int or not 0 <= number < len(every) or not isinstance(every[number], dict):
            raise ValueError(f"{kind}: none has the number {str(number)[:30]}")
        one: dict[str, Any] = every[number]
        return one

    def placed_nodes(self) -> Iterator[tuple[dict[str, Any], Float64]]:
        """The scene's nodes that have a mesh, and the transform (4, 4) of each to mm in patient space."""
        every = _list(self.said, "nodes")
        if _list(self.said, "scenes"):
            roots = _list(self.entry("scenes", self.said.get("scene", 0)), "nodes")
        else:
            below = {str(child) for node in every if isinstance(node, dict) for child in _list(node, "children")}
            roots = [number for number in range(len(every)) if str(number) not in below]
        to_mm = np.linalg.inv(np.array(TO_GLTF, dtype=np.float64).reshape(4, 4).T)
        left, seen = [(number, to_mm) for number in reversed(roots)], set()
        while left:
            number, above = left.pop()
            node = self.entry("nodes", number)
            if number in seen:
                raise ValueError(f"node {number} is below two nodes, or below itself")
            seen.add(number)
            placing = above @ _transform(node)
            if "mesh" in node:
                weights = node.get("weights", self.entry("meshes", node["mesh"]).get("weights", []))
                if "skin" in node or np.any(weights) or "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
                    raise ValueError(
                        f"node {number} has a skin, morph targets or instances; apply them, and export again"
                    )
                yield node, placing
            left += [(child, placing) for child in reversed(_list(node, "children"))]

    def count_corners(self, primitive: dict[str, Any]) -> int:
        """How many corners the triangles of a primitive have at most."""
        drawn = primitive.get("mode", TRIANGLES)
        if drawn not in (TRIANGLES, STRIP, FAN):
            return 0
        number = primitive.get("indices", primitive["attributes"]["POSITION"])
        return _size(self.entry("accessors", number), "count") * (1 if drawn == TRIANGLES else 3)

    def triangles(self, primitive: dict[str, Any]) -> tuple[Float64, Int64]:
        """Points (N, 3) and triangles (F, 3) of a primitive; none if it draws points or lines."""
        mode = primitive.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN):
            return np.empty((0, 3)), np.empty((0, 3), np.int64)
        points = self._numbers(primitive["attributes"]["POSITION"], "VEC3", {FLOAT: "<f4"})
        if "indices" in primitive:
            corners = self._numbers(primitive["indices"], "SCALAR", INDICES)[:, 0].astype(np.int64)
        else:
            corners = np.arange(len(points))
        if len(corners) and corners.max() >= len(points):
            raise ValueError(f"a triangle names point {corners.max()}, but there are {len(points)}")
        if mode == TRIANGLES and len(corners) % 3:
            raise ValueError(f"triangles of {len(corners)} corners")
        if mode == TRIANGLES:
            faces = corners.reshape(-1, 3)
        else:
            first = corners[:-2] if mode == STRIP else np.broadcast_to(corners[:1], corners[2:].shape)
            faces = np.stack([first, corners[1:-1], corners[2:]], axis=1)
        used, index = np.unique(faces, return_inverse=True)
        return points[used].astype(np.float64), index.reshape(faces.shape).astype(np.int64)

    def _numbers(self, number: object, shape: str, types: dict[int, str]) -> AnyArray:
        """The values (N, k) of an accessor."""
        accessor = self.entry("accessors", number)
        if accessor.get("type") != shape or accessor.get("componentType") not in types or "sparse" in accessor:
            raise ValueError(f"accessor {number} is no plain {shape} of a type that belongs here")
        view = self.entry("bufferViews", accessor.get("bufferView"))
        kind = np.dtype(types[accessor["componentType"]])
        width = kind.itemsize * (3 if shape == "VEC3" else 1)
        count, offset, stride = (
            _size(accessor, "count"),
            _size(accessor, "byteOffset", 0),
            _size(view, "byteStride", width),
        )
        start, length = _size(view, "byteOffset", 0), _size(view, "byteLength")
        buffer = self._buffer(view.get("buffer"))
        if start + length > len(buffer):
            raise ValueError(f"a view of bytes {start} to {start + length} in a buffer of {len(buffer)}")
        if stride < width or offset + max(count - 1, 0) * stride + min(count, 1) * width > length:
            raise ValueError(f"accessor {number} says {count} values of {stride} bytes in a view of {length}")
        return np.ndarray((count, width // kind.itemsize), kind, buffer[start:], offset, (stride, kind.itemsize))

    def _buffer(self, number: object) -> UInt8:
        """The bytes of a buffer: in the .glb, in the JSON, or in a file beside."""
        said = self.entry("buffers", number)
        assert isinstance(number, int)
        if number not in self.buffers or "uri" in said:
            self.buffers[number] = self._of_uri(said.pop("uri", None))
        if _size(said, "byteLength") > len(self.buffers[number]):
            raise ValueError(f"buffer {number} says {said['byteLength']} bytes and holds {len(self.buffers[number])}")
        return self.buffers[number]

    def _of_uri(self, uri: object) -> UInt8:
        if not isinstance(uri, str):
            raise ValueError("a buffer that is nowhere")
        head, comma, text = uri.partition(",")
        if head.startswith("data:") and head.endswith(";base64") and comma:
            return np.frombuffer(base64.b64decode(text, validate=True), np.uint8)
        beside = Path(unquote(uri))
        if ":" in uri or beside.is_absolute() or ".." in beside.parts or len(uri) > 1000:
            raise ValueError(f"a buffer in {uri[:60]!r}, which is no file beside or below it")
        try:
            data: UInt8 = np.memmap(existing_file(self.path.parent / beside), np.uint8, "r")
        except FileError as problem:
            raise ValueError(f"its buffer is missing, {problem}") from None
        return data


def _list(thing: dict[str, Any], key: str) -> list[Any]:
    every = thing.get(key, [])
    if not isinstance(every, list):
        raise ValueError(f"{key} is no list")
    return every


def _size(thing: dict[str, Any], key: str, otherwise: int | None = None) -> int:
    """A whole number from 0 on."""
    value = thing.get(key, otherwise)
    if type(value) is not int or value < 0:
        raise ValueError(f"{key}: expected a number of bytes or values, got {str(value)[:30]}")
    return value


def _name(thing: dict[str, Any]) -> str:
    name = thing.get("name", "")
    return name if isinstance(name, str) else ""


def _transform(node: dict[str, Any]) -> Float64:
    """(4, 4) from a node's coordinates to those of the node above."""
    if "matrix" in node:
        matrix: Float64 = np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
        if not np.array_equal(matrix[3], [0, 0, 0, 1]):
            raise ValueError("a node's matrix is no affine transform")
        return matrix
    placing = np.eye(4)
    if "rotation" in node:
        placing[:3, :3] = Rotation.from_quat(np.array(node["rotation"], dtype=np.float64).reshape(4)).as_matrix()
    placing[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), dtype=np.float64).reshape(3)
    placing[:3, 3] = np.array(node.get("translation", (0, 0, 0)), dtype=np.float64).reshape(3)
    return placing
