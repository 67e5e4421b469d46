"""A verdict as one sentence: what was claimed, how it was tried, what came out."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Verdict:
    """held: "holds", "does not hold", or in how many cases. numbers: what came out."""

    claim: str
    tried: str
    held: str
    numbers: str

    @property
    def sentence(self) -> str:
        """Claim, trial and outcome."""
        return f"The chapter claims that {self.claim}; tried {self.tried}, this {self.held}: {self.numbers}."


def outcome(each: Sequence[bool], what: str = "cases") -> str:
    """Of many cases."""
    if all(each):
        return "holds"
    return f"holds in {sum(each)} of {len(each)} {what}" if any(each) else "does not hold"
