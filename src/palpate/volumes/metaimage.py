"""MetaImage files as ITK writes them: .mha, and .mhd with its voxels in a second file."""

import zlib
from pathlib import Path

import numpy as np

from palpate.arrays import Float64
from palpate.errors import FileError
from palpate.volumes.file_axes import StoredImage
from palpate.volumes.grid_metadata import metadata_text, read_notes
from palpate.volumes.voxel_data import HEADER, read_header, read_voxels, voxels_beside

TYPES = {
    "MET_CHAR": "i1",
    "MET_UCHAR": "u1",
    "MET_SHORT": "i2",
    "MET_USHORT": "u2",
    "MET_INT": "i4",
    "MET_UINT": "u4",
    "MET_LONG_LONG": "i8",
    "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}
LAST = b"ElementDataFile"  # MetaImage's header ends with this key


def read(path: Path) -> StoredImage:
    """Raises `FileError` when the file is not MetaImage, of a variant we do not read, or ends early."""
    content = read_header(path)
    at = content.find(LAST)
    end = content.find(b"\n", at)
    if at < 0 or b"=" not in content[:at]:
        raise FileError(
            f"{path}: not a MetaImage file (no {LAST.decode()} key in its first {HEADER} bytes); check the name"
        )
    end = len(content) if end < 0 else end
    lines = content[:end].decode("latin-1").splitlines()
    fields = {k.strip(): v.strip() for k, _, v in (line.partition("=") for line in lines)}
    local = fields["ElementDataFile"] == "LOCAL"
    home = path if local else voxels_beside(path, fields["ElementDataFile"])
    try:
        sizes = [int(n) for n in fields["DimSize"].split()]
        msb = fields.get("BinaryDataByteOrderMSB", fields.get("ElementByteOrderMSB", "False")).lower() == "true"
        kind = np.dtype(TYPES[fields["ElementType"]]).newbyteorder(">" if msb else "<")
        spacing = _numbers(fields.get("ElementSpacing", fields.get("ElementSize", "1 1 1")), 3)
        origin = _numbers(fields.get("Offset", fields.get("Position", fields.get("Origin", "0 0 0"))), 3)
        # Three numbers an axis: the direction of the first axis, of the second, of the third.
        axes = _numbers(fields.get("TransformMatrix", fields.get("Rotation", "1 0 0 0 1 0 0 0 1")), 9).reshape(3, 3)
        names = {int(k.removeprefix("Label_")): v for k, v in fields.items() if k.startswith("Label_")}
    except (KeyError, ValueError) as problem:
        raise FileError(f"{path}: MetaImage header lacks or garbles {problem}; export it again") from None
    if fields.get("ElementNumberOfChannels", "1") != "1":
        raise FileError(
            f"{path}: expected one number a voxel, got {fields['ElementNumberOfChannels']}; save one channel"
        )
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = axes.T * spacing, origin
    packed = 15 if fields.get("CompressedData", "False").lower() == "true" else None
    values = read_voxels(path, home, end + 1 if local else 0, kind, sizes, packed)
    said = read_notes(fields.get("palpate_notes", ""))
    return StoredImage(values, affine, fields.get("palpate_unit"), names, said)


def write(path: Path, stored: StoredImage) -> None:
    """One file, compressed."""
    body = zlib.compress(stored.values.astype(stored.values.dtype.newbyteorder("<")).tobytes(), 4)
    axes = stored.affine[:3, :3]
    spacing = np.linalg.norm(axes, axis=0)
    fields = {
        "ObjectType": "Image",
        "NDims": "3",
        "BinaryData": "True",
        "BinaryDataByteOrderMSB": "False",
        "CompressedData": "True",
        "CompressedDataSize": str(len(body)),
        "TransformMatrix": _words((axes / spacing).T.ravel()),
        "Offset": _words(stored.affine[:3, 3]),
        "CenterOfRotation": "0 0 0",
        "ElementSpacing": _words(spacing),
        "DimSize": " ".join(str(n) for n in stored.values.shape[::-1]),
        **({"palpate_unit": stored.unit} if stored.unit else {}),
        **({"palpate_notes": metadata_text(stored)} if stored.notes else {}),
        **{f"Label_{value}": name for value, name in stored.names.items()},
        "ElementType": {v: k for k, v in TYPES.items()}[stored.values.dtype.str[1:]],
        "ElementDataFile": "LOCAL",
    }
    path.write_bytes("".join(f"{k} = {v}\n" for k, v in fields.items()).encode() + body)


def _numbers(words: str, count: int) -> Float64:
    numbers = np.array([float(w) for w in words.split()])
    if len(numbers) != count:
        raise ValueError(f"{words!r} ({count} numbers expected)")
    return numbers


def _words(numbers: Float64) -> str:
    return " ".join(f"{v:.17g}" for v in numbers)
