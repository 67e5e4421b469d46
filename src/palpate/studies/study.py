"""What every study shares: its folder, the command that makes it, its tables and its report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from palpate.atomic_write import output_folder
from palpate.report.html_report import Section
from palpate.report.publish import publish
from palpate.report.stages import Stages
from palpate.report.tables import Row, write_tables


@dataclass(frozen=True)
class Study:
    """A study that runs. name: its folder and page. stages: its files. docs: where its page goes, if anywhere.

    variant: what else tells two of one name apart. option: more of the command that makes it. Raises `FileError` unless
    its folders can be written and hold no other.
    """

    name: str
    title: str
    stages: Stages
    quick: bool
    docs: str | Path | None
    variant: str = ""
    option: str = ""

    def __post_init__(self) -> None:
        if self.docs is not None:
            output_folder(self.docs)
        self.stages.claim("study", f"{self.name}{' --quick' if self.quick else ''}{self.variant}")
        for part in ("runs", "figures", "tables"):
            (self.stages.folder / part).mkdir(exist_ok=True)

    @property
    def command(self) -> str:
        """What the user types to make it again."""
        return f"palpate study {self.name}{' --quick' if self.quick else ''}{self.option}"

    def publish(self, tables: Mapping[str, list[Row]], sections: Sequence[Section]) -> Path:
        """Writes tables (those with rows), figures, report and page; every caption names the command.

        Gives the report's path. Raises `FileError`.
        """
        folder, made_by = self.stages.folder, f" Made by: {self.command}"
        write_tables(folder / "tables", {name: rows for name, rows in tables.items() if rows})
        captioned = [
            replace(each, pictures=[(picture, words + made_by) for picture, words in each.pictures])
            for each in sections
        ]
        return publish(folder, self.name, self.title, self.command, captioned, self.docs)
