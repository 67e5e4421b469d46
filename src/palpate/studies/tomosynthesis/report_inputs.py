"""What the report's sections are made from."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from palpate.report.tables import Row
from palpate.studies.tomosynthesis.config import Setting
from palpate.studies.tomosynthesis.experiments import Record, cell_name
from palpate.studies.tomosynthesis.image_quality import ImageQuality
from palpate.volumes.io import read_volume
from palpate.volumes.volume import Volume

MERITS = (
    ("nmse", "NMSE, full field", ".4f"),
    ("nmse_region", "NMSE, region", ".3f"),
    ("ssim", "SSIM", ".3f"),
    ("cnr", "contrast to noise", ".2f"),
    ("depth_mm", "spread in depth, mm", ".1f"),
)
RUN = ("dose", "method", "optimiser", "start")  # what tells the runs of the comparison apart


@dataclass(frozen=True)
class ReportInputs:
    """folder: of the study, which holds volumes/. records, tables: all of them."""

    folder: Path
    image_quality: ImageQuality
    records: Sequence[Record]
    tables: dict[str, list[Row]]

    @property
    def setting(self) -> Setting:
        """Of the study."""
        return self.image_quality.setting

    def volume(self, experiment: str, dose: int, *more: str, motion: str = "circular") -> Volume:
        """That of a run on the first scan."""
        return read_volume(self.folder / "volumes" / f"{cell_name(experiment, dose, 0, *more, motion=motion)}.nii.gz")
