"""A session on file: every command with the tick that obeyed it, and digests of the states to compare a replay with."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Bool, Float64, Int64
from palpate.atomic import replacing
from palpate.errors import FileError
from palpate.volumes.hdf5 import refuse_endless_heap

FORMAT, VERSION = "palpate session", 2


@dataclass(frozen=True, eq=False)
class Record:
    """A session, complete: the same tissue, settings and commands give the same states.

    ticks: (n,) rising, the tick that first obeyed each command. held: (n,). points: (n, 3) mm, on the surface at rest.
    displacements: (n, 3) mm. length: ticks in all. switches: (k,) rising, the ticks from which the model answered
    without tables that were not made in time, then with them, then without again, ... digest_ticks, digests: (m,) hash
    of the state after so many ticks. model, tissue: name of the model and fingerprint of the tissue. settings: what a
    tick does besides the model.
    instructions: instruction set of the machine; another one rounds otherwise, so digests compare only within one.
    """

    ticks: Int64
    held: Bool
    points: Float64
    displacements: Float64
    length: int
    digest_ticks: Int64
    digests: NDArray[np.uint64]
    switches: Int64
    model: str
    tissue: str
    settings: dict[str, float]
    instructions: str


_ARRAYS: dict[str, tuple[Any, str]] = {
    "ticks": (np.int64, "1"),
    "held": (np.bool_, "1"),
    "points": (np.float64, "mm"),
    "displacements": (np.float64, "mm"),
    "digest_ticks": (np.int64, "1"),
    "digests": (np.uint64, "1"),
    "switches": (np.int64, "1"),
}


def write_record(path: str | Path, record: Record) -> None:
    """Writes `record` as HDF5, whole or not at all. Raises `FileError`."""
    with replacing(path) as part, h5py.File(part, "w") as file:
        file.attrs["format"], file.attrs["version"] = FORMAT, VERSION
        for name in ("length", "model", "tissue", "instructions"):
            file.attrs[name] = getattr(record, name)
        for name, (_, units) in _ARRAYS.items():
            values = getattr(record, name)
            whole = {"compression": "gzip", "fletcher32": True} if len(values) else {}  # with a checksum
            file.create_dataset(name, data=values, **whole).attrs["units"] = units
        settings = file.create_group("settings")
        for name, value in record.settings.items():
            settings.attrs[name] = value


def read_record(path: str | Path) -> Record:
    """The session recorded in `path`. Raises `FileError` if the file is missing, truncated or of another kind."""
    path = Path(path)
    if not path.is_file():
        raise FileError(f"{path}: no such file; record a session with: palpate touch tissue.vtu --record {path}")
    refuse_endless_heap(path)
    try:
        with h5py.File(path) as file:
            kind = (file.attrs.get("format"), file.attrs.get("version"))
            if kind != (FORMAT, VERSION):
                raise FileError(
                    f"{path}: format and version are {kind}, expected {(FORMAT, VERSION)}; "
                    f"record a session with: palpate touch tissue.vtu --record {path}"
                )
            arrays = {name: np.ascontiguousarray(file[name][()], dtype=dtype) for name, (dtype, _) in _ARRAYS.items()}
            record = Record(
                **arrays,
                length=int(file.attrs["length"]),
                model=str(file.attrs["model"]),
                tissue=str(file.attrs["tissue"]),
                instructions=str(file.attrs["instructions"]),
                settings={name: float(value) for name, value in file["settings"].attrs.items()},
            )
    except FileError:
        raise
    except (OSError, KeyError, ValueError) as problem:
        raise FileError(f"{path}: damaged or truncated ({problem}); record the session again") from None
    _check(path, record)
    return record


def _check(path: Path, record: Record) -> None:
    n, m, switches = len(record.ticks), len(record.digest_ticks), record.switches.size
    shapes = {"held": (n,), "points": (n, 3), "displacements": (n, 3), "digests": (m,), "switches": (switches,)}
    for name, shape in shapes.items():
        found = getattr(record, name).shape
        if found != shape:
            raise FileError(f"{path}: {name} has shape {found}, expected {shape}; record the session again")
    if (np.diff(record.switches) <= 0).any():
        raise FileError(f"{path}: switches of tables do not rise; record the session again")
    if (np.diff(record.ticks) <= 0).any() or (n and (record.ticks[0] < 0 or record.ticks[-1] >= record.length)):
        raise FileError(f"{path}: ticks do not rise from 0 to the length {record.length}; record the session again")
