"""Records of sessions: each command with its tick, and digests of the states, to compare a replay with."""

import warnings
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from shlex import quote
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from palpate.arrays import Float64, Int64, UInt8
from palpate.errors import DataError, FileError
from palpate.simulation.event_log import COLUMNS
from palpate.simulation.page_record import parse_page_record, read_page_record
from palpate.simulation.pointer import KINDS, TOOLS
from palpate.simulation.session_cuts import CUT_COLUMNS, RecordedCut, cut_columns, cuts_in
from palpate.simulation.session_journal import SessionJournal, journal_path, read_journal
from palpate.simulation.session_notes import SessionNote, note_rows, notes_in
from palpate.volumes.hdf5_guard import check_heap, read_dataset
from palpate.volumes.hdf5_output import replacing_hdf5

FORMAT, VERSION, WITH_CUTS = "palpate session", 4, 5


@dataclass(frozen=True, eq=False)
class Record:
    """A recorded session. The same tissue, settings and commands give the same states.

    Parameters
    ----------
    ticks : ndarray, (n,)
        Tick that first obeyed each command, not falling.
    tools : ndarray, (n,)
        Which of the four tools.
    kinds : ndarray, (n,)
        0 releases, 1 holds, 2 is a needle, 3 is a free tool, 4 is a blade.
    points, displacements : ndarray, (n, 3)
        As in `Command`, mm.
    length : int
        Number of ticks.
    digest_ticks, digests : ndarray, (m,)
        Hash of the state after so many ticks.
    switches : ndarray, (k,)
        Ticks from which models answered with or without tables that were not ready in time.
    lacking : ndarray, (k,)
        Which model had none: 1 the current one, 2 the next one, 3 both, 0 none.
    model : str
        Name of the first model.
    tissue : str
        Fingerprint of the tissue.
    settings : dict of str to float
        What a tick does besides the model.
    instructions : str
        Instruction set of the machine, and for which processors its BLAS is. Digests compare only where both agree.
    changes : tuple, optional
        (tick, model, sweeps) of each later model.
    marks : tuple, optional
        (tick, what, tool) of each claim: 0 a lump under the tool, 1 a sample at the needle's tip. 2: a teacher guides the
        tool from here on; 3: no more.
    cuts : tuple of RecordedCut, optional
        Cuts and what was taken back of them, each with the first tick after it.
    notes : tuple of SessionNote, optional
        Texts at points of the tissue, each with the tick at which it was made. They change nothing in a replay.
    lesson : str, optional
        JSON: which lesson and case it was, which tools and views were allowed, and how the force came to the trainee.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 20)
    >>> session.record().length
    20
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
    cuts: tuple[RecordedCut, ...] = ()
    lesson: str = ""
    notes: tuple[SessionNote, ...] = ()

    def _repr_html_(self) -> str:
        from palpate.volumes.notebook_card import notebook_card  # only a notebook asks

        moved = np.linalg.norm(self.displacements, axis=1).max(initial=0)
        rows = [
            ("Length", f"{self.length / 1000:.4g} s at 1000 ticks a second"),
            ("Commands", f"{len(self.ticks):,} of {len(np.unique(self.tools))} tools, up to {moved:.3g} mm"),
            ("Model", self.model),
            ("Marks", f"{len(self.marks)}; cuts: {len(self.cuts)}; changes of the model: {len(self.changes)}"),
        ]
        return notebook_card("Recorded session", rows)


_CHANGES = np.dtype([("tick", "i8"), ("model", "S32"), ("sweeps", "i8")])


def write_record(path: str | Path, record: Record) -> None:
    """Write a recorded session as HDF5, completely or not at all.

    Parameters
    ----------
    path : str or Path
        The file.
    record : Record
        The session.

    Raises
    ------
    FileError
        If the file cannot be written.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 20)
    >>> pp.write_record("session.h5", session.record())
    """
    with replacing_hdf5(path) as file:
        file.attrs["format"], file.attrs["version"] = FORMAT, WITH_CUTS if record.cuts else VERSION
        for name in ("length", "model", "tissue", "instructions", *(("lesson",) if record.lesson else ())):
            file.attrs[name] = getattr(record, name)
        for name, (_, units) in COLUMNS.items():
            values = getattr(record, name)
            whole = {"compression": "gzip", "fletcher32": True} if len(values) else {}  # with a checksum
            file.create_dataset(name, data=values, **whole).attrs["units"] = units
        file.create_dataset("changes", data=np.array(list(record.changes), dtype=_CHANGES))
        file.create_dataset("marks", data=np.array(record.marks, dtype=np.int64).reshape(-1, 3))
        if record.notes:  # a reader that knows none of them reads all the rest
            file.create_dataset("notes", data=note_rows(record.notes))
        for name, values in cut_columns(record.cuts).items() if record.cuts else ():
            file.create_dataset(name, data=values, compression="gzip", fletcher32=True)
        settings = file.create_group("settings")
        for name, value in record.settings.items():
            settings.attrs[name] = value


def read_record(path: str | Path) -> Record:
    """Read a recorded session.

    A session that was cut short, by a full disk or a lost machine, left its journal beside the file (`session.h5.journal`).
    Then the session is read from there, up to a second before its end, with a warning.

    Parameters
    ----------
    path : str or Path
        An HDF5 file that `write_record` or `palpate touch --record` wrote, or a JSON file that an exported page saved.

    Returns
    -------
    Record
        The session.

    Raises
    ------
    FileError
        If the file is missing, truncated or of another kind.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 20)
    >>> pp.write_record("session.h5", session.record())
    >>> pp.read_record("session.h5").model
    'compliance'
    """
    path = Path(path)
    if path.suffix == ".json":
        return _checked(Record(**read_page_record(path)), path)
    journal = journal_path(path)
    if journal.is_file() and (record := recovered(journal)) is not None:
        warnings.warn(
            f"{journal}: a session that was cut short; its first {record.length / 1000:g} s are read", stacklevel=2
        )
        return record
    if not path.exists():
        raise FileError(
            f"{path}: no such file; record a session with: palpate touch tissue.vtu --record {quote(str(path))}"
        )
    check_heap(path)
    try:
        with h5py.File(path) as file:
            kind = (file.attrs.get("format"), file.attrs.get("version"))
            if kind not in ((FORMAT, VERSION), (FORMAT, WITH_CUTS)):
                raise FileError(
                    f"{path}: format and version are {kind}, expected {(FORMAT, VERSION)}; "
                    f"record a session with: palpate touch tissue.vtu --record {quote(str(path))}"
                )
            read = partial(read_dataset, path, file)
            arrays = {name: np.ascontiguousarray(read(name), dtype=dtype) for name, (dtype, _) in COLUMNS.items()}
            if not isinstance(file["settings"], h5py.Group):
                raise ValueError("settings: expected a group")
            record = Record(
                **arrays,
                length=int(file.attrs["length"]),
                model=str(file.attrs["model"]),
                tissue=str(file.attrs["tissue"]),
                instructions=str(file.attrs["instructions"]),
                lesson=str(file.attrs.get("lesson", "")),
                settings={name: float(value) for name, value in file["settings"].attrs.items()},
                changes=tuple((int(t), name.decode(), int(n)) for t, name, n in read("changes")),
                marks=tuple((int(t), int(what), int(tool)) for t, what, tool in read("marks")),
                cuts=cuts_in({name: read(name) for name in CUT_COLUMNS}) if kind[1] == WITH_CUTS else (),
                notes=notes_in(read("notes")) if "notes" in file else (),
            )
    except (FileError, MemoryError):
        raise
    except Exception as problem:  # h5py raises almost anything on a damaged file
        raise FileError(f"{path}: damaged or truncated ({problem}); record the session again") from None
    _check(path, record)
    return record


def start_journal(path: str | Path, head: dict[str, Any]) -> SessionJournal:
    """A journal for the session that will be written to `path`; `head` is what `Record` says of it as a whole.

    If an earlier session to `path` was cut short, its record is written first, under a name of its own. Raises `FileError`.
    """
    path = Path(path)
    journal = SessionJournal(journal_path(path))
    try:
        if (left := recovered(journal.path)) is not None:
            numbered = (path.with_stem(f"{path.stem}-recovered-{number}") for number in count(1))
            free = next(name for name in numbered if not name.exists())
            write_record(free, left)
            warnings.warn(f"{path}: an earlier session was cut short; it is now in {free}", stacklevel=2)
        journal.begin(head)
    except BaseException:
        journal.close()
        raise
    return journal


def recovered(journal: Path) -> Record | None:
    """The record in a journal; None if its session died before the first digest. Raises `FileError`."""
    try:
        if (left := read_journal(journal)) is None:
            return None
        record = Record(**left)
        texts = record.model, record.tissue, record.instructions, record.lesson
        heads = [(record.settings, dict), *((text, str) for text in texts)]
        numbers = all(isinstance(value, int | float) for value in record.settings.values())
        if not numbers or not all(isinstance(value, kind) for value, kind in heads):
            raise TypeError("its first line has values of other kinds")
        _check(journal, record)
        np.array(list(record.changes), dtype=_CHANGES)
        np.array(list(record.marks), dtype="i8").reshape(-1, 3)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, DataError) as problem:
        raise FileError(
            f"{journal}: its checksums fit, but no session wrote what it holds ({problem}); move it away to read the record"
        ) from None
    return record


def record_of_page(text: str) -> Record:
    """The session that a page reports, as JSON. Raises `FileError` if it is damaged."""
    return _checked(Record(**parse_page_record(text.encode(), "the page")), "the page")


def _checked(record: Record, path: str | Path) -> Record:
    _check(path, record)
    return record


def _check(path: str | Path, record: Record) -> None:
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
    rising = {
        "changes": [c[0] for c in record.changes],
        "marks": [c[0] for c in record.marks],
        "cuts": [c.tick for c in record.cuts],
        "notes": [note.tick for note in record.notes],
    }
    for name, ticks in rising.items():
        if ticks != sorted(ticks) or (ticks and (ticks[0] < 0 or ticks[-1] > record.length)):
            raise FileError(f"{path}: ticks of {name} do not rise from 0 to the length {record.length}; {again}")
