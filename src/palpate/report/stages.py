"""A long job as a chain of files: each stage makes one, or reads what an earlier run left."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from palpate.atomic_write import output_folder, replacing
from palpate.errors import FileError
from palpate.version import __version__

T = TypeVar("T")
Progress = Callable[[str, float], None]  # what is being done, and the share of it that is done


def silent(what: str, share: float) -> None:
    """Shows no progress."""


@dataclass(frozen=True)
class Stages:
    """folder: where the files lie. resume: use files that are there. progress(what, share): told how far a stage is.

    Raises `FileError` when the folder cannot be written, before any work.
    """

    folder: Path
    resume: bool = False
    progress: Progress = silent
    made: list[Path] = field(default_factory=list)

    def __post_init__(self) -> None:
        object.__setattr__(self, "folder", output_folder(self.folder))

    def claim(self, kind: str, name: str) -> None:
        """Marks the folder with the study or demo that is run there.

        Raises `FileError` where it holds another: files of the same names would be resumed.
        """
        mark, now = self.folder / f"{kind}.txt", f"{name}, palpate {__version__}\n"
        if mark.exists() and mark.read_text() != now:
            raise FileError(
                f"{self.folder}: holds the {kind} {mark.read_text().strip()!r}, not {now.strip()!r}; "
                f"choose another folder with -o, or remove that one"
            )
        with replacing(mark) as temporary:
            temporary.write_text(now)

    def __call__(
        self, name: str, make: Callable[[], T], write: Callable[[Path, T], None], read: Callable[[Path], T]
    ) -> T:
        """The thing in file `name`: read if there and resuming, else made and written, whole or not at all."""
        path = self.folder / name
        self.made.append(path)
        if self.resume and path.exists():
            self.progress(f"{name}: as left by the earlier run", 1.0)
            return read(path)
        self.progress(name, 0.0)
        thing = make()
        write(path, thing)
        self.progress(name, 1.0)
        return thing
