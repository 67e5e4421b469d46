"""Outputs appear whole or not at all: written under a temporary name beside the target, then renamed.

A run that is killed leaves its temporary behind, `.TARGET.part-HOST-PROCESS-...`; the next run that writes the same
target removes it once that process is gone.
"""

import contextlib
import os
import platform
import re
import shutil
import sys
import uuid
import zlib
from collections.abc import Iterator
from pathlib import Path
from shlex import quote

from palpate import interrupts
from palpate.errors import FileError, PalpateError


def writable(path: str | Path) -> Path:
    """`path`, once it is sure that a file can be made there. Call before long work. Raises `FileError`."""
    path = Path(path)
    folder = path.parent
    if not folder.is_dir():
        raise FileError(f"{path}: folder {folder} does not exist; make it first: mkdir -p {quote(str(folder))}")
    if path.is_dir():
        raise FileError(f"{path}: is a folder; name a file")
    probe = _temporary(path)
    try:
        try:
            probe.touch()
        finally:  # Ctrl-C may come in between
            probe.unlink(missing_ok=True)
    except OSError as problem:
        raise FileError(
            f"{path}: folder {folder} is not writable ({problem.strerror}); choose another folder"
        ) from None
    with contextlib.suppress(OSError):  # tidying is no reason to refuse
        _remove_abandoned(path)
    return path


def output_folder(path: str | Path) -> Path:
    """Folder `path`, made if need be and known to be writable. Raises `FileError`."""
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise FileError(f"{path}: cannot make this folder ({problem.strerror}); choose another") from None
    writable(path / "probe")
    return path


@contextlib.contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Gives a temporary path to write; renames it to `path` when the block ends well, removes it when it does not.

    The temporary name keeps the suffixes (`.nii.gz`), since many writers choose the format by them. Ctrl-C waits until
    the block has ended: within a writer's destructors Python would lose it. A second one does not wait. Raises
    `FileError` for what the disk refuses.
    """
    path = writable(path)
    temporary = _temporary(path)
    with interrupts.waiting():
        try:
            yield temporary
            with temporary.open("rb") as written:
                os.fsync(written.fileno())
            temporary.replace(path)
        except OSError as problem:
            raise _refused(path, problem) from problem
        finally:
            temporary.unlink(missing_ok=True)


def new_folder(path: str | Path) -> Path:
    """`path`, once it is sure that a folder can be made there and that nothing would be lost. Raises `FileError`."""
    path = Path(path)
    if path.is_dir():
        if any(path.iterdir()):
            raise FileError(f"{path}: is there and holds files; remove it, or choose another name")
        return path
    if path.exists():
        raise FileError(f"{path}: is a file; choose another name")
    return writable(path)


@contextlib.contextmanager
def replacing_folder(path: str | Path) -> Iterator[Path]:
    """Gives a temporary folder to fill; renames it to `path` when the block ends well, removes it when it does not.

    `path` may be an empty folder, never one that holds files. Ctrl-C waits, and errors are, as in `replacing`.
    """
    path = new_folder(path)
    temporary = _temporary(path)
    with interrupts.waiting():
        try:
            temporary.mkdir()
            yield temporary
            if path.is_dir():
                path.rmdir()
            temporary.replace(path)
        except OSError as problem:
            raise _refused(path, problem) from problem
        finally:
            shutil.rmtree(temporary, ignore_errors=True)


def _refused(path: Path, problem: OSError) -> OSError:
    """What a writer's error means to the user: a full disk, above all."""
    if isinstance(problem, PalpateError):
        return problem
    return FileError(
        f"{path}: could not be written ({problem.strerror or problem}); make room, or choose another place; "
        f"what was there before is as it was"
    )


def _temporary(path: Path) -> Path:
    """A name beside `path` that no other process uses, now or later."""
    suffixes = "".join(path.suffixes[-2:])
    return path.parent / f"{_stem(path)}{_host()}-{os.getpid()}-{uuid.uuid4().hex[:8]}{suffixes}"


def _stem(path: Path) -> str:
    return f".{path.name[:100]}.part-"


def _host() -> str:
    """Process numbers mean something on one machine only, and folders are shared."""
    return f"{zlib.crc32(platform.node().encode()):08x}"


def _remove_abandoned(path: Path) -> None:
    """Removes the temporaries of `path` that processes of this machine left which no longer run."""
    # Leading dots: a writer that is itself given a temporary name adds its own around it.
    name = re.compile(rf"\.*{re.escape(_stem(path))}{_host()}-(\d+)-")
    for entry in os.listdir(path.parent):
        found = name.match(entry)
        if found and not _runs(int(found[1])):
            left = path.parent / entry
            if left.is_dir():
                shutil.rmtree(left)
            else:
                left.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    if sys.platform == "win32":  # no question there: os.kill would end it
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
