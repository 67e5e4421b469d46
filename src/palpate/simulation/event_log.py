"""The log of a session's events, kept in few large arrays."""

from typing import Any

import numpy as np

MOST = 512  # pieces before they are joined
COLUMNS: dict[str, tuple[Any, str]] = {  # type and units, in the order in which the loop gives them
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


class EventLog:
    """Columns of events, added piece by piece."""

    def __init__(self) -> None:
        self._joined: list[tuple[Any, ...]] = []
        self._pieces: list[tuple[Any, ...]] = []

    def add(self, piece: tuple[Any, ...]) -> None:
        """Appends a tuple of columns."""
        if self._pieces and not any(len(column) for column in piece):
            return
        self._pieces.append(piece)
        if len(self._pieces) >= MOST:
            self._joined.append(_join(self._pieces))
            self._pieces = []

    def columns(self, before: tuple[Any, ...] | None = None) -> dict[str, Any]:
        """All pieces as one, by name. before: columns of earlier events, which are kept elsewhere."""
        earlier = [] if before is None else [before]
        return dict(zip(COLUMNS, _join(earlier + self._joined + self._pieces), strict=True))


def _join(pieces: list[tuple[Any, ...]]) -> tuple[Any, ...]:
    return tuple(np.concatenate(parts) for parts in zip(*pieces, strict=True))
