"""What a check of a scan found."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with a scan, or may be.

    Parameters
    ----------
    cause : str
        A short name of the likely cause, such as "view order".
    message : str
        What was seen, and what to look at.
    alarm : bool, optional
        Whether the volume will be wrong. False marks something that the data cannot decide.

    Examples
    --------
    >>> found = pp.Finding("pixel pitch", "the panel is 4 m wide")
    >>> print(found)
    pixel pitch: the panel is 4 m wide
    """

    cause: str
    message: str
    alarm: bool = True

    def __str__(self) -> str:
        return f"{self.cause}: {self.message}"
