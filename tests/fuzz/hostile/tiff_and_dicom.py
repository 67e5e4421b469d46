"""TIFF and DICOM files that lie."""

import lzma
import struct
import zlib

import numpy as np
import pydicom
import tifffile
from pydicom.dataset import Dataset
from pydicom.uid import DeflatedExplicitVRLittleEndian, JPEG2000Lossless, RLELossless
from support import dicom_files

from fuzz.hostile.ways import (
    COMMANDS,
    MB,
    SWOLLEN,
    VALID,
    case,
    deep,
    pick,
    special,
    swollen_deflate,
    swollen_lzma,
    swollen_zlib,
)

for _form in ("tiff", "dicom"):
    COMMANDS[_form] = "segment NAME -o out.nii.gz --lower 50 --upper 400"

VALUES = np.arange(4 * 16 * 16, dtype="<f4").reshape(4, 16, 16)
WIDTH, LENGTH, BITS, COMPRESSION, DESCRIPTION, OFFSETS, SAMPLES, ROWS, COUNTS = (
    256,
    257,
    258,
    259,
    270,
    273,
    277,
    278,
    279,
)
SHORT, LONG = 3, 4


# --- TIFF ------------------------------------------------------------------------------------------------------------


def plain_tiff(path, strip, shape=(16, 16), compression=1, description=b"", count=None, after=0, magic=42):
    """Two pages of one strip each, tag by tag, so that each can be anything. after: what follows the second."""
    texts = description + b"\0"
    size = 2 + 12 * 13 + 4
    last = 8 + 2 * size
    data = struct.pack("<2sHI", b"II", magic, 8)
    for page in range(2):
        place = last + 8 + len(texts) + page * len(strip)
        tags = [
            (WIDTH, LONG, 1, shape[1]), (LENGTH, LONG, 1, shape[0]), (BITS, SHORT, 1, 32),
            (COMPRESSION, SHORT, 1, compression), (262, SHORT, 1, 1), (DESCRIPTION, 2, len(texts), last + 8),
            (OFFSETS, LONG, 1, place), (SAMPLES, SHORT, 1, 1), (ROWS, LONG, 1, shape[0]),
            (COUNTS, LONG, 1, len(strip) if count is None else count),
            (282, 5, 1, last), (283, 5, 1, last), (339, SHORT, 1, 3),
        ]  # fmt: skip
        data += struct.pack("<H", len(tags))
        data += b"".join(struct.pack("<HHII", tag, kind, number, value % 2**32) for tag, kind, number, value in tags)
        data += struct.pack("<I", after if page else 8 + size)
    path.write_bytes(data + struct.pack("<2I", 1, 1) + texts + strip + strip)
    return path.name


IMAGEJ = b"ImageJ=1.11a\nimages=%d\nslices=%d\nunit=mm\nspacing=1.0\n"


@case("tiff", "swelling")
def _(folder, rng):
    path, kind = folder / "v.tif", int(rng.integers(6))
    if kind == 0:
        return plain_tiff(
            path, swollen_zlib(bytes(1024)), compression=pick(rng, (8, 32946)), description=IMAGEJ % (2, 2)
        )
    if kind == 4:  # one stream, or very many that follow each other
        strip = pick(rng, (swollen_lzma(), lzma.compress(bytes(MB)) * SWOLLEN))
        return plain_tiff(path, strip, compression=34925, description=IMAGEJ % (2, 2))
    if kind == 5:
        strip = lzma.compress(VALUES[0].tobytes())[: -int(rng.integers(12, 80))]
        return plain_tiff(path, strip, compression=34925, description=IMAGEJ % (2, 2))
    if kind == 1:
        strip = zlib.compress(VALUES[0].tobytes()[: -int(rng.integers(1, 900))])
        return plain_tiff(path, strip, compression=8, description=IMAGEJ % (2, 2))
    if kind == 2:
        strip = zlib.compress(VALUES[0].tobytes())[: -int(rng.integers(1, 80))]
        return plain_tiff(path, strip, compression=8, description=IMAGEJ % (2, 2))
    plain_tiff(path, VALUES[0].tobytes(), description=IMAGEJ % (2, 2))
    path.write_bytes(path.read_bytes()[: -int(rng.integers(1, 1000))])
    return path.name


