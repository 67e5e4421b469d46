"""NIfTI-1 and -2 through nibabel."""

import gzip
import json
import math
import struct
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import nibabel
import numpy as np
from nibabel.spatialimages import HeaderDataError

from palpate.bounded_read import check_claim, parse_json
from palpate.errors import FileError
from palpate.volumes.file_axes import UPRIGHT, StoredImage
from palpate.volumes.grid_metadata import metadata_text, read_notes
from palpate.volumes.suppress_output import suppress_output

TO_MM = {"meter": 1000.0, "mm": 1.0, "micron": 0.001, "unknown": 1.0}
COMMENT = 6  # NIfTI's extension code for plain text
HEADER = 16 * 2**20  # bytes before the voxels, with all extensions
MOST = 1000  # extensions
NOTE = "palpate unit="  # in the header's free text


def read(path: Path) -> StoredImage:
    """Raises `FileError` when the file is not NIfTI or ends early."""
    try:
        _check_extensions(path)
        with suppress_output():
            image = nibabel.load(path)
            if min(image.shape, default=0) < 1:
                raise ValueError(f"its axes are {image.shape}")
            size = math.prod(image.shape) * image.header.get_data_dtype().itemsize
            check_claim(path, f"{image.shape} voxels", size, path.stat().st_size)
            values = np.asanyarray(image.dataobj)  # applies the header's slope and intercept
            length = TO_MM.get(image.header.get_xyzt_units()[0], 1.0)
            affine = UPRIGHT @ np.diag([length, length, length, 1.0]) @ image.affine
    except HeaderDataError as problem:
        raise FileError(f"{path}: NIfTI header cannot be read ({problem}); export it again") from None
    except (FileError, MemoryError):
        raise
    except Exception as problem:  # nibabel raises almost anything on a damaged file
        raise FileError(f"{path}: not a whole NIfTI file ({problem}); copy or export it again") from None
    while values.ndim > 3 and values.shape[-1] == 1:
        values = values[..., 0]
    words = bytes(image.header["descrip"].tobytes()).split(b"\0")[0].decode("latin-1")
    unit = words.removeprefix(NOTE) if words.startswith(NOTE) else None
    said = [read_notes(_text(each).decode("utf-8", "replace")) for each in image.header.extensions]
    notes = next((each for each in said if each), {})
    return StoredImage(values.T, affine, unit, _names(image.header.extensions), notes)


def write(path: Path, stored: StoredImage) -> None:
    """Both the q-form and the s-form say where the voxels are."""
    image = nibabel.Nifti1Image(stored.values.T, UPRIGHT @ stored.affine)
    image.header.set_xyzt_units("mm")
    image.set_sform(UPRIGHT @ stored.affine, code="scanner")
    image.set_qform(UPRIGHT @ stored.affine, code="scanner")
    if stored.unit:
        image.header["descrip"] = f"{NOTE}{stored.unit}".encode()[:79]
    if stored.names:
        table = json.dumps({"label_names": {str(k): v for k, v in stored.names.items()}})
        image.header.extensions.append(nibabel.nifti1.Nifti1Extension(COMMENT, table.encode()))
    if stored.notes:
        image.header.extensions.append(nibabel.nifti1.Nifti1Extension(COMMENT, metadata_text(stored).encode()))
    nibabel.save(image, path)


def _check_extensions(path: Path) -> None:
    """Raises `ValueError` for extensions of the header that nibabel would read on and on, or for too much memory."""
    with gzip.open(path) if path.name.lower().endswith(".gz") else path.open("rb") as file:
        head = file.read(540)
        order = "<" if head[:4] in (b"\\\1\0\0", b"\x1c\2\0\0") else ">"
        if head[4:7] == b"n+2":
            (voxels,) = struct.unpack_from(f"{order}q", head, 168)
        elif head[344:347] == b"n+1":
            (voxels,) = struct.unpack_from(f"{order}f", head, 108)
        else:
            return  # its voxels lie in a second file, or nibabel says what is wrong
        if not 0 <= voxels <= HEADER:
            raise ValueError(f"voxels begin at byte {voxels:g}, expected {HEADER} at most")
        at, count = file.seek(544 if head[4:7] == b"n+2" else 352), 0
        while at + 16 <= voxels:
            (length,) = struct.unpack(f"{order}i", file.read(4))
            count += 1
            if length < 8 or at + length > voxels or count > MOST:
                raise ValueError(f"header extension {count} has {length} bytes, and voxels begin at byte {voxels:g}")
            at = file.seek(at + length)


def _text(extension: nibabel.nifti1.Nifti1Extension) -> bytes:
    content = extension.get_content()
    words = content if isinstance(content, bytes) else str(content).encode()
    return words.rstrip(b"\0 ")


def _names(extensions: list[nibabel.nifti1.Nifti1Extension]) -> Mapping[int, str]:
    for extension in extensions:
        words = _text(extension)
        try:
            if words.startswith(b"{"):
                return {int(k): str(v) for k, v in parse_json(words)["label_names"].items()}
            if b"<LabelTable>" in words:  # the table of the Connectome Workbench
                labels = ElementTree.fromstring(words.decode()).iter("Label")
                return {int(label.attrib["Key"]): (label.text or "").strip() for label in labels}
        except (ValueError, KeyError, TypeError, AttributeError, ElementTree.ParseError):
            continue  # a header's comment is no reason to refuse the voxels
    return {}
