"""NIfTI-1 and -2 through nibabel."""

import json
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import nibabel
import numpy as np
from nibabel.spatialimages import HeaderDataError

from palpate.errors import FileError
from palpate.volumes.quiet import quiet
from palpate.volumes.stored import UPRIGHT, Stored

TO_MM = {"meter": 1000.0, "mm": 1.0, "micron": 0.001, "unknown": 1.0}
COMMENT = 6  # NIfTI's extension code for plain text
NOTE = "palpate unit="  # in the header's free text


def read(path: Path) -> Stored:
    """Raises `FileError` when the file is not NIfTI or ends early."""
    try:
        with quiet():
            image = nibabel.load(path)
            values = np.asanyarray(image.dataobj)  # applies the header's slope and intercept
            length = TO_MM.get(image.header.get_xyzt_units()[0], 1.0)
            affine = UPRIGHT @ np.diag([length, length, length, 1.0]) @ image.affine
    except HeaderDataError as problem:
        raise FileError(f"{path}: NIfTI header cannot be read ({problem}); export it again") from None
    except MemoryError:
        raise
    except Exception as problem:  # nibabel raises almost anything on a damaged file
        raise FileError(f"{path}: not a whole NIfTI file ({problem}); copy or export it again") from None
    while values.ndim > 3 and values.shape[-1] == 1:
        values = values[..., 0]
    words = bytes(image.header["descrip"].tobytes()).split(b"\0")[0].decode("latin-1")
    unit = words.removeprefix(NOTE) if words.startswith(NOTE) else None
    return Stored(values.T, affine, unit, _names(image.header.extensions))


def write(path: Path, stored: Stored) -> None:
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
    nibabel.save(image, path)


def _names(extensions: list[nibabel.nifti1.Nifti1Extension]) -> Mapping[int, str]:
    for extension in extensions:
        content = extension.get_content()
        words = content if isinstance(content, bytes) else str(content).encode()
        words = words.rstrip(b"\0 ")
        try:
            if words.startswith(b"{"):
                return {int(k): str(v) for k, v in json.loads(words)["label_names"].items()}
            if b"<LabelTable>" in words:  # the table of the Connectome Workbench
                labels = ElementTree.fromstring(words.decode()).iter("Label")
                return {int(label.attrib["Key"]): (label.text or "").strip() for label in labels}
        except (ValueError, KeyError, AttributeError, ElementTree.ParseError):
            continue  # a header's comment is no reason to refuse the voxels
    return {}
