"""NRRD, MetaImage and NIfTI files that lie."""

import gzip
import struct
import zlib

import numpy as np

from fuzz.hostile.ways import COMMANDS, MB, VALID, case, grown, pick, special, swollen_gzip, swollen_zlib

for _form in ("nrrd", "metaimage", "nifti"):
    COMMANDS[_form] = "segment NAME -o out.nii.gz --lower 50 --upper 400"

SHAPE = (6, 8, 9)  # x, y, z
BODY = np.arange(np.prod(SHAPE), dtype="<f4").tobytes()
TOO_LARGE = ((2**40, 1, 1), (2**20, 2**20, 1), (2**14, 2**13, 2**13), (1, 2**40, 2**40), (10**5, 10**5, 110))
WRAPPING = (
    (-1, 8, 9),
    (-6, -8, 9),
    (2**32, 2**32, 1),
    (2**63, 2, 1),
    (2**64 + 6, 8, 9),
    (0, 8, 9),
    (2**62, 2**62, 16),
    (-(2**63), 8, 9),
    (2**31, 2**31, 4),
    (6, 8, -9),
)
NOT_NUMBERS = ("nan", "inf", "1e400", "1e200", "abc", "", "0x10", "1,2", "１２", "-0", "9" * 400)


# --- NRRD ------------------------------------------------------------------------------------------------------------


def nrrd(path, body=BODY, extra="", **changed):
    fields = {
        "type": "float",
        "dimension": 3,
        "space": "left-posterior-superior",
        "sizes": "6 8 9",
        "space directions": "(1,0,0) (0,1,0) (0,0,1)",
        "endian": "little",
        "encoding": "raw",
        "space origin": "(0,0,0)",
    }
    fields |= {key.replace("_", " "): value for key, value in changed.items()}
    lines = ["NRRD0005", *(f"{key}: {value}" for key, value in fields.items() if value is not None)]
    path.write_bytes(("\n".join(lines) + "\n" + extra).encode() + b"\n" + body)
    return path.name


@case("nrrd", "swelling")
def _(folder, rng):
    path, kind = folder / "v.nrrd", int(rng.integers(5))
    if kind == 0:
        return nrrd(path, swollen_gzip(BODY), encoding="gzip")
    if kind == 1:
        (folder / "beside.gz").write_bytes(swollen_gzip(BODY))
        return nrrd(folder / "v.nhdr", b"", encoding="gz", data_file="beside.gz")
    if kind == 2:
        return nrrd(path, gzip.compress(BODY)[: -int(rng.integers(1, 300))], encoding="gzip")
    if kind == 3:
        return nrrd(path, gzip.compress(BODY[: -4 * int(rng.integers(1, 400))]), encoding="gzip")
    return nrrd(path, BODY[: -int(rng.integers(1, 1700))])


@case("nrrd", "special")
def _(folder, rng):
    if rng.random() < 0.5:
        special(folder / "v.nrrd", rng)
        return "v.nrrd"
    special(folder / "beside.raw", rng)
    return nrrd(folder / "v.nhdr", b"", data_file="beside.raw")


@case("nrrd", "2^40")
def _(folder, rng):
    sizes = " ".join(map(str, rng.permutation(np.array(pick(rng, TOO_LARGE), dtype=object))))
    if rng.random() < 0.5:
        return nrrd(folder / "v.nrrd", gzip.compress(BODY), sizes=sizes, encoding="gzip")
    return nrrd(folder / "v.nrrd", sizes=sizes)


@case("nrrd", "wrapping")
def _(folder, rng):
    sizes = " ".join(map(str, pick(rng, WRAPPING)))
    body, encoding = (BODY, "raw") if rng.random() < 0.5 else (gzip.compress(BODY), "gzip")
    return nrrd(folder / "v.nrrd", body, sizes=sizes, encoding=encoding)


