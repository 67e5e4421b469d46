"""What the report's sections are made from."""

from collections.abc import Mapping
from dataclasses import dataclass

from palpate.report.tables import Row
from palpate.studies.deformation.config import Setting

ONE = 0.3  # Poisson's ratio of the pictures that show one


@dataclass(frozen=True)
class ReportInputs:
    """tables: all of the study, by name."""

    setting: Setting
    tables: Mapping[str, list[Row]]
