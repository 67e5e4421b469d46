"""Surfaces that lie: .obj, .glb, .gltf."""

import copy
import json
import struct

import numpy as np
from support.ball_surfaces import Gltf, packed, save_obj
from support.brick_meshes import brick

from fuzz.hostile.ways import COMMANDS, MB, VALID, case, deep, grown, pick, special

COMMANDS["obj"] = "mesh NAME -o mesh.vtu --edge 4"
COMMANDS["gltf"] = "mesh NAME -o mesh.vtu --edge 4"
BRICK = brick((2, 2, 2), (20, 20, 20))
LARGE = (2**31, 2**32, 2**40, 10**15)
WRAPPING = (-1, -27, -(2**31), 2**31, 2**32 + 27, 2**63, 2**64 + 27)


# --- OBJ -------------------------------------------------------------------------------------------------------------


def obj(folder, points=BRICK.nodes, faces=BRICK.surface, before="", after=""):
    path = save_obj(folder / "organ.obj", ("lump", points / 2 + 5, BRICK.surface), ("skin", points, faces))
    path.write_text(before + path.read_text() + after)
    return path.name


def obj_with_corner(folder, rng, text):
    """One corner of one face is another text."""
    obj(folder)
    lines = (folder / "organ.obj").read_text().splitlines()
    which = pick(rng, [k for k, line in enumerate(lines) if line.startswith("f ")])
    words = lines[which].split()
    words[int(rng.integers(1, 4))] = str(text)
    lines[which] = " ".join(words)
    (folder / "organ.obj").write_text("\n".join(lines))
    return "organ.obj"


@case("obj", "swelling")
def _(folder, rng):
    obj(folder)
    data = (folder / "organ.obj").read_bytes()
    at = data.index(b"g skin") + 40
    (folder / "organ.obj").write_bytes(data[: at + int(rng.integers(len(data) - at - 12))])
    return "organ.obj"


@case("obj", "special")
def _(folder, rng):
    special(folder / "organ.obj", rng)
    return "organ.obj"


@case("obj", "2^40")
def _(folder, rng):
    number = pick(rng, LARGE)
    return obj_with_corner(folder, rng, number) if rng.random() < 0.5 else obj(folder, after=f"f 1 2 -{number}\n")


@case("obj", "wrapping")
def _(folder, rng):
    if rng.random() < 0.5:
        return obj_with_corner(folder, rng, pick(rng, (0, 2**63, 2**64 + 27, 55, -55, "1e9", "nan", "")))
    return obj(
        folder, after=pick(rng, ("f 0 1 2\n", "f 1\n", "f\n", "f 1//// /2 3\n", "v 1 2\nf 1 2 3", "f 1 2 9e9\n"))
    )


@case("obj", "header")
def _(folder, rng):
    kind, many = int(rng.integers(4)), int(rng.integers(10_000, 60_000))
    if kind == 0:
        obj(folder)
        grown(folder / "organ.obj", 1500 * MB)
        return "organ.obj"
    if kind == 1:  # a statement that goes on and on
        return obj(folder, before="v 1 2 3 \\\n" * many * 10)
    if kind == 2:  # open groups that have no end of names
        return obj(folder, after="".join(f"g {'x' * 20}{i}\nv {i} 0 {i}\nf -1 1 2\n" for i in range(many)))
    return obj(folder, before="f" + " 1" * many * 60 + "\n")


@case("obj", "content")
def _(folder, rng):
    kind = int(rng.integers(4))
    if kind == 0:
        return obj(folder, BRICK.nodes * pick(rng, (1e200, 1e120, 1e300, 0)))
    if kind == 1:
        nodes = BRICK.nodes.copy()
        nodes[rng.integers(len(nodes)), rng.integers(3)] = pick(rng, (np.nan, np.inf, 1e300))
        return obj(folder, nodes)
    if kind == 2:
        return obj(folder, faces=BRICK.surface[: int(rng.integers(1, 20))])
    (folder / "organ.obj").write_text(pick(rng, ("", "\0" * 99, "v 1 2 3\n", "g " + "x" * 5000)))
    return "organ.obj"


# --- glTF ------------------------------------------------------------------------------------------------------------


def made():
    """A mesh that two nodes show, and a third above them."""
    file = Gltf()
    mesh = file.mesh(file.primitive(BRICK.nodes / 1000, BRICK.surface))
    nodes = [file.node(False, name="skin", mesh=mesh)]
    nodes.append(file.node(False, name="lump", mesh=mesh, scale=[0.5] * 3, translation=[0.005] * 3))
    file.node(children=nodes)
    return file


def gltf(folder, rng, change=lambda said: None):
    """The file with another JSON, in one of the three ways to store it."""
    file = copy.deepcopy(made())
    change(file.said)
    name = pick(rng, ("organ.glb", "organ.glb", "organ.gltf", "beside.gltf"))
    file.save(folder / name)
    return name


