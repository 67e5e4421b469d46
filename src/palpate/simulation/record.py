"""A session on file: every command with the tick that obeyed it, and digests of the states to compare a replay with."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Float64, Int64, UInt8
from palpate.atomic import replacing
from palpate.errors import FileError
from palpate.simulation.devices.pointer import KINDS, TOOLS
from palpate.volumes.hdf5 import refuse_endless_heap

FORMAT, VERSION = "palpate session", 4


@dataclass(frozen=True, eq=False)
class Record:
    """A session, complete: the same tissue, settings and commands give the same states.

    ticks: (n,) not falling, the tick that first obeyed each command. tools: (n,) which of the four tools. kinds: (n,)
    0 lets go, 1 holds, 2 a needle, 3 in space. points, displacements: (n, 3) mm, as `Command` says. length: ticks in
    all. switches: (k,) rising, ticks from which models answered with or without tables that were not made in time;
    lacking: (k,) without: 1 the model at work, 2 the one that was coming, 3 both, 0 none. digest_ticks, digests: (m,)
    hash of the state after so many ticks. model, tissue: name of the first model and fingerprint of the tissue.
    changes: (tick, model, sweeps) of each model that came later. marks: (tick, what, tool) of what the hand claimed: 0 a
    lump under the tool, 1 a sample at the needle's tip. settings: what a tick does besides the model. instructions: set
    of the machine's; another one rounds otherwise, so digests compare only within one.
    """

    ticks: Int64
    tools: UInt8
    kinds: UInt8
    points: Float64
    displacements: Float64
    length: int
    digest_ticks: Int64
    digests: NDArray[np.uint64]
    switches: Int64
    lacking: UInt8
    model: str
    tissue: str
    settings: dict[str, float]
    instructions: str
    changes: tuple[tuple[int, str, int], ...] = ()
    marks: tuple[tuple[int, int, int], ...] = ()


_ARRAYS: dict[str, tuple[Any, str]] = {
    "ticks": (np.int64, "1"),
    "tools": (np.uint8, "1"),
    "kinds": (np.uint8, "1"),
    "points": (np.float64, "mm"),
    "displacements": (np.float64, "mm"),
    "digest_ticks": (np.int64, "1"),
    "digests": (np.uint64, "1"),
    "switches": (np.int64, "1"),
    "lacking": (np.uint8, "1"),
}


_CHANGES = np.dtype([("tick", "i8"), ("model", "S32"), ("sweeps", "i8")])


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
        file.create_dataset("changes", data=np.array(list(record.changes), dtype=_CHANGES))
        file.create_dataset("marks", data=np.array(record.marks, dtype=np.int64).reshape(-1, 3))
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
                changes=tuple((int(t), name.decode(), int(n)) for t, name, n in file["changes"][()]),
                marks=tuple((int(t), int(what), int(tool)) for t, what, tool in file["marks"][()]),
            )
    except FileError:
        raise
    except (OSError, KeyError, ValueError) as problem:
        raise FileError(f"{path}: damaged or truncated ({problem}); record the session again") from None
    _check(path, record)
    return record


def _check(path: Path, record: Record) -> None:
    n, m, again = len(record.ticks), len(record.digest_ticks), "record the session again"
    shapes = {"tools": (n,), "kinds": (n,), "points": (n, 3), "displacements": (n, 3), "digests": (m,)}
    k = record.switches.size
    for name, shape in {**shapes, "switches": (k,), "lacking": (k,)}.items():
        found = getattr(record, name).shape
        if found != shape:
            raise FileError(f"{path}: {name} has shape {found}, expected {shape}; {again}")
    if (record.tools >= TOOLS).any() or (record.kinds >= len(KINDS)).any():
        raise FileError(f"{path}: tools or kinds that there are not; {again}")
    if (np.diff(record.switches) <= 0).any():
        raise FileError(f"{path}: switches of tables do not rise; {again}")
    if (np.diff(record.ticks) < 0).any() or (n and (record.ticks[0] < 0 or record.ticks[-1] >= record.length)):
        raise FileError(f"{path}: ticks do not rise from 0 to the length {record.length}; {again}")
    for name, ticks in (("changes", [c[0] for c in record.changes]), ("marks", [c[0] for c in record.marks])):
        if ticks != sorted(ticks) or (ticks and (ticks[0] < 0 or ticks[-1] > record.length)):
            raise FileError(f"{path}: ticks of {name} do not rise from 0 to the length {record.length}; {again}")
