"""What the report's sections are made from."""

from collections.abc import Mapping
from dataclasses import dataclass

from palpate.studies.deformation.setting import Setting
from palpate.studies.tables import Row

ONE = 0.3  # Poisson's ratio of the pictures that show one


@dataclass(frozen=True)
class Told:
    """command: what makes the report. tables: all of the study, by name."""

    command: str
    setting: Setting
    tables: Mapping[str, list[Row]]

    def caption(self, words: str) -> str:
        """With the command."""
        return f"{words} Made by: {self.command}"
