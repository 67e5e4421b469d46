"""MetaImage files (.mha, and .mhd with its voxels in a second file), the way ITK writes them."""

import zlib
from pathlib import Path

import numpy as np

from palpate.arrays import Float64
from palpate.errors import FileError
from palpate.volumes.stored import Stored

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


def read(path: Path) -> Stored:
    """Raises `FileError` when the file is not MetaImage, of a variant we do not read, or ends early."""
    content = path.read_bytes()
    at = content.find(LAST)
    end = content.find(b"\n", at)
    if at < 0 or b"=" not in content[:at]:
        raise FileError(f"{path}: not a MetaImage file (no {LAST.decode()} key); check the name")
    end = len(content) if end < 0 else end
    lines = content[:end].decode("latin-1").splitlines()
    fields = {k.strip(): v.strip() for k, _, v in (line.partition("=") for line in lines)}
    beside, body = fields["ElementDataFile"], content[end + 1 :]
    if beside != "LOCAL":
        if not (path.parent / beside).is_file():
            raise FileError(f"{path}: its voxels {beside} are not beside it; put both files in one folder")
        body = (path.parent / beside).read_bytes()
    try:
        sizes = [int(n) for n in fields["DimSize"].split()]
        msb = fields.get("BinaryDataByteOrderMSB", fields.get("ElementByteOrderMSB", "False")).lower() == "true"
        kind = np.dtype(TYPES[fields["ElementType"]]).newbyteorder(">" if msb else "<")
        spacing = _numbers(fields.get("ElementSpacing", fields.get("ElementSize", "1 1 1")), 3)
        origin = _numbers(fields.get("Offset", fields.get("Position", fields.get("Origin", "0 0 0"))), 3)
        # Three numbers an axis: the direction of the first axis, of the second, of the third.
        axes = _numbers(fields.get("TransformMatrix", fields.get("Rotation", "1 0 0 0 1 0 0 0 1")), 9).reshape(3, 3)
    except (KeyError, ValueError) as problem:
        raise FileError(f"{path}: MetaImage header lacks or garbles {problem}; export it again") from None
    if len(sizes) != 3 or fields.get("ElementNumberOfChannels", "1") != "1":
        raise FileError(f"{path}: expected 3 axes of one number a voxel, got DimSize {sizes}; save one volume a file")
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = axes.T * spacing, origin
    if fields.get("CompressedData", "False").lower() == "true":
        try:
            body = zlib.decompress(body)
        except zlib.error as problem:
            raise FileError(f"{path}: compressed voxels are cut short or damaged ({problem}); copy it again") from None
    wanted = int(np.prod(sizes)) * kind.itemsize
    if len(body) < wanted:
        raise FileError(f"{path}: truncated: {len(body)} bytes of voxels, {wanted} expected; copy it again")
    names = {int(k.removeprefix("Label_")): v for k, v in fields.items() if k.startswith("Label_")}
    values = np.frombuffer(body, kind, int(np.prod(sizes))).reshape(sizes[::-1])
    return Stored(values, affine, fields.get("palpate_unit"), names)


def write(path: Path, stored: Stored) -> None:
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