@case("nrrd", "header")
def _(folder, rng):
    path, kind, many = folder / "v.nrrd", int(rng.integers(4)), int(rng.integers(200_000, 600_000))
    if kind == 0:  # a header that does not end
        path.write_bytes(b"NRRD0005\ntype: float\n# ")
        grown(path, 1500 * MB)
        return path.name
    if kind == 1:
        return nrrd(path, extra="# nothing\n" * (10 * many))
    if kind == 2:
        return nrrd(path, extra="".join(f"Segment{i}_LabelValue:={i}\n" for i in range(many)))
    return nrrd(path, extra="note:=" + "x" * (50 * many) + "\n")


@case("nrrd", "content")
def _(folder, rng):
    path, kind, word = folder / "v.nrrd", int(rng.integers(5)), pick(rng, NOT_NUMBERS[:5])
    if kind == 0:
        return nrrd(path, space_directions=f"({word},0,0) (0,1,0) (0,0,1)")
    if kind == 1:
        return nrrd(path, space_origin=f"(0,{word},0)")
    if kind == 2:
        return nrrd(path, extra=f"Segment0_LabelValue:={word}\n")
    if kind == 3:
        return nrrd(path, type=pick(rng, ("block", "complex", "", "float float", None)))
    return nrrd(path, np.full(SHAPE, pick(rng, (np.nan, np.inf)), "<f4").tobytes())


# --- MetaImage -------------------------------------------------------------------------------------------------------


def metaimage(path, body=BODY, extra="", **changed):
    fields = {
        "ObjectType": "Image",
        "NDims": 3,
        "BinaryData": True,
        "CompressedData": False,
        "TransformMatrix": "1 0 0 0 1 0 0 0 1",
        "Offset": "0 0 0",
        "ElementSpacing": "1 1 1",
        "DimSize": "6 8 9",
        "ElementType": "MET_FLOAT",
    }
    beside = changed.pop("ElementDataFile", "LOCAL")
    lines = [f"{key} = {value}\n" for key, value in (fields | changed).items() if value is not None]
    path.write_bytes(("".join(lines) + extra + f"ElementDataFile = {beside}\n").encode() + body)
    return path.name


@case("metaimage", "swelling")
def _(folder, rng):
    path, kind = folder / "v.mha", int(rng.integers(5))
    if kind == 0:
        return metaimage(path, swollen_zlib(BODY), CompressedData=True)
    if kind == 1:
        (folder / "beside.zraw").write_bytes(swollen_zlib(BODY))
        return metaimage(folder / "v.mhd", b"", CompressedData=True, ElementDataFile="beside.zraw")
    if kind == 2:
        return metaimage(path, zlib.compress(BODY)[: -int(rng.integers(1, 300))], CompressedData=True)
    if kind == 3:
        return metaimage(path, zlib.compress(BODY[: -4 * int(rng.integers(1, 400))]), CompressedData=True)
    return metaimage(path, BODY[: -int(rng.integers(1, 1700))])


@case("metaimage", "special")
def _(folder, rng):
    if rng.random() < 0.5:
        special(folder / "v.mha", rng)
        return "v.mha"
    special(folder / "beside.raw", rng)
    return metaimage(folder / "v.mhd", b"", ElementDataFile="beside.raw")


@case("metaimage", "2^40")
def _(folder, rng):
    sizes = " ".join(map(str, rng.permutation(np.array(pick(rng, TOO_LARGE), dtype=object))))
    if rng.random() < 0.5:
        return metaimage(folder / "v.mha", zlib.compress(BODY), DimSize=sizes, CompressedData=True)
    return metaimage(folder / "v.mha", DimSize=sizes)


@case("metaimage", "wrapping")
def _(folder, rng):
    packed = rng.random() < 0.5
    body = zlib.compress(BODY) if packed else BODY
    return metaimage(folder / "v.mha", body, DimSize=" ".join(map(str, pick(rng, WRAPPING))), CompressedData=packed)


