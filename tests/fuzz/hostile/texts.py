"""Texts and plain arrays that lie: geometry files (YAML), names of labels (JSON), stacks (.npy, .mat)."""

import io
import json
import struct
import zlib

import numpy as np
import scipy.io

import palpate as pp
from fuzz.hostile.ways import COMMANDS, MB, VALID, case, deep, grown, pick, special, swollen_zlib
from palpate.scans.geometry_template import template

COMMANDS["geometry"] = "scan import stack.npy --geometry NAME -o out.h5"
COMMANDS["names"] = "mesh labels.nii.gz --label organ --names NAME --edge 8 -o out.vtu"
COMMANDS["stack"] = "scan import NAME --geometry plain.yaml -o out.h5"
PLAIN = """
incident: 100
panel: {shape: [4, 5], pitch: [1, 1], centre: [0, 0, 0]}
views: {motion: arc, angles: [-10, 0, 10], radius: 600}
"""
COUNTS = np.full((3, 4, 5), 50.0)
LARGE = ("1e12", "1e308", "1099511627776", "[1099511627776, 5]", "9" * 400)


# --- geometry --------------------------------------------------------------------------------------------------------


def geometry(folder, text):
    np.save(folder / "stack.npy", COUNTS)
    (folder / "plain.yaml").write_text(PLAIN)
    (folder / "geometry.yaml").write_text(text)
    return "geometry.yaml"


@case("geometry", "swelling")
def _(folder, rng):
    """Texts whose aliases stand for more and more."""
    levels, width, kind = int(rng.integers(8, 30)), int(rng.integers(4, 12)), int(rng.integers(4))
    where = pick(rng, ("unmeasured", "panel", "views", "incident", "stack"))
    if kind == 0:
        lists = "".join(
            f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * width if i else ['x'] * width)}]\n" for i in range(levels)
        )
        return geometry(folder, lists + PLAIN + f"{where}x: *a{levels - 1}\n")
    if kind == 1:
        inner = ", ".join(f"&a{i} [{', '.join([f'*a{i - 1}'] * width if i else ['x'] * width)}]" for i in range(levels))
        return geometry(folder, f"incident: [{inner}]\n" + PLAIN.replace("incident: 100\n", ""))
    if kind == 2:  # maps merged into maps
        below = [f"<<: [{', '.join([f'*a{i - 1}'] * width)}]" if i else "x: 1" for i in range(levels)]
        maps = "".join(f"a{i}: &a{i} {{{inner}}}\n" for i, inner in enumerate(below))
        return geometry(folder, maps + PLAIN + f"more: {{<<: *a{levels - 1}}}\n")
    return geometry(
        folder, PLAIN.replace("100", "&a [*a]") if rng.random() < 0.5 else "&a {incident: *a, panel: *a, views: *a}"
    )


@case("geometry", "special")
def _(folder, rng):
    geometry(folder, PLAIN)
    if rng.random() < 0.6:
        special(folder / "geometry.yaml", rng)
        return "geometry.yaml"
    geometry(folder, PLAIN + "dead: dead.txt\n")
    special(folder / "dead.txt", rng)
    return "dead.txt"


@case("geometry", "2^40")
def _(folder, rng):
    word, kind = pick(rng, LARGE), int(rng.integers(5))
    if kind == 0:
        return geometry(folder, PLAIN.replace("[4, 5]", f"[{pick(rng, LARGE[:3])}, 5]"))
    if kind == 1:
        count = int(rng.integers(2**29, 2**40))
        return geometry(folder, PLAIN.replace("[-10, 0, 10]", f"{{first: -10, last: 10, count: {count}}}"))
    if kind == 2:
        return geometry(folder, template("circular").replace("count: ", f"count: {pick(rng, LARGE[:3])} #"))
    if kind == 3:
        return geometry(folder, PLAIN.replace("600", word))
    return geometry(folder, PLAIN + f"stack: {{format: raw, dtype: uint16, shape: [3, {word}, 5]}}\n")


@case("geometry", "wrapping")
def _(folder, rng):
    word = pick(
        rng, ("-1", "4294967300", "18446744073709551620", "-9223372036854775808", "0", "-4", "4.5", ".inf", ".nan")
    )
    kind = int(rng.integers(4))
    if kind == 0:
        return geometry(folder, PLAIN.replace("[4, 5]", f"[{word}, 5]"))
    if kind == 1:
        return geometry(folder, PLAIN.replace("[1, 1]", f"[{pick(rng, ('-1', '0', '.nan', '.inf', '-1e300'))}, 1]"))
    if kind == 2:
        return geometry(folder, PLAIN.replace("[-10, 0, 10]", f"{{first: -10, last: 10, count: {word}}}"))
    return geometry(
        folder,
        PLAIN
        + "stack: {format: raw, dtype: uint16, shape: [3, 4, 5], offset: "
        + f"{pick(rng, ('-1', '.inf', '.nan', '4.5', '-1e300'))}}}\n",
    )


