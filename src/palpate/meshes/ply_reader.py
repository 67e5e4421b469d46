"""Reads the points and faces of PLY files, text or binary, whatever other properties they have."""

import re
from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np

from palpate.arrays import AnyArray, Float64, Int64

HEADER = 2**16  # bytes
TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
Take = Callable[[str, int], AnyArray]  # the next numbers of a type


def read_ply(path: Path) -> tuple[Float64, list[AnyArray], Int64, dict[int, str]]:
    """Points (N, 3), the corners of each face, its `region` (0 without), and names of regions. Raises `ValueError`.

    Names stand in comments: "comment region 2: lump".
    """
    with path.open("rb") as file:
        found = re.search(rb"end_header\r?\n", file.read(HEADER))
        if found is None:
            raise ValueError(f"no end of its header within {HEADER} bytes")
        file.seek(0)
        words = [
            line.split() for line in file.read(found.end()).decode("utf-8", "replace").splitlines() if line.split()
        ]
        body = file.read()
    if words[0] != ["ply"]:
        raise ValueError("its first word is not ply")
    elements: list[tuple[str, int, list[list[str]]]] = []
    for line in words:
        if line[0] == "element":
            elements.append((line[1], int(line[2]), []))
        elif line[0] == "property":
            elements[-1][2].append(line[1:])
    order = ORDERS[next(line[1] for line in words if line[0] == "format")]
    take = _binary(body, order) if order else _text(body)
    points, faces, region = np.empty((0, 3)), [], None
    named = [line for line in words if len(line) > 3 and line[:2] == ["comment", "region"] and line[2][:-1].isdigit()]
    for name, count, properties in elements:
        if not 0 <= count <= len(body):
            raise ValueError(f"it says {count} of {name}, and {len(body)} bytes follow its header")
        columns = _columns(take, count, properties)
        if name == "vertex":
            points = np.column_stack([np.asarray(columns[axis], dtype=np.float64) for axis in "xyz"])
        elif name == "face":
            faces = columns.get("vertex_indices") or columns["vertex_index"]
            region = columns.get("region")
    solid = np.zeros(len(faces), np.int64) if region is None else np.asarray(region, dtype=np.int64)
    return points, faces, solid, {int(line[2][:-1]): " ".join(line[3:]) for line in named}


def _columns(take: Take, count: int, properties: list[list[str]]) -> dict[str, list[AnyArray]]:
    """The values of an element's properties by name: a number, or the numbers of a list, for each of its rows."""
    rows: dict[str, list[AnyArray]] = {words[-1]: [] for words in properties}
    for _ in range(count if properties else 0):
        for words in properties:
            if words[0] == "list":
                rows[words[-1]].append(take(TYPES[words[2]], int(take(TYPES[words[1]], 1)[0])))
            else:
                rows[words[-1]].append(take(TYPES[words[0]], 1)[0])
    return rows


def _binary(body: bytes, order: str) -> Take:
    at = 0
    types = {kind: np.dtype(order + kind) for kind in TYPES.values()}

    def take(kind: str, count: int) -> AnyArray:
        nonlocal at
        if count < 0:  # NumPy would take all that is left
            raise ValueError(f"a list of {count}")
        values = np.frombuffer(body, types[kind], count, at)
        at += values.nbytes
        return values

    return take


def _text(body: bytes) -> Take:
    words = re.finditer(rb"\S+", body)

    def take(kind: str, count: int) -> AnyArray:
        found = [float(word[0]) for word in islice(words, count)]
        if len(found) < count:
            raise ValueError("it ends too early")
        return np.array(found).astype(kind)

    return take