@case("metaimage", "header")
def _(folder, rng):
    path, kind, many = folder / "v.mha", int(rng.integers(4)), int(rng.integers(200_000, 600_000))
    if kind == 0:
        path.write_bytes(b"ObjectType = Image\nComment = ")
        grown(path, 1500 * MB)
        return path.name
    if kind == 1:
        return metaimage(path, extra="Comment = nothing\n" * (10 * many))
    if kind == 2:
        return metaimage(path, extra="".join(f"Label_{i} = {i}\n" for i in range(many)))
    return metaimage(path, extra="Comment = " + "x" * (50 * many) + "\n")


@case("metaimage", "content")
def _(folder, rng):
    path, kind, word = folder / "v.mha", int(rng.integers(5)), pick(rng, NOT_NUMBERS[:5])
    if kind == 0:
        return metaimage(path, ElementSpacing=f"1 {word} 1")
    if kind == 1:
        return metaimage(path, Offset=f"0 0 {word}")
    if kind == 2:
        return metaimage(path, extra=f"Label_{word} = organ\n")
    if kind == 3:
        return metaimage(path, ElementType=pick(rng, ("MET_STRING", "MET_NONE", "", None)))
    return metaimage(path, np.full(SHAPE, pick(rng, (np.nan, np.inf)), "<f4").tobytes())


# --- NIfTI -----------------------------------------------------------------------------------------------------------


def nifti(path, body=BODY, dim=(3, 6, 8, 9, 1, 1, 1, 1), offset=352, extension=bytes(4), kind=16, bits=32, **floats):
    header = bytearray(348)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, *dim)
    struct.pack_into("<2h", header, 70, kind, bits)
    struct.pack_into("<8f", header, 76, 1, *floats.get("spacing", (1, 1, 1)), 1, 1, 1, 1)
    struct.pack_into("<3f", header, 108, offset, *floats.get("slope", (1, 0)))
    struct.pack_into("<2hB", header, 252, 0, 1, 0)
    rows = np.hstack([np.diag(floats.get("spacing", (1, 1, 1))), np.reshape(floats.get("origin", (0, 0, 0)), (3, 1))])
    struct.pack_into("<12f", header, 280, *rows.ravel())
    header[123], header[344:348] = 2, b"n+1\0"
    content = bytes(header) + extension + body
    path.write_bytes(gzip.compress(content, 1) if path.suffix == ".gz" else content)
    return path.name


def nifti2(path, dim, body=BODY, offset=544):
    header = bytearray(540)
    struct.pack_into("<i", header, 0, 540)
    header[4:12] = b"n+2\0\r\n\x1a\n"
    struct.pack_into("<2h", header, 12, 16, 32)
    struct.pack_into("<8q", header, 16, *dim)
    struct.pack_into("<8d", header, 104, *[1.0] * 8)
    struct.pack_into("<q2d", header, 168, offset, 1, 0)
    struct.pack_into("<2i", header, 344, 0, 1)
    struct.pack_into("<12d", header, 400, *np.eye(3, 4).ravel())
    struct.pack_into("<i", header, 500, 2)
    content = bytes(header) + bytes(4) + body
    path.write_bytes(gzip.compress(content, 1) if path.suffix == ".gz" else content)
    return path.name


@case("nifti", "swelling")
def _(folder, rng):
    packed, kind = folder / "v.nii.gz", int(rng.integers(4))
    nifti(folder / "v.nii")
    whole = (folder / "v.nii").read_bytes()
    if kind == 0:  # the size is true of neither the file nor its 4 GB
        nifti(folder / "v.nii", dim=(3, 32767, 32767, 32767, 1, 1, 1, 1), body=b"")
        packed.write_bytes(swollen_gzip((folder / "v.nii").read_bytes()))
    elif kind == 1:  # an extension of 2 GB
        size = 2**31 - 16
        nifti(folder / "v.nii", offset=size + 352, extension=struct.pack("<4B2i", 1, 0, 0, 0, size, 6), body=b"")
        packed.write_bytes(swollen_gzip((folder / "v.nii").read_bytes()))
    elif kind == 2:
        packed.write_bytes(gzip.compress(whole)[: -int(rng.integers(20, 600))])
    else:
        packed.write_bytes(gzip.compress(whole[: -4 * int(rng.integers(1, 400))]))
    return packed.name