@case("geometry", "header")
def _(folder, rng):
    kind, many = int(rng.integers(5)), int(rng.integers(10**5, 10**6))
    if kind == 0:
        opening, closing = pick(rng, (("[", "]"), ("{a: ", "}"), ("- ", ""), ("? ", "")))
        return geometry(folder, PLAIN + "stack: " + deep(rng, opening, "", closing))
    if kind == 1:
        return geometry(folder, PLAIN + "".join(f"k{i}: {i}\n" for i in range(many)))
    if kind == 2:
        return geometry(folder, PLAIN.replace("100", f"[{', '.join(['1'] * 5 * many)}]"))
    if kind == 3:
        return geometry(folder, PLAIN + pick(rng, ("stack", "units", "values")) + ": " + "x" * 20 * many)
    geometry(folder, PLAIN + "# ")
    grown(folder / "geometry.yaml", 1500 * MB)
    return "geometry.yaml"


@case("geometry", "content")
def _(folder, rng):
    things = (
        "[]",
        "{}",
        "null",
        "true",
        "'x'",
        "2020-01-01",
        "!!binary aGk=",
        "!!set {a}",
        "!!python/object:os.system x",
        "{a: 1}",
    )
    key = pick(rng, ("panel", "views", "incident", "units", "values", "contrast"))
    lines = [line for line in PLAIN.splitlines() if not line.startswith(key)]
    return geometry(folder, "\n".join([*lines, f"{key}: {pick(rng, things)}", ""]))


# --- names of labels -------------------------------------------------------------------------------------------------


def names(folder, text):
    values = np.zeros((16, 16, 16), np.uint8)
    values[3:13, 3:13, 3:13] = 1
    pp.write_labels(folder / "labels.nii.gz", pp.Labels(values, pp.Grid(values.shape, (2, 2, 2)), {1: "organ"}))
    (folder / "names.json").write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    return "names.json"


@case("names", "swelling")
def _(folder, rng):
    text = json.dumps({str(i): "organ" for i in range(1, 200)})
    return names(folder, text[: -int(rng.integers(1, 1000))])


@case("names", "special")
def _(folder, rng):
    names(folder, "{}")
    special(folder / "names.json", rng)
    return "names.json"


@case("names", "2^40")
def _(folder, rng):
    number = pick(rng, (2**40, 2**31, 2**63, 2**64 + 1, 10**30, -(2**40)))
    return names(folder, json.dumps({str(number): "organ"}))


@case("names", "wrapping")
def _(folder, rng):
    key = pick(
        rng, ("-2147483649", "4294967297", "1.5", "nan", "1e3", "0x1", "", "-9223372036854775809", "9" * 5000, "１_")
    )
    return names(folder, json.dumps({key: "organ"}))


@case("names", "header")
def _(folder, rng):
    kind, many = int(rng.integers(4)), int(rng.integers(10**6, 3 * 10**6))
    if kind == 0:
        return names(folder, deep(rng, *pick(rng, (("[", "", "]"), ('{"1":', "1", "}")))))
    if kind == 1:
        return names(folder, json.dumps({str(i): "a" for i in range(many)}))
    if kind == 2:
        return names(folder, '{"1": "' + "x" * (10 * many) + '"}')
    names(folder, '{"1": "organ"}')
    grown(folder / "names.json", 1500 * MB)
    return "names.json"


@case("names", "content")
def _(folder, rng):
    bad = ("[]", "1", "null", '"x"', "[1]", "", b"\xff\xfe", b"\x00" * 99)
    values = ("null", "{}", "[]", "7", "NaN", "true", "1e999", '["organ"]')
    return names(folder, pick(rng, (*bad, *(f'{{"1": {value}}}' for value in values))))


# --- stacks ----------------------------------------------------------------------------------------------------------


def stack(folder, name, content):
    (folder / "plain.yaml").write_text(PLAIN)
    (folder / name).write_bytes(content)
    return name


def npy(folder, shape="(3, 4, 5)", kind="<f8", body=None, pad=118):
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(pad - 1) + "\n"
    body = COUNTS.tobytes() if body is None else body
    return stack(folder, "s.npy", b"\x93NUMPY\x02\x00" + struct.pack("<I", len(head)) + head.encode() + body)