def wrong_number(rng, numbers):
    """A change of one of the numbers that say where something is, and how much there is of it."""
    kind, key = pick(
        rng,
        (
            ("accessors", "count"),
            ("accessors", "byteOffset"),
            ("accessors", "bufferView"),
            ("accessors", "componentType"),
            ("bufferViews", "buffer"),
            ("bufferViews", "byteOffset"),
            ("bufferViews", "byteLength"),
            ("bufferViews", "byteStride"),
            ("nodes", "mesh"),
        ),
    )
    which, number = int(rng.integers(2)), pick(rng, numbers)
    return lambda said: said[kind][which].update({key: number})


@case("gltf", "swelling")
def _(folder, rng):
    kind = int(rng.integers(3))
    path = made().save(folder / "organ.glb")
    data = path.read_bytes()
    if kind == 0:
        path.write_bytes(data[: -int(rng.integers(1, 500))])
    elif kind == 1:  # one mesh of a thousand corners, shown again and again
        file = made()
        file.numbers(np.zeros(3000, "<u1"), 5121, "SCALAR")
        file.said["meshes"][0]["primitives"] = [{"attributes": {"POSITION": 0}, "indices": 2}] * 100
        file.said["nodes"] += [{"mesh": 0} for _ in range(int(rng.integers(1000, 50_000)))]
        file.said["scenes"][0]["nodes"] = list(range(3, len(file.said["nodes"])))
        file.save(path)
    else:
        made().save(folder / "beside.gltf")
        (folder / "its bytes.bin").write_bytes(made().body[: -int(rng.integers(1, 500))])
        return "beside.gltf"
    return path.name


@case("gltf", "special")
def _(folder, rng):
    name = pick(rng, ("organ.glb", "organ.gltf", "beside.gltf"))
    made().save(folder / name)
    special(folder / ("its bytes.bin" if name == "beside.gltf" else name), rng)
    return name


@case("gltf", "2^40")
def _(folder, rng):
    if rng.random() < 0.7:
        return gltf(folder, rng, wrong_number(rng, LARGE))
    data, at = made().save(folder / "organ.glb").read_bytes(), pick(rng, (8, 12))
    (folder / "organ.glb").write_bytes(data[:at] + struct.pack("<I", pick(rng, (2**31, 2**32 - 1))) + data[at + 4 :])
    return "organ.glb"


@case("gltf", "wrapping")
def _(folder, rng):
    return gltf(folder, rng, wrong_number(rng, (*WRAPPING, "1e9", None, 1.5, True, [], {})))


@case("gltf", "header")
def _(folder, rng):
    kind = int(rng.integers(6))
    if kind == 0:
        text = deep(rng, pick(rng, ("[", '{"nodes":')))
        (folder / "organ.glb").write_bytes(packed((b"JSON", text.encode())))
        return "organ.glb"
    if kind == 1:
        (folder / "organ.gltf").write_text(deep(rng, "[", "", "]"))
        return "organ.gltf"
    if kind == 2:
        return gltf(folder, rng, lambda said: said["nodes"].extend([{}] * int(rng.integers(100_000, 900_000))))
    if kind == 3:
        path = made().save(folder / pick(rng, ("organ.glb", "organ.gltf")))
        grown(path, 1500 * MB)
        if path.suffix == ".glb":  # zeros for JSON
            path.write_bytes(packed((b"JSON", b""), length=1500 * MB)[:12] + struct.pack("<I4s", 1499 * MB, b"JSON"))
            grown(path, 1500 * MB)
        return path.name
    if kind == 4:
        (folder / "organ.gltf").write_text('{"asset":{"version":"2.0"},"nodes":[' + "[]," * 5_000_000 + "[]]}")
        return "organ.gltf"
    names = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "x" * 5000)
    return gltf(folder, rng, lambda said: said.update(extensionsRequired=[pick(rng, names)]))


@case("gltf", "content")
def _(folder, rng):
    kind, bad = int(rng.integers(5)), pick(rng, (np.nan, np.inf, 1e300, "x", None))
    if kind == 0:  # nodes in a circle
        return gltf(folder, rng, lambda said: said["nodes"][int(rng.integers(2))].update(children=[2]))
    if kind == 1:
        key, count = pick(rng, (("scale", 3), ("translation", 3), ("rotation", 4), ("matrix", 16)))
        return gltf(folder, rng, lambda said: said["nodes"][2].update({key: [bad] * count}))
    if kind == 2:
        key = pick(rng, ("nodes", "meshes", "accessors", "bufferViews", "scenes", "asset"))
        return gltf(folder, rng, lambda said: said.update({key: pick(rng, (None, 1, "x", {}, [None], [[]], [1]))}))
    if kind == 3:
        return gltf(folder, rng, lambda said: said["accessors"][0].update(type=pick(rng, ("VEC2", "MAT4", "", 3))))
    text = json.dumps({"asset": {"version": pick(rng, ("1.0", "3.0", 2, None))}})
    (folder / "organ.gltf").write_text(pick(rng, (text, "", "[]", "null", "9" * 5000, '"x"')))
    return "organ.gltf"


VALID["obj"] = obj
VALID["gltf"] = lambda folder: made().save(folder / "organ.glb").name
