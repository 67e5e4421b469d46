"""Gmsh text formats that meshio does not support: writes 2.2, reads 1."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from palpate.arrays import AnyArray, Float64, Int64
from palpate.meshes.tet_mesh import TetMesh

LARGEST = 64 * 2**20  # bytes of a Gmsh 1 file, a million elements
TETRAHEDRON = 4  # Gmsh's number of the element with 4 nodes


def write_gmsh(
    path: Path, mesh: TetMesh, node_fields: Mapping[str, AnyArray], tet_fields: Mapping[str, AnyArray]
) -> None:
    """Writes Gmsh 2.2 ASCII; each region is a physical volume that bears its name."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n")
        if mesh.names:
            file.write(f"$PhysicalNames\n{len(mesh.names)}\n")
            for value, name in mesh.names.items():
                plain = name.replace('"', "'").replace("\\", "/")
                file.write(f'3 {value} "{plain}"\n')
            file.write("$EndPhysicalNames\n")
        file.write(f"$Nodes\n{len(mesh.nodes)}\n")
        file.writelines(f"{i} {x!r} {y!r} {z!r}\n" for i, (x, y, z) in enumerate(mesh.nodes.tolist(), 1))
        file.write(f"$EndNodes\n$Elements\n{len(mesh.tets)}\n")
        rows = np.column_stack([mesh.region, mesh.region, mesh.tets + 1]).tolist()
        file.writelines(f"{i} {TETRAHEDRON} 2 {' '.join(map(str, row))}\n" for i, row in enumerate(rows, 1))
        file.write("$EndElements\n")
        for section, fields in (("NodeData", node_fields), ("ElementData", tet_fields)):
            for name, values in fields.items():
                file.writelines(_data(section, name, values))


def _data(section: str, name: str, values: AnyArray) -> Iterator[str]:
    table = values.reshape(len(values), -1)
    # Gmsh knows 1, 3 and 9 numbers a row; the rest is filled with zeros.
    width = next((w for w in (1, 3, 9) if w >= table.shape[1]), table.shape[1])
    table = np.pad(table, ((0, 0), (0, width - table.shape[1])))
    yield f'${section}\n1\n"{name}"\n1\n0.0\n3\n0\n{width}\n{len(table)}\n'
    for i, row in enumerate(table.tolist(), 1):
        yield f"{i} {' '.join(map(repr, row))}\n"
    yield f"$End{section}\n"


def is_gmsh_1(path: Path) -> bool:
    """Whether the file begins as Gmsh 1 did, with $NOD."""
    with path.open("rb") as file:
        return file.read(64).lstrip().startswith(b"$NOD")


def read_gmsh_1(path: Path) -> tuple[Float64, Int64, Int64]:
    """Nodes (N, 3), tets (M, 4) and physical region (M,) of a Gmsh 1 file. Raises `ValueError` if it is damaged."""
    if path.stat().st_size > LARGEST:
        raise ValueError(f"{path.stat().st_size} bytes, {LARGEST} are read of this old format: write it as Gmsh 2 or 4")
    words = (found[0] for found in re.finditer(r"\S+", path.read_text(encoding="ascii", errors="replace")))
    try:
        _expect(words, "$NOD")
        rows = [[float(next(words)) for _ in range(4)] for _ in range(int(next(words)))]
        _expect(words, "$ENDNOD")
        _expect(words, "$ELM")
        tets, region = [], []
        for _ in range(int(next(words))):
            _, kind, physical, _, count = (int(next(words)) for _ in range(5))
            nodes = [int(next(words)) for _ in range(count)]
            if kind == TETRAHEDRON:
                tets.append(nodes)
                region.append(physical)
        _expect(words, "$ENDELM")
    except (StopIteration, RuntimeError):
        raise ValueError("it ends too early") from None
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    number = {int(n): i for i, n in enumerate(table[:, 0])}
    index = [[number.get(n, -1) for n in tet] for tet in tets]
    return table[:, 1:], np.array(index, dtype=np.int64).reshape(-1, 4), np.array(region, dtype=np.int64)


def _expect(words: Iterator[str], word: str) -> None:
    found = next(words)
    if found != word:
        raise ValueError(f"expected {word}, found {found!r}")
