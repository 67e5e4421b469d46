"""Reads the points and faces of Wavefront OBJ files, with the objects and groups that faces belong to."""

from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from palpate.meshes.line_file import LONGEST, LineFile
from palpate.meshes.surface_parts import Part, StoredSurface, fans


def read_obj(path: Path) -> StoredSurface:
    """The surface of an OBJ file; each `o` and each `g` begins a part. Raises `ValueError`.

    Normals, texture, materials, lines and curves are left out.
    """
    points, corners, lengths, part = array("d"), array("q"), array("q"), array("q")
    parts = [Part(0, "", "")]
    with LineFile(path) as file:
        for line in _statements(file):
            word, *rest = line.split()
            if word == b"v":
                if len(rest) < 3:
                    raise ValueError(f"a point of {len(rest)} numbers")
                points.extend(float(number) for number in rest[:3])
            elif word == b"f":
                if len(rest) < 3:
                    raise ValueError(f"a face of {len(rest)} corners")
                corners.extend(_corner(text, len(points) // 3) for text in rest)
                lengths.append(len(rest))
                part.append(len(parts) - 1)
            elif word in (b"o", b"g"):
                name = b" ".join(rest).decode("utf-8", "replace")
                last = parts[-1]
                new = Part(last.home + 1, name, last.name) if word == b"o" else last._replace(name=name)
                if part and part[-1] == len(parts) - 1:
                    parts.append(new)
                else:  # the part before has no face
                    parts[-1] = new
    triangles, face = fans(np.array(corners, np.int64), np.array(lengths, np.int64))
    return StoredSurface(np.array(points).reshape(-1, 3), triangles, np.array(part, np.int64)[face], parts)


def _statements(file: LineFile) -> Iterator[bytes]:
    """Lines that hold something; one that ends with a backslash goes on in the next."""
    begun = b""
    for line in iter(file.readline, b""):
        whole = begun + line.strip()
        if len(whole) > LONGEST:
            raise ValueError(f"a statement of more than {LONGEST} bytes")
        begun = whole[:-1] + b" " if whole.endswith(b"\\") else b""
        if whole and not begun and not whole.startswith(b"#"):
            yield whole


def _corner(text: bytes, count: int) -> int:
    """The index from 0 of a corner such as 7, 7/1/3 or -1, the point before; -1 for 0, which names none."""
    number = int(text.partition(b"/")[0])
    return number - 1 if number >= 0 else max(count + number, -1)
