"""NRRD files as 3D Slicer and ITK write them (teem.sourceforge.net/nrrd/format.html)."""

import gzip
import re
from pathlib import Path

import numpy as np

from palpate.arrays import Float64
from palpate.errors import FileError
from palpate.volumes.file_axes import StoredImage
from palpate.volumes.grid_metadata import metadata_text, read_notes
from palpate.volumes.voxel_data import HEADER, read_header, read_voxels, voxels_beside

TYPES = {
    **dict.fromkeys(("signed char", "int8", "int8_t"), "i1"),
    **dict.fromkeys(("uchar", "unsigned char", "uint8", "uint8_t"), "u1"),
    **dict.fromkeys(("short", "short int", "signed short", "int16", "int16_t"), "i2"),
    **dict.fromkeys(("ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"), "u2"),
    **dict.fromkeys(("int", "signed int", "int32", "int32_t"), "i4"),
    **dict.fromkeys(("uint", "unsigned int", "uint32", "uint32_t"), "u4"),
    **dict.fromkeys(("longlong", "long long", "int64", "int64_t"), "i8"),
    "float": "f4",
    "double": "f8",
}
# Sign of each axis on the way to LPS. Without a space the file's own axes are taken as LPS.
SPACES = {
    "left-posterior-superior": (1, 1, 1),
    "lps": (1, 1, 1),
    "right-anterior-superior": (-1, -1, 1),
    "ras": (-1, -1, 1),
    "left-anterior-superior": (1, -1, 1),
    "las": (1, -1, 1),
    "3d-right-handed": (1, 1, 1),
}
PACKED = {"raw": None, "gzip": 31, "gz": 31}  # encodings, and how zlib reads them
VECTOR = re.compile(r"\(([^)]*)\)")


def read(path: Path) -> StoredImage:
    """Raises `FileError` when the file is not NRRD, of a variant we do not read, or ends early."""
    content = read_header(path)
    if not content.startswith(b"NRRD"):
        raise FileError(f"{path}: not an NRRD file (it starts with {content[:8]!r}); check the name")
    end = re.search(rb"\r?\n\r?\n", content)
    if end is None and len(content) == HEADER:
        raise FileError(f"{path}: NRRD header does not end within {HEADER} bytes; export it again")
    fields, notes = _fields(content[: end.start() if end else None].decode("utf-8", "replace"))
    try:
        kind, sizes = np.dtype(TYPES[fields["type"]]), [int(n) for n in fields["sizes"].split()]
        encoding = fields["encoding"]
        segments = {k.split("_")[0] for k in notes if re.fullmatch(r"Segment\d+_LabelValue", k)}
        names = {int(notes[f"{s}_LabelValue"]): notes.get(f"{s}_Name", s) for s in segments}
    except (KeyError, ValueError) as problem:
        raise FileError(f"{path}: NRRD header lacks or garbles {problem}; export it again") from None
    if skips := [k for k in ("line skip", "lineskip", "byte skip", "byteskip") if fields.get(k, "0") != "0"]:
        raise FileError(f"{path}: NRRD field {skips[0]!r} is not read; save it again with its header attached")
    if encoding not in PACKED:
        raise FileError(f"{path}: NRRD encoding {encoding!r} is not read; save it as raw or gzip")
    kind = kind.newbyteorder("<" if fields.get("endian", "little") == "little" else ">")
    beside = fields.get("data file", fields.get("datafile"))
    start = 0 if beside else end.end() if end else len(content)
    home = voxels_beside(path, beside) if beside else path
    values = read_voxels(path, home, start, kind, sizes, PACKED[encoding])
    said = read_notes(notes.get("palpate_notes", ""))
    return StoredImage(values, _affine(path, fields), notes.get("palpate_unit"), names, said)


def write(path: Path, stored: StoredImage) -> None:
    """Inline, gzip; label names as 3D Slicer's segments."""
    kind = {v: k for k, v in (("float", "f4"), ("uint8", "u1"), ("int16", "i2"), ("int32", "i4"))}
    axes = " ".join("({:.17g},{:.17g},{:.17g})".format(*column) for column in stored.affine[:3, :3].T)
    lines = [
        "NRRD0005",
        f"type: {kind[stored.values.dtype.str[1:]]}",
        "dimension: 3",
        "space: left-posterior-superior",
        "sizes: {} {} {}".format(*stored.values.shape[::-1]),
        f"space directions: {axes}",
        "kinds: domain domain domain",
        "endian: little",
        "encoding: gzip",
        "space origin: ({:.17g},{:.17g},{:.17g})".format(*stored.affine[:3, 3]),
    ]
    if stored.unit:
        lines.append(f"palpate_unit:={stored.unit}")
    if stored.notes:
        lines.append(f"palpate_notes:={metadata_text(stored)}")
    for i, (value, name) in enumerate(stored.names.items()):
        s = f"Segment{i}_"
        lines += [f"{s}ID:={s[:-1]}", f"{s}Name:={name}", f"{s}LabelValue:={value}", f"{s}Layer:=0"]
    body = gzip.compress(stored.values.astype(stored.values.dtype.newbyteorder("<")).tobytes(), 4, mtime=0)
    path.write_bytes("\n".join([*lines, "", ""]).encode() + body)


def _fields(header: str) -> tuple[dict[str, str], dict[str, str]]:
    fields, notes = {}, {}
    for line in header.splitlines()[1:]:
        if line.startswith("#"):
            continue
        if ":=" in line:
            key, _, value = line.partition(":=")
            notes[key] = value
        elif ": " in line:
            key, _, value = line.partition(": ")
            fields[key.strip().lower()] = value.strip()
    return fields, notes


def _affine(path: Path, fields: dict[str, str]) -> Float64:
    affine = np.eye(4)
    try:
        if "space directions" in fields:
            vectors = VECTOR.findall(fields["space directions"])
            affine[:3, :3] = np.reshape([float(v) for vector in vectors for v in vector.split(",")], (3, 3)).T
        elif "spacings" in fields:
            affine[:3, :3] = np.diag([float(v) for v in fields["spacings"].split()])
        if origin := VECTOR.search(fields.get("space origin", "")):
            affine[:3, 3] = [float(v) for v in origin[1].split(",")]
    except ValueError as problem:
        raise FileError(f"{path}: NRRD space fields cannot be read ({problem}); export it again") from None
    space = fields.get("space", "lps").lower()
    if space not in SPACES:
        raise FileError(f"{path}: NRRD space {space!r} is not read; save it as left-posterior-superior")
    return np.diag([*SPACES[space], 1.0]) @ affine
