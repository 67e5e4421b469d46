"""Keeps the scores of many sessions in one file, a row a session, without names."""

import csv
import hashlib
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import astuple, dataclass, fields
from datetime import date
from pathlib import Path

from palpate.atomic_write import replacing
from palpate.errors import DataError, FileError
from palpate.simulation.forced_choice import CHANNELS
from palpate.simulation.scoring import Score

_CODE = re.compile(r"[A-Za-z]{0,4}-?[0-9]{1,6}")
_FORMAT = 1
_KINDS = {str: "TEXT", int: "INTEGER", float: "REAL"}


@dataclass(frozen=True)
class StoredSession:
    """A session of a person, and what it scored.

    Parameters
    ----------
    person, group : str
        Code of who it was, such as P07, and the group they belong to, such as novice.
    attempt : int
        The person's how many-th session with this task, tissue and channel, from 1.
    day : str
        When it was added, YYYY-MM-DD.
    task, tissue, channel : str
        What was asked; a hash of the tissue; how the force came to the trainee: screen, sound, gamepad or device.
    seconds, path, mean_force, max_force, over_force, work, max_strain : float
        As of `Score`; path is that of all tools together, mm.
    touches, found, sought, wrong : int
        As of `Score`.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 200)
    >>> pp.write_record("session.h5", session.record())
    >>> row = pp.add_session("class.db", "session.h5", pp.score(session.record(), tissue), "organ", "P07", "novice")
    >>> row.touches
    1
    """

    person: str
    group: str
    attempt: int
    day: str
    task: str
    tissue: str
    channel: str
    seconds: float
    path: float
    mean_force: float
    max_force: float
    over_force: float
    work: float
    max_strain: float
    touches: int
    found: int
    sought: int
    wrong: int


def add_session(
    store: str | Path, record: str | Path, score: Score, tissue: str, person: str, group: str, channel: str = "screen"
) -> StoredSession:
    """Add the score of a session to a store, which is made if it is not there.

    Parameters
    ----------
    store : str or Path
        The store, an SQLite file.
    record : str or Path
        The recorded session. A hash of it is kept, so that none is added twice.
    score : Score
        Its score.
    tissue : str
        What tells the tissue from others, such as its hash in the record.
    person : str
        A code: up to four letters and a number, such as P07. Names are refused.
    group : str
        A word, such as novice or expert.
    channel : {"screen", "sound", "gamepad", "device"}, optional
        How the force came to the trainee. Scores of different channels are never pooled.

    Returns
    -------
    StoredSession
        The row.

    Raises
    ------
    DataError
        If the person is no code, the group no word, the channel unknown, or the session is there already.
    FileError
        If a file cannot be read or written, or is no store.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 200)
    >>> pp.write_record("session.h5", session.record())
    >>> row = pp.add_session("class.db", "session.h5", pp.score(session.record(), tissue), "organ", "P07", "novice")
    >>> row.attempt
    1
    """
    if not _CODE.fullmatch(person):
        raise DataError(f"person: {person!r}; give a code and no name: up to four letters and a number, such as P07")
    if not re.fullmatch(r"[A-Za-z][A-Za-z-]{0,19}", group):
        raise DataError(f"group: {group!r}; give a word, such as novice or expert")
    if channel not in CHANNELS:
        raise DataError(f"channel: {channel!r}; choose one of {', '.join(CHANNELS)}")
    try:
        digest = hashlib.sha256(Path(record).read_bytes()).hexdigest()
    except OSError as problem:
        raise FileError(f"{record}: {problem.strerror}; give the session that was scored") from None
    with _opened(store, make=True) as database:
        if database.execute("SELECT 1 FROM sessions WHERE digest = ?", (digest,)).fetchone():
            raise DataError(f"{record}: this session is in {store} already")
        same = (person, score.task.kind, tissue, channel)
        count = "SELECT COUNT(*) FROM sessions WHERE person = ? AND task = ? AND tissue = ? AND channel = ?"
        row = StoredSession(
            person,
            group,
            1 + database.execute(count, same).fetchone()[0],
            date.today().isoformat(),
            score.task.kind,
            tissue,
            channel,
            score.seconds,
            float(sum(score.path)),
            score.mean_force,
            score.max_force,
            score.over_force,
            score.work,
            score.max_strain,
            score.touches,
            score.found,
            score.sought,
            score.wrong,
        )
        marks = ", ".join("?" * (1 + len(fields(row))))
        database.execute(f"INSERT INTO sessions VALUES ({marks})", (digest, *astuple(row)))
    return row


def read_sessions(store: str | Path) -> list[StoredSession]:
    """Read the rows of a store, in the order in which they were added.

    Parameters
    ----------
    store : str or Path
        The store.

    Returns
    -------
    list of StoredSession
        A row a session.

    Raises
    ------
    FileError
        If the file is missing or is no store.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 200)
    >>> pp.write_record("session.h5", session.record())
    >>> row = pp.add_session("class.db", "session.h5", pp.score(session.record(), tissue), "organ", "P07", "novice")
    >>> pp.read_sessions("class.db") == [row]
    True
    """
    with _opened(store) as database:
        return _rows(database)


