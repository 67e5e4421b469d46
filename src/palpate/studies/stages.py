"""A study as a chain of files: each stage makes one, or picks up what an earlier run left."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from palpate.atomic import output_folder

T = TypeVar("T")


@dataclass(frozen=True)
class Stages:
    """folder: where the files lie. resume: use files that are there. progress(what, share): told how far a stage is.

    Raises `FileError` when the folder cannot be written, before any work.
    """

    folder: Path
    resume: bool = False
    progress: Callable[[str, float], None] = lambda what, share: None
    made: list[Path] = field(default_factory=list)

    def __post_init__(self) -> None:
        object.__setattr__(self, "folder", output_folder(self.folder))

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


def begun(
    folder: str | Path,
    resume: bool,
    docs: str | Path | None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Stages:
    """The stages of a study, once it is known that its folder and the one of its page can be written."""
    stages = Stages(Path(folder), resume, progress)
    if docs is not None:
        output_folder(docs)
    return stages
