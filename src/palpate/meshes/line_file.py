"""A file of lines that ends: meshio reads as many lines as a damaged file says, after its end too."""

import io
from pathlib import Path

LONGEST = 2**20  # bytes of a line
AFTER = 3  # lines asked for after the end; the second says that there is none


class LineFile(io.BufferedReader):
    """A file whose lines have bounded lengths, and whose end is said once. Raises `ValueError`."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self.after = 0

    def readline(self, size: int | None = -1, /) -> bytes:
        """The next line, empty at the end."""
        line = super().readline(LONGEST)
        if len(line) == LONGEST:
            raise ValueError(f"a line of more than {LONGEST} bytes")
        self.after += not line
        if self.after > AFTER:
            raise ValueError("it ends too early")
        return line
