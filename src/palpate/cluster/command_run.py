"""One palpate command for one file of an archive, and the record that stays beside its output."""

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from palpate.atomic_write import replacing
from palpate.bounded_read import parse_json, read_text
from palpate.errors import DataError, FileError
from palpate.version import __version__

KIND = "palpate run 1"
REPORTING = {"reconstruct"}  # commands with --report
RESUMING = {"reconstruct"}  # commands with --resume, from a checkpoint beside the output


@dataclass(frozen=True)
class CommandRun:
    """A palpate command that makes one output from one input.

    Parameters
    ----------
    command : str
        Its name, such as "reconstruct".
    input : Path
        The file or folder that it reads.
    output : Path
        The file or folder that it writes.
    options : tuple of str, optional
        All other words of the command line. One that has a suffix or a slash may name a file.
    plugins : tuple of Path, optional
        Python files that register parts of your own.

    Raises
    ------
    DataError
        If the input is the output.

    Examples
    --------
    >>> pp.CommandRun("reconstruct", Path("a.h5"), Path("a.nii.gz"), ("--thickness", "51.2")).output.name
    'a.nii.gz'
    """

    command: str
    input: Path
    output: Path
    options: tuple[str, ...] = ()
    plugins: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        if self.input.resolve() == self.output.resolve():
            raise DataError(f"{self.output}: the run would write over what it reads; choose another output")


@dataclass(frozen=True)
class RunRecord:
    """What became of a run.

    Parameters
    ----------
    key : str
        The hash of all that the output depends on; empty where that could not be read.
    state : str
        "begun", "done", "failed", or "kept" where an earlier run had made the output.
    reason : str, optional
        Of a failure.
    seconds : float, optional
        That the run took, s.
    worker : str, optional
        Name of the machine.
    notes : tuple of str, optional
        What the command warned of.
    report : dict, optional
        Figures that the command gave, by name.
    size : int, optional
        Bytes of the output; none of a folder.

    Examples
    --------
    >>> pp.RunRecord("", "failed", "scan.h5: no such file").state
    'failed'
    """

    key: str
    state: str
    reason: str = ""
    seconds: float = 0.0
    worker: str = ""
    notes: tuple[str, ...] = ()
    report: dict[str, Any] = field(default_factory=dict)
    size: int | None = None


def command_line(run: CommandRun) -> list[str]:
    """The words of the command line, without `palpate`."""
    plugins = [word for path in run.plugins for word in ("--plugin", str(path))]
    return [*plugins, run.command, *run.options, str(run.input), "-o", str(run.output)]


def absolute_run(run: CommandRun) -> CommandRun:
    """The same for a process with another working directory: each word that names a file does so from the root."""
    options = tuple(str(Path(word).resolve()) if is_path(word) else word for word in run.options)
    plugins = tuple(path.resolve() for path in run.plugins)
    return CommandRun(run.command, run.input.resolve(), run.output.resolve(), options, plugins)


def run_key(run: CommandRun) -> str:
    """A hash of all that the output depends on: the version, the words, and the contents of the files they name.

    Raises `FileError` where one cannot be read.
    """
    words = [__version__, run.command, content_hash(run.input)]
    words += [content_hash(Path(word)) if is_path(word) else word for word in run.options]
    words += [content_hash(path) for path in run.plugins]
    return hashlib.sha256(json.dumps(words).encode()).hexdigest()


def is_made(record: RunRecord, output: Path) -> bool:
    """Whether the output is there as the run has left it."""
    return record.state == "done" and output.exists() and record.size == size_of(output)


def record_path(output: Path) -> Path:
    """Where the record of the run that writes `output` is."""
    return output.with_name(f"{output.name}.run.json")


def write_record(output: Path, record: RunRecord) -> None:
    """Writes it beside the output. Raises `FileError`."""
    with replacing(record_path(output)) as temporary:
        temporary.write_text(json.dumps({"kind": KIND, **vars(record)}, indent=1) + "\n", encoding="utf-8")


def read_record(output: Path) -> RunRecord | None:
    """The record beside an output; none where there is none, or one that cannot be read."""
    try:
        held = parse_json(read_text(record_path(output)))
        if held.pop("kind") != KIND:
            return None
        return RunRecord(**{**held, "notes": tuple(held["notes"])})
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None


def is_path(word: str) -> bool:
    """Whether a word of a command line names a file that is there. "map" is a method, even where a folder has that name."""
    try:
        named = not word.startswith("-") and ("/" in word or (not word.rpartition(".")[2].isdigit() and "." in word))
        return named and Path(word).exists()
    except (OSError, ValueError):  # a text that is too long for a name
        return False


def size_of(path: Path) -> int | None:
    """Bytes of a file; none of a folder."""
    return path.stat().st_size if path.is_file() else None


def content_hash(path: Path) -> str:
    """SHA-256 of a file, or of the names and contents in a folder. Raises `FileError`."""
    try:
        if not path.is_dir():
            with path.open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        digest = hashlib.sha256()
        for inner in sorted(p for p in path.rglob("*") if p.is_file()):
            digest.update(f"{inner.relative_to(path).as_posix()} {content_hash(inner)}\n".encode())
        return digest.hexdigest()
    except FileNotFoundError:
        raise FileError(f"{path}: does not exist") from None
    except OSError as problem:
        raise FileError(f"{path}: cannot be read ({problem.strerror or problem})") from None
