"""Meshes and tissues that lie: .vtu, .msh, .vtk."""

import base64
import json
import re
import shutil
import struct
import zlib

import numpy as np
from support.brick_meshes import brick

from fuzz.hostile.ways import COMMANDS, MB, VALID, case, deep, grown, pick, special, swollen_zlib

COMMANDS["vtu"] = "fit NAME -o tissue.vtu --young 5"
COMMANDS["gmsh"] = "fit NAME -o tissue.vtu --young 5"
COMMANDS["tissue"] = "score record.h5 NAME -o out.html"
BRICK = brick((2, 2, 2), (10, 10, 10))
LARGE = (2**31, 2**32, 2**40, 10**15)
WRAPPING = (-1, -27, -(2**31), 2**31, 2**32 + 27, 2**63, 2**64 + 27, "1e9", "nan", "")


# --- VTK XML ---------------------------------------------------------------------------------------------------------


def array(name, kind, values, packed=None, parts=1, text=None):
    """A DataArray: as text, or, where `packed` is a function of bytes, as that gives them."""
    values = np.asarray(values)
    if packed is None:
        text, form = text or " ".join(map(str, values.ravel().tolist())), "ascii"
    else:
        text, form = packed(values.tobytes()), "binary"
    return f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{parts}" format="{form}">{text}</DataArray>'


def vtu(path, packed=None, extra="", fields="", nodes=BRICK.nodes, tets=BRICK.tets, **changed):
    said = {"points": len(nodes), "cells": len(tets), "texts": {}, "head": "", **changed}
    offsets, types = np.arange(4, 4 * len(tets) + 1, 4), np.full(len(tets), 10)
    offsets, types = said.get("offsets", offsets), said.get("types", types)
    compressor = "" if packed is None else ' compressor="vtkZLibDataCompressor"'
    path.write_text(
        f'<?xml version="1.0"?>{said["head"]}<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian" '
        f'header_type="UInt32"{compressor}><UnstructuredGrid>{fields}'
        f'<Piece NumberOfPoints="{said["points"]}" NumberOfCells="{said["cells"]}">'
        f"<Points>{array('Points', 'Float64', nodes, packed, 3, said['texts'].get('points'))}</Points><Cells>"
        f"{array('connectivity', 'Int64', tets.astype(np.int64), packed, 1, said['texts'].get('tets'))}"
        f"{array('offsets', 'Int64', offsets, packed)}{array('types', 'Int64', types, packed)}"
        f"</Cells>{extra}</Piece></UnstructuredGrid></VTKFile>"
    )
    return path.name


def blocks(data, header=None, stream=None):
    """VTK's compressed array: number of blocks, their size, that of the last, each compressed size; then the streams."""
    stream = zlib.compress(data) if stream is None else stream
    head = struct.pack(f"<{len(header or range(4))}I", *(header or (1, len(data), 0, len(stream))))
    return base64.b64encode(head).decode() + base64.b64encode(stream).decode()


@case("vtu", "swelling")
def _(folder, rng):
    path, kind, count = folder / "mesh.vtu", int(rng.integers(4)), len(BRICK.nodes) * 24
    spoilt = {
        0: lambda data: blocks(data, stream=swollen_zlib(data)) if len(data) == count else blocks(data),
        1: lambda data: blocks(data, stream=zlib.compress(data)[: -int(rng.integers(1, 100))]),
        2: lambda data: blocks(data, (2**31 - 1, len(data), 0, 50)),
        3: lambda data: blocks(data[: -8 * int(rng.integers(1, 9))]),
    }[kind]
    if kind == 0:
        extra = f"<PointData>{array('u', 'Float64', BRICK.nodes, spoilt, 3)}</PointData>"
        return vtu(path, blocks, extra) if rng.random() < 0.5 else vtu(path, spoilt)
    return vtu(path, spoilt)


@case("vtu", "special")
def _(folder, rng):
    name = pick(rng, ("mesh.vtu", "mesh.vtk", "mesh.VTU"))
    special(folder / name, rng)
    return name


@case("vtu", "2^40")
def _(folder, rng):
    path, kind, number = folder / "mesh.vtu", int(rng.integers(4)), pick(rng, LARGE)
    if kind == 0:
        return vtu(path, points=number)
    if kind == 1:
        return vtu(path, cells=number)
    if kind == 2:
        tets = BRICK.tets.astype(np.int64).copy()
        tets[rng.integers(len(tets)), rng.integers(4)] = number
        return vtu(path, tets=tets)
    text = "# vtk DataFile Version 3.0\nx\n{}\nDATASET UNSTRUCTURED_GRID\nPOINTS {} double\n0 0 0\n"
    (folder / "mesh.vtk").write_text(text.format(pick(rng, ("ASCII", "BINARY")), number))
    return "mesh.vtk"


