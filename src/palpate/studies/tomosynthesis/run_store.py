"""The runs on disk: each made once, kept as it ends, so that an interrupted study goes on."""

from pathlib import Path

import numpy as np

from palpate.arrays import Float64
from palpate.atomic_write import replacing
from palpate.report.stages import Progress, Stages
from palpate.studies.run_store import read_json, write_json
from palpate.studies.tomosynthesis.config import Setting
from palpate.studies.tomosynthesis.experiment_runner import ExperimentRunner
from palpate.studies.tomosynthesis.experiments import Record, experiments
from palpate.studies.tomosynthesis.image_quality import ImageQuality
from palpate.volumes.io import write_volume


def run_all(stages: Stages, setting: Setting, progress: Progress) -> tuple[list[Record], ImageQuality]:
    """The records of all runs: those of an earlier run are read where `stages` resumes. Raises `FileError`."""
    (stages.folder / "volumes").mkdir(exist_ok=True)
    image_quality = ImageQuality(setting)

    def passed(motion: str) -> Float64:
        path = f"runs/passed-{motion}.npy"
        return stages(path, lambda: setting.passed(motion), _write_array, lambda there: np.load(there))

    runner, records = ExperimentRunner(image_quality, passed), []
    if not (stages.resume and (stages.folder / "volumes/truth.nii.gz").exists()):
        write_volume(stages.folder / "volumes/truth.nii.gz", image_quality.truth)
    every = list(experiments(setting))
    for k, experiment in enumerate(every):
        progress(f"run {k + 1} of {len(every)}: {experiment.name}", k / len(every))

        def make(experiment=experiment) -> Record:  # type: ignore[no-untyped-def]
            record, volumes = runner.run(experiment)
            for part, volume in volumes.items() if experiment.keep else ():
                write_volume(stages.folder / f"volumes/{experiment.name}{part}.nii.gz", volume)
            return record

        record = stages(f"runs/{experiment.name}.json", make, write_json, read_json)
        runner.take_note(record)
        records.append(record)
    progress(f"{len(every)} runs", 1.0)
    return records, image_quality


def _write_array(path: Path, values: Float64) -> None:
    with replacing(path) as temporary:
        np.save(temporary, values)