def export_sessions(store: str | Path, table: str | Path) -> int:
    """Write the rows of a store to a table of comma-separated values, which the store remembers.

    Parameters
    ----------
    store : str or Path
        The store.
    table : str or Path
        The table, .csv. When a person is deleted from the store, it is written again.

    Returns
    -------
    int
        How many rows were written.

    Raises
    ------
    FileError
        If a file cannot be read or written.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 200)
    >>> pp.write_record("session.h5", session.record())
    >>> row = pp.add_session("class.db", "session.h5", pp.score(session.record(), tissue), "organ", "P07", "novice")
    >>> pp.export_sessions("class.db", "class.csv")
    1
    """
    rows = read_sessions(store)
    _write(table, rows)
    with _opened(store) as database:
        database.execute("INSERT OR IGNORE INTO exports VALUES (?)", (str(Path(table).resolve()),))
    return len(rows)


def delete_person(store: str | Path, person: str) -> tuple[int, list[Path]]:
    """Delete all sessions of a person from a store and from the tables that were exported from it.

    What is deleted is overwritten in the store's file. Copies of the store or of a table are not known.

    Parameters
    ----------
    store : str or Path
        The store.
    person : str
        The code.

    Returns
    -------
    rows : int
        How many sessions were deleted.
    tables : list of Path
        The tables that were written again.

    Raises
    ------
    DataError
        If the store has no session of that person.
    FileError
        If a file cannot be read or written.

    Examples
    --------
    >>> session = pp.Session(pp.model(tissue, "compliance"), radius=10, sweeps=10)
    >>> _ = session.step([pp.Command(True, tuple(top), (0, 0, -2))] * 200)
    >>> pp.write_record("session.h5", session.record())
    >>> row = pp.add_session("class.db", "session.h5", pp.score(session.record(), tissue), "organ", "P07", "novice")
    >>> pp.delete_person("class.db", "P07")
    (1, [])
    """
    with _opened(store) as database:
        count = database.execute("DELETE FROM sessions WHERE person = ?", (person,)).rowcount
        if not count:
            raise DataError(f"{store}: holds no session of {person!r}")
        known = [Path(path) for (path,) in database.execute("SELECT path FROM exports")]
        written = [path for path in known if path.is_file()]
        for path in written:  # first: if one cannot be written, the person is still there to be deleted again
            _write(path, _rows(database))
    return count, written


def _rows(database: sqlite3.Connection) -> list[StoredSession]:
    return [StoredSession(*row[1:]) for row in database.execute("SELECT * FROM sessions ORDER BY rowid")]


def _write(table: str | Path, rows: list[StoredSession]) -> None:
    path = Path(table)
    if path.suffix.lower() != ".csv":
        raise FileError(f"{table}: the rows are written as .csv; name it so")
    heads = [field.name for field in fields(StoredSession)]
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([heads, *(astuple(row) for row in rows)])


def _connected(store: str | Path) -> sqlite3.Connection:
    """With `secure_delete` SQLite overwrites what is deleted with zeros."""
    database = sqlite3.connect(store, isolation_level=None)
    for line in ("journal_mode = DELETE", "secure_delete = ON", "temp_store = MEMORY", "trusted_schema = OFF"):
        database.execute(f"PRAGMA {line}")
    return database


@contextmanager
def _opened(store: str | Path, make: bool = False) -> Iterator[sqlite3.Connection]:
    """The store within a transaction, which an error takes back."""
    path = Path(store)
    if not make and not path.is_file():
        raise FileError(f"{store}: there is no such store; palpate sessions add makes one")
    columns = ", ".join(
        f'"{f.name}" {_KINDS[f.type]} NOT NULL' for f in fields(StoredSession) if isinstance(f.type, type)
    )
    try:
        with closing(_connected(path)) as database:
            database.execute("BEGIN IMMEDIATE")
            try:
                if make and not database.execute("SELECT 1 FROM sqlite_master").fetchone():
                    database.execute(f"CREATE TABLE sessions (digest TEXT PRIMARY KEY, {columns})")
                    database.execute("CREATE TABLE exports (path TEXT PRIMARY KEY)")
                    database.execute(f"PRAGMA user_version = {_FORMAT}")
                if database.execute("PRAGMA user_version").fetchone()[0] != _FORMAT:
                    raise FileError(f"{store}: is no store of sessions of this version; give another file")
                yield database
            except BaseException:
                database.execute("ROLLBACK")
                raise
            database.execute("COMMIT")
    except sqlite3.Error as problem:
        raise FileError(
            f"{store}: {problem}; is it a store that palpate sessions made, and can it be written?"
        ) from None