@case("vtu", "wrapping")
def _(folder, rng):
    path, kind, number = folder / "mesh.vtu", int(rng.integers(4)), pick(rng, WRAPPING)
    if kind == 0:
        return vtu(path, points=number)
    if kind == 1:
        return vtu(path, cells=number)
    if kind == 2:
        tets = BRICK.tets.astype(np.int64).copy()
        tets[rng.integers(len(tets)), rng.integers(4)] = pick(rng, (-1, -28, 27, -(2**63), 2**63 - 1, 2**32))
        return vtu(path, tets=tets)
    offsets = np.arange(4, 4 * len(BRICK.tets) + 1, 4)
    offsets[rng.integers(len(offsets) - 1)] = pick(rng, (-1, 2**40, -(2**63), 0))
    return vtu(path, offsets=offsets)


@case("vtu", "header")
def _(folder, rng):
    path, kind = folder / "mesh.vtu", int(rng.integers(5))
    if kind == 0:
        return vtu(path, extra=deep(rng, "<PointData>", "", "</PointData>"))
    if kind == 1:
        entities = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10 if i else "laugh" * 10}">' for i in range(12))
        return vtu(path, head=f"<!DOCTYPE VTKFile [{entities}]>", extra="<PointData>&e11;</PointData>")
    if kind == 2:  # an outer file
        entity = f'<!DOCTYPE VTKFile [<!ENTITY e SYSTEM "{pick(rng, ("/dev/zero", "/etc/passwd"))}">]>'
        return vtu(path, head=entity, extra="<PointData>&e;</PointData>")
    if kind == 3:
        return vtu(path, fields="<FieldData>" + "<a/>" * 600_000 + "</FieldData>")
    vtu(path)
    grown(path, 1500 * MB)
    return path.name


@case("vtu", "content")
def _(folder, rng):
    path = folder / "mesh.vtu"
    return vtu(path, **spoilt_mesh(rng))


def spoilt_mesh(rng):
    """Nodes and tets that are no solid."""
    nodes, tets, kind = BRICK.nodes.copy(), BRICK.tets.copy(), int(rng.integers(6))
    one = int(rng.integers(len(tets)))
    if kind == 0:  # the same tet twice
        return {"tets": np.concatenate([tets, tets[[one]]])}
    if kind == 1:  # the same, its corners in another order
        return {"tets": np.concatenate([tets, tets[[one]][:, [1, 2, 0, 3]]])}
    if kind == 2:
        return {"nodes": nodes * pick(rng, (1e200, 1e120, 1e160, 1e-200, 1e308))}
    if kind == 3:
        nodes[rng.integers(len(nodes)), rng.integers(3)] = pick(rng, (np.nan, np.inf, 1e300))
        return {"nodes": nodes}
    if kind == 4:
        return {"nodes": nodes * (1, 1, 0)}
    tets[one, 1] = tets[one, 0]
    return {"nodes": nodes * (1, 0, 1), "tets": tets}


# --- Gmsh ------------------------------------------------------------------------------------------------------------


def gmsh(path, nodes=BRICK.nodes, tets=BRICK.tets, counts=(None, None), version="2.2 0 8", before="", number=1):
    lines = ["$MeshFormat", version, "$EndMeshFormat", *([before] if before else []), "$Nodes"]
    lines += [str(len(nodes) if counts[0] is None else counts[0])]
    lines += [f"{i} {x!r} {y!r} {z!r}" for i, (x, y, z) in enumerate(nodes.tolist(), number)]
    lines += ["$EndNodes", "$Elements", str(len(tets) if counts[1] is None else counts[1])]
    lines += [f"{i} 4 2 1 1 {' '.join(str(n + 1) for n in tet)}" for i, tet in enumerate(tets.tolist(), 1)]
    path.write_text("\n".join([*lines, "$EndElements", ""]))
    return path.name


def old_gmsh(path, nodes, elements, size=4):
    lines = [
        "$NOD",
        str(nodes),
        *(f"{i} {x} {y} {z}" for i, (x, y, z) in enumerate(BRICK.nodes.tolist(), 1)),
        "$ENDNOD",
    ]
    lines += ["$ELM", str(elements)]
    lines += [f"{i} 4 1 1 {size} {' '.join(str(n + 1) for n in tet)}" for i, tet in enumerate(BRICK.tets.tolist(), 1)]
    path.write_text("\n".join([*lines, "$ENDELM", ""]))
    return path.name


