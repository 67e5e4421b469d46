"""The runs on disk: each made once, kept as it ends, so that an interrupted study goes on."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from palpate.arrays import Float64
from palpate.atomic import replacing
from palpate.studies.records import read_json, same_study, write_json
from palpate.studies.stages import Stages
from palpate.studies.tomosynthesis.experiments import Laboratory, Record, cells
from palpate.studies.tomosynthesis.judge import Judge
from palpate.studies.tomosynthesis.setting import Setting
from palpate.volumes.files import write_volume

Say = Callable[[str, float], None]
FOLDERS = ("runs", "volumes", "figures", "tables")


def run_all(stages: Stages, setting: Setting, say: Say) -> tuple[list[Record], Judge]:
    """The records of all runs: those of an earlier run are read where `stages` resumes. Raises `FileError`."""
    for name in FOLDERS:
        (stages.folder / name).mkdir(exist_ok=True)
    same_study(stages, f"tomosynthesis{' --quick' if setting.quick else ''}")
    judge = Judge(setting)

    def passed(motion: str) -> Float64:
        path = f"runs/passed-{motion}.npy"
        return stages(path, lambda: setting.passed(motion), _write_array, lambda there: np.load(there))

    laboratory, records = Laboratory(judge, passed), []
    if not (stages.resume and (stages.folder / "volumes/truth.nii.gz").exists()):
        write_volume(stages.folder / "volumes/truth.nii.gz", judge.truth)
    every = list(cells(judge))
    for k, cell in enumerate(every):
        say(f"run {k + 1} of {len(every)}: {cell.name}", k / len(every))

        def make(cell=cell) -> Record:  # type: ignore[no-untyped-def]
            record, volume = laboratory.run(cell)
            if cell.keep:
                write_volume(stages.folder / f"volumes/{cell.name}.nii.gz", volume)
            return record

        record = stages(f"runs/{cell.name}.json", make, write_json, read_json)
        laboratory.learn(record)
        records.append(record)
    say(f"{len(every)} runs", 1.0)
    return records, judge


def _write_array(path: Path, values: Float64) -> None:
    with replacing(path) as temporary:
        np.save(temporary, values)
