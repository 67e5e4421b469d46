"""Closed surfaces that lie: .stl, .ply. Nothing in them is compressed, so none swells."""

import struct

import numpy as np

from fuzz.hostile.ways import COMMANDS, MB, VALID, case, grown, pick, special

FORMS = ("stl", "ply")
for form in FORMS:
    COMMANDS[form] = "mesh NAME -o organ.vtu --edge 5"
LARGE = (2**31, 2**32, 2**40, 10**15)
WRAPPING = (-1, -13, -(2**31), 2**32 + 12, 2**63, 2**64 + 12, "1e9", "nan", "", "twelve")
POINTS = 20.0 * np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)])  # mm, a cube
FACES = np.array(
    [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6]]
    + [[1, 3, 5], [3, 7, 5]]
)


def stl(path, points=POINTS, faces=FACES, count=None, head=b"cube"):
    corners = points[faces].astype("<f4").reshape(-1, 9)
    rows = b"".join(bytes(12) + row.tobytes() + bytes(2) for row in corners)
    path.write_bytes(head.ljust(80, b"\0") + struct.pack("<I", len(faces) if count is None else count) + rows)
    return path.name


def stl_text(path, points=POINTS, faces=FACES, name="cube"):
    lines = [f"solid {name}"]
    for face in faces:
        corners = "".join(f"vertex {' '.join(map(str, points[i]))}\n" for i in face)
        lines.append(f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet")
    path.write_text("\n".join([*lines, f"endsolid {name}\n"]))
    return path.name


def ply(path, points=POINTS, faces=FACES, **said):
    """said: `points` and `faces` as their numbers are said, `counts` the type of a face's count, `extra` lines."""
    head = {"n": len(points), "m": len(faces), "form": "ascii", "counts": "uchar", "extra": "", **said}
    text = (
        f"ply\nformat {head['form']} 1.0\n{head['extra']}element vertex {head['n']}\nproperty double x\nproperty double y\n"
        f"property double z\nelement face {head['m']}\nproperty list {head['counts']} int vertex_indices\nend_header\n"
    )
    if head["form"] == "ascii":
        rows = [" ".join(map(str, p)) for p in points] + [f"3 {' '.join(map(str, f))}" for f in faces]
        path.write_text(text + "\n".join(rows) + "\n")
    else:
        rows = b"".join(b"\3" + np.asarray(f, "<i4").tobytes() for f in faces)
        path.write_bytes(text.encode() + np.asarray(points, "<f8").tobytes() + rows)
    return path.name


WRITE = {"stl": stl, "ply": ply}
for form in FORMS:
    VALID[form] = lambda folder, form=form: WRITE[form](folder / f"cube.{form}")

    @case(form, "special")
    def _(folder, rng, form=form):
        name = pick(rng, (f"cube.{form}", f"cube.{form.upper()}"))
        special(folder / name, rng)
        return name

    @case(form, "content")
    def _(folder, rng, form=form):
        points, faces = spoilt_surface(rng)
        return WRITE[form](folder / f"cube.{form}", points, faces)


def spoilt_surface(rng):
    """Points and triangles that enclose nothing, or no number of millimetres."""
    points, faces, kind = POINTS.copy(), FACES.copy(), int(rng.integers(7))
    if kind == 0:
        points[rng.integers(8), rng.integers(3)] = pick(rng, (np.nan, np.inf, -np.inf))
    elif kind == 1:
        points *= pick(rng, (1e-30, 1e30))
    elif kind == 2:
        points[:, rng.integers(3)] = 0  # flat
    elif kind == 3:
        faces = faces[:1]
    elif kind == 4:
        faces = np.repeat(faces[:1], 12, axis=0)
    elif kind == 5:
        faces = faces * 0
    else:
        faces = faces[rng.random(12) < 0.4]
    return points, faces


def raw_number(number):
    """What fits 32 bits without a sign."""
    return number % 2**32 if isinstance(number, int) else 2**31 + 1


@case("stl", "2^40")
def _(folder, rng):
    return stl(folder / "cube.stl", count=raw_number(pick(rng, (2**31, 2**32 - 1, 2**40 - 1, 13, 10**9))))


@case("stl", "wrapping")
def _(folder, rng):
    """The number of triangles times 50 bytes, as it would wrap in 32 bits; or numbers that are none."""
    if rng.random() < 0.5:
        return stl(folder / "cube.stl", count=int(rng.integers(1, 50)) * 2**32 // 50 + 12)
    stl_text(folder / "cube.stl")
    text = (folder / "cube.stl").read_text()
    (folder / "cube.stl").write_text(text.replace("20.0", str(pick(rng, ("", "1e400", "nan", "0x14", "20.0 20.0")))))
    return "cube.stl"


@case("stl", "header")
def _(folder, rng):
    path, kind = folder / "cube.stl", int(rng.integers(4))
    if kind == 0:
        path.write_text("solid " + "x" * int(rng.integers(10, 60)) * MB)
    elif kind == 1:
        path.write_text("solid cube\n" * 1_000_000)
    elif kind == 2:
        path.write_bytes(b"solid cube".ljust(int(rng.integers(11, 84)), b"\0"))
    else:
        stl(path)
        grown(path, 1500 * MB)
    return path.name


@case("ply", "2^40")
def _(folder, rng):
    said = pick(rng, ("n", "m"))
    if rng.random() < 0.3:
        return ply(folder / "cube.ply", extra=f"element bare {pick(rng, LARGE)}\n")
    return ply(folder / "cube.ply", form=pick(rng, ("ascii", "binary_little_endian")), **{said: pick(rng, LARGE)})


@case("ply", "wrapping")
def _(folder, rng):
    path, kind = folder / "cube.ply", int(rng.integers(3))
    if kind == 0:
        return ply(path, form=pick(rng, ("ascii", "binary_little_endian")), **{pick(rng, "nm"): pick(rng, WRAPPING)})
    faces = FACES.astype(np.int64)
    faces[rng.integers(12), rng.integers(3)] = pick(rng, (-1, 8, 2**31 - 1, -(2**31)))
    if kind == 1:
        return ply(path, faces=faces, form=pick(rng, ("ascii", "binary_little_endian")))
    ply(path, form="binary_little_endian")
    data = path.read_bytes()
    at = data.index(b"end_header\n") + 11 + 24 * len(POINTS)  # the first face's count
    path.write_bytes(data[:at] + bytes([int(rng.integers(4, 256))]) + data[at + 1 :])
    return path.name


@case("ply", "header")
def _(folder, rng):
    path, kind = folder / "cube.ply", int(rng.integers(6))
    if kind == 0:
        return ply(path, extra=f"comment {'x' * 40 * MB}\n")
    if kind == 1:
        return ply(path, extra="".join(f"element e{i} 1\nproperty float x\n" for i in range(200_000)))
    if kind == 2:
        return ply(path, counts=pick(rng, ("float", "list", "complex", "")))
    if kind == 3:
        path.write_bytes(b"ply\n" + b"comment endless\n" * int(rng.integers(1, 2_000_000)))
        return path.name
    if kind == 4:
        return ply(path, form=pick(rng, ("binary_middle_endian", "", "x" * 100_000)))
    ply(path, form="binary_little_endian")
    data = path.read_bytes()
    path.write_bytes(data[: int(rng.integers(3, len(data)))])
    return path.name