@case("gmsh", "swelling")
def _(folder, rng):
    path, kind = folder / "mesh.msh", int(rng.integers(3))
    if kind == 0:
        gmsh(path)
        path.write_bytes(path.read_bytes()[: -int(rng.integers(20, 2000))])
        return path.name
    if kind == 1:
        counts = [None, None]
        counts[rng.integers(2)] = int(rng.integers(60, 2000))
        return gmsh(path, counts=counts)
    less = int(rng.integers(1, 20))
    return gmsh(path, counts=(len(BRICK.nodes) - less, None))


@case("gmsh", "special")
def _(folder, rng):
    special(folder / "mesh.msh", rng)
    return "mesh.msh"


@case("gmsh", "2^40")
def _(folder, rng):
    path, number = folder / "mesh.msh", pick(rng, LARGE)
    if rng.random() < 0.4:
        return old_gmsh(path, *pick(rng, ((number, 48), (27, number))), size=pick(rng, (4, number)))
    if rng.random() < 0.5:
        tets = BRICK.tets.astype(np.int64).copy()
        tets[rng.integers(len(tets)), rng.integers(4)] = number
        return gmsh(path, tets=tets)
    return gmsh(path, counts=pick(rng, ((number, None), (None, number))))


@case("gmsh", "wrapping")
def _(folder, rng):
    path, number = folder / "mesh.msh", pick(rng, WRAPPING)
    kind = int(rng.integers(4))
    if kind == 0:
        return old_gmsh(path, *pick(rng, ((-1, 48), (27, -1), (27.5, 48), (2**63, 48))))
    if kind == 1:
        return gmsh(path, number=pick(rng, (-5, 2**63, 2**64, -(2**63))))
    if kind == 2:
        tets = BRICK.tets.astype(np.int64).copy()
        tets[rng.integers(len(tets)), rng.integers(4)] = pick(rng, (-2, -30, 27, 2**32))
        return gmsh(path, tets=tets)
    return gmsh(path, counts=pick(rng, ((number, None), (None, number))))