@case("tiff", "special")
def _(folder, rng):
    name = pick(rng, ("v.tif", "v.tiff", "v.ome.tif"))
    special(folder / name, rng)
    return name


@case("tiff", "2^40")
def _(folder, rng):
    path, kind = folder / "v.tif", int(rng.integers(1, 4))
    side = int(rng.integers(2**20, 2**31))
    if kind == 1:
        return plain_tiff(path, VALUES[0].tobytes(), (side, side), description=IMAGEJ % (2, 2))
    if kind == 2:
        return plain_tiff(path, zlib.compress(VALUES[0].tobytes()), (side, side), 8, description=IMAGEJ % (2, 2))
    return plain_tiff(path, VALUES[0].tobytes(), count=side + 2**31, description=IMAGEJ % (2, 2))


@case("tiff", "wrapping")
def _(folder, rng):
    path, strip = folder / "v.tif", VALUES[0].tobytes()
    shape = pick(
        rng, ((2**16, 2**16), (2**31, 2), (0, 16), (16, 0), (2**32 - 1, 2**32 - 1), (2**31, 2**31), (2**32 - 16, 16))
    )
    kind = int(rng.integers(3))
    if kind == 0:
        return plain_tiff(path, strip, shape, description=IMAGEJ % (2, 2))
    if kind == 1:
        count = pick(rng, (-2, -16, -(2**63), 2**63, 2**64 + 2))
        return plain_tiff(path, strip, shape, description=IMAGEJ % (count, count))
    return plain_tiff(
        path, strip, shape, compression=pick(rng, (8, 5, 32773, 34925, 50000)), description=IMAGEJ % (2, 2)
    )


OME = (
    '<?xml version="1.0"?>{}<OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06">{}<Image ID="Image:0"><Pixels '
    'DimensionOrder="XYZCT" ID="Pixels:0" SizeC="1" SizeT="1" SizeX="{}" SizeY="16" SizeZ="2" Type="float" '
    'PhysicalSizeX="1" PhysicalSizeY="1" PhysicalSizeZ="2"><TiffData/></Pixels></Image>{}</OME>'
)


@case("tiff", "header")
def _(folder, rng):
    path, kind, strip = folder / "v.ome.tif", int(rng.integers(5)), VALUES[0].tobytes()
    if kind == 0:
        nested = OME.format("", "<a>" * 200_000, 16, "</a>" * 200_000)
        return plain_tiff(path, strip, description=nested.encode())
    if kind == 1:  # each entity is ten of the one before
        entities = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10 if i else "laugh" * 10}">' for i in range(12))
        text = OME.format(f"<!DOCTYPE OME [{entities}]>", "<a>&e11;</a>", 16, "")
        return plain_tiff(path, strip, description=text.encode())
    if kind == 2:
        size = int(rng.integers(2**31, 2**40))
        return plain_tiff(path, strip, description=OME.format("", "", size, "").encode())
    if kind == 3:  # pages that follow each other in a circle
        return plain_tiff(path, strip, description=IMAGEJ % (2, 2), after=8)
    return plain_tiff(path, strip, description=OME.format("", "<a/>" * 2_000_000, 16, "").encode()[:-10])


@case("tiff", "content")
def _(folder, rng):
    path, kind = folder / "v.tif", int(rng.integers(5))
    if kind == 0:
        tifffile.imwrite(path, VALUES, bigtiff=bool(rng.integers(2)))  # no voxel size
        return path.name
    if kind == 1:
        spacing = pick(rng, ("nan", "inf", "1e400", "1e200", "0", "abc"))
        return plain_tiff(
            path, VALUES[0].tobytes(), description=(IMAGEJ % (2, 2)).replace(b"=1.0", b"=" + spacing.encode())
        )
    if kind == 2:
        values = np.full((16, 16), pick(rng, (np.nan, np.inf)), "<f4").tobytes()
        return plain_tiff(path, values, description=IMAGEJ % (2, 2))
    if kind == 3:
        return plain_tiff(path, VALUES[0].tobytes(), description=(IMAGEJ % (2, 2)).replace(b"mm", b"acres"))
    return plain_tiff(path, VALUES[0].tobytes(), description=IMAGEJ % (2, 2), magic=pick(rng, (0, 41, 43, 65535)))


