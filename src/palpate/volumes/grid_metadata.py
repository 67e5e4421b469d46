"""A grid, a unit and notes as a JSON text, for file formats that store a spacing but no direction."""

import json
from collections.abc import Mapping

import numpy as np

from palpate.arrays import Float64
from palpate.bounded_read import parse_json
from palpate.volumes.file_axes import StoredImage

AGREE = 1e-4  # relative; a spacing that was edited since makes the text stale


def metadata_text(stored: StoredImage) -> str:
    """The text: affine (voxel indices x, y, z to LPS mm, the upper 3 lines) and unit."""
    notes = {"notes": dict(stored.notes)} if stored.notes else {}
    return json.dumps({"palpate": {"affine": stored.affine[:3].tolist(), "unit": stored.unit, **notes}})


def read_notes(text: str) -> Mapping[str, str]:
    """The notes of a volume in such a text; none if it is another text."""
    try:
        return {str(k): str(v) for k, v in parse_json(text)["palpate"].get("notes", {}).items()}
    except (ValueError, KeyError, TypeError, AttributeError):
        return {}


def read_metadata_text(text: str, spacing: Float64, origin: Float64 | None = None) -> tuple[Float64, str | None]:
    """Affine and unit: those of the text where it fits the file's own spacing (x, y, z) mm, else axes as they are."""
    affine = np.diag([*spacing, 1.0])
    if origin is not None:
        affine[:3, 3] = origin
    try:
        said = parse_json(text)["palpate"]
        full = np.vstack([np.array(said["affine"], dtype=np.float64).reshape(3, 4), [0, 0, 0, 1]])
        unit = None if said["unit"] is None else str(said["unit"])
    except (ValueError, KeyError, TypeError):
        return affine, None
    there = np.linalg.norm(full[:3, :3], axis=0)
    return (full, unit) if np.allclose(there, spacing, rtol=AGREE) else (affine, None)