@case("nifti", "special")
def _(folder, rng):
    name = pick(rng, ("v.nii", "v.nii.gz"))
    special(folder / name, rng)
    return name


@case("nifti", "2^40")
def _(folder, rng):
    name = pick(rng, ("v.nii", "v.nii.gz"))
    if rng.random() < 0.5:
        return nifti2(folder / name, (3, *pick(rng, TOO_LARGE), 1, 1, 1, 1))
    return nifti(folder / name, dim=(3, 32767, 32767, int(rng.integers(1024, 32767)), 1, 1, 1, 1))


@case("nifti", "wrapping")
def _(folder, rng):
    name, kind = pick(rng, ("v.nii", "v.nii.gz")), int(rng.integers(3))
    if kind == 0:
        sizes = pick(rng, ((-1, 8, 9), (-6, -8, 9), (2**32, 2**32, 1), (2**62, 16, 1), (0, 8, 9), (6, 8, -9)))
        return nifti2(folder / name, (3, *sizes, 1, 1, 1, 1))
    if kind == 1:
        count = pick(rng, (-1, 0, 8, 32767, -32768))
        return nifti(folder / name, dim=(count, 6, 8, 9, 1, 1, 1, 1))
    return nifti(folder / name, offset=pick(rng, (-352, -1e9, 1e9, np.nan, np.inf, 3e38)))


@case("nifti", "header")
def _(folder, rng):
    name, kind = pick(rng, ("v.nii", "v.nii.gz")), int(rng.integers(3))
    if kind == 0:  # very many extensions
        count = int(rng.integers(400_000, 800_000))
        one = struct.pack("<2i8s", 16, 6, b"x")
        return nifti(folder / name, offset=352 + 16 * count, extension=struct.pack("<4B", 1, 0, 0, 0) + one * count)
    if kind == 1:  # one that is very long
        size = 64 * MB
        one = struct.pack("<2i", size, 6).ljust(size, b"{")
        return nifti(folder / name, offset=352 + size, extension=struct.pack("<4B", 1, 0, 0, 0) + one)
    size = pick(rng, (-16, 0, 7, 2**31 - 16, 64))  # one whose length cannot be
    one = struct.pack("<2i", size, 6).ljust(32, b"x")
    return nifti(folder / name, offset=384, extension=struct.pack("<4B", 1, 0, 0, 0) + one)


@case("nifti", "content")
def _(folder, rng):
    name, kind, number = pick(rng, ("v.nii", "v.nii.gz")), int(rng.integers(5)), pick(rng, (np.nan, np.inf, 3e38))
    if kind == 0:
        return nifti(folder / name, spacing=(1, number, 1))
    if kind == 1:
        return nifti(folder / name, origin=(0, 0, number))
    if kind == 2:
        return nifti(folder / name, body=np.full(SHAPE, pick(rng, (np.nan, np.inf)), "<f4").tobytes())
    if kind == 3:
        return nifti(folder / name, kind=pick(rng, (0, 1, 32, 128, 1536, 1792, 2048, 2304, 9999, -1)))
    return nifti(folder / name, slope=(pick(rng, (3e38, -3e38)), 0))


VALID["nrrd"] = lambda folder: nrrd(folder / "v.nrrd", gzip.compress(BODY), encoding="gzip")
VALID["metaimage"] = lambda folder: metaimage(folder / "v.mha", zlib.compress(BODY), CompressedData=True)
VALID["nifti"] = lambda folder: nifti(folder / "v.nii.gz")