# --- DICOM -----------------------------------------------------------------------------------------------------------

VALID["tiff"] = lambda folder: plain_tiff(folder / "v.tif", VALUES[0].tobytes(), description=IMAGEJ % (2, 2))
VALID["dicom"] = lambda folder: deflated(folder / "slice.dcm", lambda inner: zlib.compress(inner)[2:-4])
PIXELS = np.arange(64 * 64, dtype=np.uint16).reshape(64, 64)


def deflated(path, more, **tags):
    """A slice in a deflated data set; more: what to do to its bytes before they are packed, or the stream instead."""
    dicom_files.ct_slice(path, PIXELS, **tags)
    dataset = pydicom.dcmread(path)
    dataset.file_meta.TransferSyntaxUID = DeflatedExplicitVRLittleEndian
    dataset.save_as(path)
    whole = path.read_bytes()
    end = whole.index(b"\x02\x00\x00\x00UL")  # the length of the group that is never packed
    (length,) = struct.unpack_from("<I", whole, end + 8)
    start = end + 12 + length
    inner = zlib.decompress(whole[start:], -zlib.MAX_WBITS)
    path.write_bytes(whole[:start] + more(inner))
    return path.name


def enhanced(path, syntax, frames=2):
    shared = dicom_files.item(
        PixelMeasuresSequence=[dicom_files.item(PixelSpacing=[1, 1])],
        PlaneOrientationSequence=[dicom_files.item(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])],
    )
    places = [dicom_files.item(ImagePositionPatient=[0, 0, k]) for k in range(frames)]
    each = [dicom_files.item(PlanePositionSequence=[place]) for place in places]
    tags = {"PerFrameFunctionalGroupsSequence": each, "SharedFunctionalGroupsSequence": [shared]}
    dicom_files.save(path, dicom_files.ENHANCED_CT, np.stack([PIXELS] * frames), syntax, Modality="CT", **tags)
    return path.name


@case("dicom", "swelling")
def _(folder, rng):
    path, kind = folder / "slice.dcm", int(rng.integers(5))
    if kind == 0:
        return deflated(path, lambda inner: swollen_deflate(inner))
    if kind == 1:  # a private element of 3 GB before the pixels
        head = struct.pack("<2H2sHI", 9, 0x1001, b"OB", 0, 3 * 2**30)
        return deflated(path, lambda inner: swollen_deflate(head))
    if kind == 2:
        return deflated(path, lambda inner: zlib.compress(inner)[2:-200])
    if kind == 3:  # fewer pixels
        dicom_files.changed(folder / dicom_files.ct_slice(path, PIXELS).name, Rows=int(rng.integers(65, 60_000)))
        return path.name
    enhanced(path, RLELossless)
    dicom_files.changed(path, Rows=int(rng.integers(2000, 65535)), Columns=int(rng.integers(2000, 65535)))
    return path.name


@case("dicom", "special")
def _(folder, rng):
    name = pick(rng, ("slice.dcm", "slice.ima", "slice.dicom"))
    special(folder / name, rng)
    return name


def replaced(path, find, by):
    data = path.read_bytes()
    assert find in data
    path.write_bytes(data.replace(find, by, 1))
    return path.name


