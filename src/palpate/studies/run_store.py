"""A run of a study on disk, as JSON and arrays, so that an interrupted study goes on."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import AnyArray
from palpate.atomic_write import replacing


def write_json(path: Path, record: Any) -> None:
    """One record, whole or not at all; numbers that are none are refused."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(record, allow_nan=False), encoding="utf-8")


def read_json(path: Path) -> Any:
    """What `write_json` wrote."""
    return json.loads(path.read_text(encoding="utf-8"))


def write_arrays(path: Path, arrays: Mapping[str, AnyArray]) -> None:
    """Arrays by name (NPZ), whole or not at all."""
    with replacing(path) as temporary:
        np.savez_compressed(temporary, **arrays)  # type: ignore[arg-type]
