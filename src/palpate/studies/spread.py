"""Spreads the runs of a study over workers, each a file in the study's folder."""

from collections.abc import Sequence
from dataclasses import replace

from palpate.cluster.file_tasks import FileTask, write_files
from palpate.report.stages import Stages


def spread(stages: Stages, tasks: Sequence[FileTask], on: int | str) -> Stages:
    """Has the files made, and returns stages that read them. Raises what `write_files` does.

    What an earlier run has left is made again, unless the stages resume; it stays until that is there.
    """
    write_files(tasks, on, stages.progress, again=not stages.resume)
    return replace(stages, resume=True)