@case("dicom", "2^40")
def _(folder, rng):
    path, kind, side = folder / "slice.dcm", int(rng.integers(4)), int(rng.integers(60_000, 65_535))
    if kind == 0:
        dicom_files.ct_slice(path, PIXELS, NumberOfFrames=256 * 2**20 // 8)
        dicom_files.changed(path, Rows=side, Columns=side)
        return path.name
    if kind == 1:  # the image inside says another size than the header
        enhanced(path, JPEG2000Lossless, 1)
        data = bytearray(path.read_bytes())
        at = data.index(b"\xff\x4f\xff\x51")
        struct.pack_into(">2I", data, at + 8, side * 8, side * 8)
        struct.pack_into(">2I", data, at + 24, side * 8, side * 8)
        path.write_bytes(bytes(data))
        return path.name
    if kind == 2:
        dicom_files.ct_slice(path, PIXELS)
        tag = struct.pack("<2H", 0x7FE0, 0x0010) + b"OW\0\0"
        return replaced(path, tag + struct.pack("<I", 8192), tag + struct.pack("<I", 2**32 - 2 - 2 * side))
    enhanced(path, pick(rng, (RLELossless, JPEG2000Lossless)))
    dicom_files.changed(path, NumberOfFrames=int(rng.integers(2**20, 2**31)), Rows=65535, Columns=65535)
    return path.name


@case("dicom", "wrapping")
def _(folder, rng):
    path, kind = folder / "slice.dcm", int(rng.integers(3))
    if kind == 0:
        frames = pick(rng, ("-1", "0", "-2147483648", "4294967297", "18446744073709551617", "1e9", "nan"))
        with pydicom.config.disable_value_validation():
            dicom_files.ct_slice(path, PIXELS)
            dataset = pydicom.dcmread(path)
            dataset.add_new("NumberOfFrames", "IS", "1")
            dataset.save_as(path)
        word = b"\x28\x00\x08\x00IS"
        return replaced(path, word + b"\x02\x00" + b"1 ", word + struct.pack("<H", len(frames) + len(frames) % 2)
                        + frames.encode().ljust(len(frames) + len(frames) % 2))  # fmt: skip
    tags = {
        "BitsStored": pick(rng, (0, 17, 65535)),
        "HighBit": pick(rng, (16, 65535, 3)),
        "Rows": 0,
        "Columns": 0,
        "BitsAllocated": pick(rng, (0, 7, 65528, 64)),
    }
    key = pick(rng, tuple(tags))
    if kind == 1:
        dicom_files.ct_slice(path, PIXELS)
    else:
        enhanced(path, pick(rng, (RLELossless, JPEG2000Lossless)), 1)
    dicom_files.changed(path, **{key: tags[key]})
    return path.name


@case("dicom", "header")
def _(folder, rng):
    path, kind, many = folder / "slice.dcm", int(rng.integers(3)), int(rng.integers(500_000, 900_000))
    dicom_files.ct_slice(path, PIXELS)
    pixels = struct.pack("<2H", 0x7FE0, 0x0010)
    if kind == 0:  # sequences in sequences
        start = struct.pack("<2H2sHI", 9, 0x1001, b"SQ", 0, 2**32 - 1) + struct.pack("<2HI", 0xFFFE, 0xE000, 2**32 - 1)
        return replaced(path, pixels, deep(rng, start.decode("latin-1")).encode("latin-1") + pixels)
    if kind == 1:  # a sequence of very many items
        items = struct.pack("<2HI", 0xFFFE, 0xE000, 0) * (4 * many)
        whole = struct.pack("<2H2sHI", 9, 0x1001, b"SQ", 0, 2**32 - 1) + items + struct.pack("<2HI", 0xFFFE, 0xE0DD, 0)
        return replaced(path, pixels, whole + pixels)
    # very many elements
    body = b"".join(
        struct.pack("<2H2sH", 0x11 + 2 * (i // 60_000), 4096 + i % 60_000, b"LO", 0) for i in range(2 * many)
    )
    return replaced(path, pixels, body + pixels)


@case("dicom", "content")
def _(folder, rng):
    path, word = folder / "slice.dcm", pick(rng, ("nan", "inf", "1e400", "1e200", "abc"))
    kind = int(rng.integers(4))
    dicom_files.ct_slice(path, PIXELS)
    if kind == 0:
        dicom_files.ct_slice(path, PIXELS, RescaleIntercept="-102400")
        return replaced(path, b"-102400 ", word.encode().ljust(8))
    if kind == 1:
        dicom_files.changed(
            path, SOPClassUID=pick(rng, ("1.2.840.10008.5.1.4.1.1.4", "", None, "1.2.840.10008.1.3.10"))
        )
        return path.name
    if kind == 2:
        return replaced(path, b"DICM", b"XXXX")
    with pydicom.config.disable_value_validation():
        dataset: Dataset = pydicom.dcmread(path)
        dataset.PixelSpacing = [pick(rng, (0, -1, 1e200)), 1]
        dataset.save_as(path)
    return path.name
