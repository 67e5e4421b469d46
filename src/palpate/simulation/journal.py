"""What a loop has done, drained often, in few arrays: an hour of it must not become a million small ones."""

from typing import Any

import numpy as np

MOST = 512  # small pieces before they are joined


class Journal:
    """Pieces of equal columns, in order."""

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

    def columns(self) -> tuple[Any, ...]:
        """All pieces as one."""
        return _join(self._joined + self._pieces)


def _join(pieces: list[tuple[Any, ...]]) -> tuple[Any, ...]:
    return tuple(np.concatenate(parts) for parts in zip(*pieces, strict=True))