def mat(folder, values=COUNTS, packed=False):
    made = io.BytesIO()
    scipy.io.savemat(made, {"stack": values}, do_compression=packed)
    return bytearray(made.getvalue())


@case("stack", "swelling")
def _(folder, rng):
    kind = int(rng.integers(4))
    if kind == 0:
        return npy(folder, body=COUNTS.tobytes()[: -int(rng.integers(1, 400))])
    plain = bytes(mat(folder))
    if kind == 1:  # an array of 3 GB, packed
        inner = bytearray(plain[128:])
        struct.pack_into("<I", inner, 4, 3 * 2**30)
        struct.pack_into("<I", inner, inner.index(COUNTS.tobytes()[:8]) - 4, 3 * 2**30 - 200)
        packed = swollen_zlib(bytes(inner[: inner.index(COUNTS.tobytes()[:8])]))
        return stack(folder, "s.mat", plain[:128] + struct.pack("<2I", 15, len(packed)) + packed)
    if kind == 2:
        packed = zlib.compress(plain[128:])[: -int(rng.integers(5, 60))]
        return stack(folder, "s.mat", plain[:128] + struct.pack("<2I", 15, len(packed)) + packed)
    return stack(folder, "s.mat", plain[: -int(rng.integers(1, 480))])


@case("stack", "special")
def _(folder, rng):
    name = pick(rng, ("s.npy", "s.mat", "s.tif", "s.raw"))
    stack(folder, name, b"")
    special(folder / name, rng)
    return name


@case("stack", "2^40")
def _(folder, rng):
    if rng.random() < 0.6:
        shape = pick(
            rng, ("(3, 4, 1099511627776)", "(1099511627776, 1, 1)", "(1048576, 1048576, 5)", "(3, 400000000, 5)")
        )
        return npy(folder, shape)
    content = mat(folder)
    at = content.index(struct.pack("<3i", 3, 4, 5))
    struct.pack_into("<3i", content, at, *pick(rng, ((2**14, 2**13, 2**13), (2**30, 2**10, 1), (3, 4, 2**31 - 1))))
    return stack(folder, "s.mat", bytes(content))


@case("stack", "wrapping")
def _(folder, rng):
    if rng.random() < 0.5:
        shape = pick(
            rng,
            (
                "(-3, -4, 5)",
                "(-1, 4, 5)",
                "(18446744073709551619, 4, 5)",
                "(4294967296, 4294967296, 1)",
                "(0, 4, 5)",
                "(3.0, 4, 5)",
            ),
        )
        return npy(folder, shape)
    content = mat(folder)
    at = content.index(struct.pack("<3i", 3, 4, 5))
    struct.pack_into(
        "<3i", content, at, *pick(rng, ((-3, -4, 5), (-1, 4, 5), (2**16, 2**16, 1), (-(2**31), 4, 5), (0, 4, 5)))
    )
    return stack(folder, "s.mat", bytes(content))


@case("stack", "header")
def _(folder, rng):
    kind = int(rng.integers(4))
    if kind == 0:
        return npy(folder, deep(rng, "(", "", ",)"), pad=10)
    if kind == 1:
        return npy(folder, f"({'1, ' * int(rng.integers(33, 3000))})", pad=10)
    if kind == 2:
        return npy(folder, pad=int(rng.integers(2 * 10**4, 9 * 10**6)))
    content = bytes(mat(folder))
    nested = {"a": COUNTS}
    for _ in range(200):
        nested = {"a": nested}
    made = io.BytesIO()
    scipy.io.savemat(
        made, {"stack": np.zeros((2, 2)), **nested} if rng.random() < 0.5 else {"a": np.array([[1, 2]], object)}
    )
    return stack(folder, "s.mat", made.getvalue() or content)


@case("stack", "content")
def _(folder, rng):
    kind = int(rng.integers(4))
    if kind == 0:
        return npy(folder, kind=pick(rng, ("|O", "<U4", "<c16", "|V8", "<M8[s]", "x", "<f99")))
    if kind == 1:
        return npy(folder, body=np.full(60, pick(rng, (np.nan, np.inf, -7.0, 1e300))).tobytes())
    if kind == 2:
        return stack(folder, "s.mat", bytes(mat(folder, np.array([["a", "b"]]))))
    return stack(folder, "s.raw", COUNTS.tobytes()[: int(rng.integers(400))])


VALID["geometry"] = lambda folder: geometry(folder, PLAIN)
VALID["names"] = lambda folder: names(folder, '{"1": "organ"}')
VALID["stack"] = lambda folder: stack(folder, "s.mat", bytes(mat(folder, packed=True)))
