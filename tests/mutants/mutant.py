"""One deliberate fault."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Mutant:
    """A piece of one line put in place of another.

    line: from 1. start, end: columns of the piece in that line, in characters. operator: what kind of fault it is.
    """

    line: int
    start: int
    end: int
    text: str
    operator: str

    def applied(self, source: str) -> str:
        """The source with the fault."""
        lines = source.splitlines(keepends=True)
        at = lines[self.line - 1]
        lines[self.line - 1] = at[: self.start] + self.text + at[self.end :]
        return "".join(lines)
