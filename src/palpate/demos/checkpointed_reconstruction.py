"""A reconstruction inside a study: checkpointed, resumable, its steps kept for the report."""

from dataclasses import replace
from pathlib import Path

from palpate.reconstruction.checkpoint import fingerprint, read_checkpoint, write_checkpoint
from palpate.reconstruction.iterate import Step
from palpate.reconstruction.reconstruct import iterates
from palpate.report.stages import Stages
from palpate.scans.scan import Scan
from palpate.volumes.grid import Grid
from palpate.volumes.io import read_volume, write_volume
from palpate.volumes.volume import Volume


def reconstruct_stage(
    stages: Stages, scan: Scan, grid: Grid, name: str = "volume.nii.gz", **options: object
) -> tuple[Volume, list[Step]]:
    """The volume in file `name`, and its steps without their volumes (empty if an earlier run made it).

    Options as for `iterates`. After each level a checkpoint lies beside the volume, from which a resumed study goes on.
    """
    steps: list[Step] = []
    checkpoint = stages.folder / f"{name.split('.')[0]}.checkpoint.h5"
    run = fingerprint(scan, {"grid": grid, **options})

    def make() -> Volume:
        resume = read_checkpoint(checkpoint, run) if stages.resume and checkpoint.exists() else None
        step = resume
        for step in iterates(scan, grid, resume=resume, **options):  # type: ignore[arg-type]
            steps.append(replace(step, volume=Volume(step.volume.values[:1, :1, :1], Grid((1, 1, 1), (1, 1, 1)))))
            stages.progress(f"{name}: level {step.level}, iteration {step.iteration}, {step.objective:.5g}", 0.5)
            if step.finished:
                write_checkpoint(checkpoint, step, run)
        assert step is not None
        return step.volume

    def write(path: Path, volume: Volume) -> None:
        write_volume(path, volume)
        checkpoint.unlink(missing_ok=True)

    return stages(name, make, write, read_volume), steps