@case("gmsh", "header")
def _(folder, rng):
    path, kind, many = folder / "mesh.msh", int(rng.integers(4)), int(rng.integers(100_000, 300_000))
    if kind == 0:
        names = "\n".join(f'3 {i} "{i}"' for i in range(many))
        return gmsh(path, before=f"$PhysicalNames\n{pick(rng, (2**40, -1, many * 2))}\n{names}\n$EndPhysicalNames")
    if kind == 1:
        return gmsh(path, version=pick(rng, ("9.9 0 8", "2.2 1 8", "2.2 0 2", "x", "", "4.1 0 8", "nan 0 8")))
    if kind == 2:
        path.write_bytes(b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Comments\n")
        grown(path, 1500 * MB)
        return path.name
    path.write_bytes(b"$NOD\n27\n")
    grown(path, 600 * MB)
    return path.name


@case("gmsh", "content")
def _(folder, rng):
    return gmsh(folder / "mesh.msh", **spoilt_mesh(rng))


# --- tissue ----------------------------------------------------------------------------------------------------------


def tissue(folder, text=None, change=None, find=None, by=None):
    """The valid tissue, its text as `change` (of the object in it) or `text` makes it, or one pattern replaced."""
    path = folder / "soft.vtu"
    valid = folder.parent / "valid"
    shutil.copy(valid / "record.h5", folder)
    whole = (valid / "tissue.vtu").read_text()
    found = re.search(r'(<DataArray type="UInt8" Name="palpate" NumberOfTuples=")\d+(" format="ascii">)([\d ]+)', whole)
    if change is not None:
        said = json.loads(bytes(map(int, found[3].split())))
        change(said)
        text = json.dumps(said)
    if text is not None:
        data = " ".join(map(str, text.encode()))
        whole = whole[: found.start()] + found[1] + str(len(text)) + found[2] + data + whole[found.end() :]
    if find is not None:
        assert re.search(find, whole), find
        whole = re.sub(find, by, whole, count=1)
    path.write_text(whole)
    return path.name


def with_array(folder, name, kind, values):
    """The tissue with an array that is another."""
    data = np.asarray(values).tobytes()
    pattern = rf'(<DataArray type="\w+" Name="{name}"(?: NumberOfComponents="\d")? format="binary">\s*)[^<]*'
    header = struct.pack("<4I", 1, len(data), len(data), len(zlib.compress(data)))
    text = base64.b64encode(header).decode() + base64.b64encode(zlib.compress(data)).decode()
    return tissue(folder, find=pattern, by=lambda found: re.sub(r'type="\w+"', f'type="{kind}"', found[1]) + text)


@case("tissue", "swelling")
def _(folder, rng):
    name = pick(rng, ("young", "poisson", "fixed", "error", "region"))
    kind = {"fixed": "UInt8", "region": "Int32"}.get(name, "Float64")
    pattern = rf'(<DataArray type="{kind}" Name="{name}"(?: NumberOfComponents="\d")? format="binary">\s*)[^<]*'
    if rng.random() < 0.5:
        text = blocks(bytes(384), stream=swollen_zlib(bytes(384)))
    else:
        text = blocks(bytes(384), stream=zlib.compress(bytes(384))[: -int(rng.integers(1, 10))])
    return tissue(folder, find=pattern, by=lambda found: found[1] + text)


@case("tissue", "special")
def _(folder, rng):
    tissue(folder)
    special(folder / "soft.vtu", rng)
    return "soft.vtu"


@case("tissue", "2^40")
def _(folder, rng):
    number = pick(rng, LARGE)
    tag = pick(rng, ("NumberOfPoints", "NumberOfCells"))
    if rng.random() < 0.5:
        return tissue(folder, find=rf'{tag}="\d+"', by=f'{tag}="{number}"')
    return with_array(folder, "connectivity", "Int64", np.where(np.arange(192) == 100, number, BRICK.tets.ravel()))


@case("tissue", "wrapping")
def _(folder, rng):
    tag, number = pick(rng, ("NumberOfPoints", "NumberOfCells")), pick(rng, WRAPPING)
    if rng.random() < 0.5:
        return tissue(folder, find=rf'{tag}="\d+"', by=f'{tag}="{number}"')
    number = pick(rng, (-1, -28, 27, -(2**63)))
    return with_array(folder, "connectivity", "Int64", np.where(np.arange(192) == 100, number, BRICK.tets.ravel()))


@case("tissue", "header")
def _(folder, rng):
    kind = int(rng.integers(5))
    if kind == 0:
        return tissue(folder, text=deep(rng, "[", "", "]"))
    if kind == 1:
        return tissue(folder, text=deep(rng, '{"springs":', "1", "}"))
    if kind == 2:
        return tissue(folder, text=pick(rng, ("[]", "1", '"x"', "null", "{}", '{"springs": 1}', "[" * 9, "9" * 5000)))
    if kind == 3:
        return tissue(folder, text='{"a":"' + "x" * int(rng.integers(10**6, 3 * 10**6)) + '"}')
    return tissue(folder, find="<FieldData>", by="<FieldData>" + deep(rng, "<a>", "", "</a>"))


@case("tissue", "content")
def _(folder, rng):
    kind = int(rng.integers(9))
    number = pick(rng, (np.nan, np.inf, -1.0, 0.0))
    if kind == 0:  # the same tet twice: another is gone
        tets = BRICK.tets.astype(np.int64).copy()
        tets[rng.integers(47)] = tets[47]
        return with_array(folder, "connectivity", "Int64", tets)
    if kind == 1:
        return with_array(folder, "Points", "Float64", BRICK.nodes * pick(rng, (1e200, 1e120, 1e160, 1e-200)))
    if kind <= 3:  # all nodes are held, or none
        return with_array(folder, "fixed", "UInt8", np.full(len(BRICK.nodes), int(kind == 2), np.uint8))
    if kind == 4:
        return with_array(folder, "young", "Float64", np.where(np.arange(48) == 9, number, 5))
    if kind == 5:
        return with_array(folder, "poisson", "Float64", np.where(np.arange(48) == 9, pick(rng, (np.nan, -1, 0.7)), 0.4))
    if kind == 6:
        return tissue(folder, change=lambda said: said.update(element=pick(rng, ("P9", 3, None, ["P1"], {}))))
    if kind == 7:
        key = pick(rng, ("law", "rsc", "weights", "rows", "scale"))
        value = pick(rng, ("x", None, [], {}, 1e400, True if key in ("law", "weights", "rows") else "-1"))
        return tissue(folder, change=lambda said: said["springs"].update({key: value}))
    key = pick(rng, ("springs", "report"))
    return tissue(folder, change=lambda said: said.update({key: pick(rng, (1, [], "x", {}, [[]], {"a": 1}, True))}))


VALID["vtu"] = lambda folder: vtu(folder / "mesh.vtu", blocks)
VALID["gmsh"] = lambda folder: gmsh(folder / "mesh.msh")
VALID["tissue"] = tissue
