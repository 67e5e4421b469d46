"""The whole study: one folder, one report."""

from collections.abc import Callable
from pathlib import Path


def tomosynthesis_study(
    folder: str | Path,
    *,
    quick: bool = False,
    resume: bool = False,
    docs: str | Path | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Path:
    """The study's report.html in `folder`."""
    raise NotImplementedError
