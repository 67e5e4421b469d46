"""Checkpoints: an HDF5 file from which a stopped run resumes. It is replaced as a whole."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from palpate.bounded_read import parse_json
from palpate.errors import FileError
from palpate.reconstruction.iterate import Step
from palpate.scans.scan import Scan
from palpate.volumes.grid import Grid
from palpate.volumes.hdf5_guard import check_heap, read_dataset
from palpate.volumes.hdf5_output import replacing_hdf5
from palpate.volumes.volume import Labels, Volume

KIND = "palpate checkpoint 2"
SPELLED = {"optimizer": "optimiser"}  # settings whose name in the file is that of version 0.1


def checkpoint_path(output: str | Path) -> Path:
    """The path of the checkpoint of a run that writes `output`."""
    output = Path(output)
    return output.with_name(f"{output.name}.checkpoint.h5")


def fingerprint(scan: Scan, settings: Mapping[str, Any]) -> dict[str, str]:
    """What must be equal for a run to resume: the settings as texts, and a hash of the scan."""
    digest = hashlib.sha256()
    for array in (scan.counts, scan.incident, scan.background, scan.mask, scan.views.source):
        digest.update(np.ascontiguousarray(array).tobytes())
    for panel in scan.views.panels:
        pose = (*panel.pitch, *panel.origin, *panel.row_axis, *panel.column_axis)
        digest.update(np.array(pose, dtype=np.float64).tobytes())
    blur = {} if scan.blur is None else {"blur": str(scan.blur)}
    texts = {SPELLED.get(name, name): _words(value) for name, value in settings.items()}
    return {"scan": digest.hexdigest()[:16], **blur, **texts}


def write_checkpoint(path: str | Path, step: Step, run: Mapping[str, str]) -> None:
    """Writes the state after `step`; `run` is the run's `fingerprint`. Raises `FileError`."""
    with replacing_hdf5(path) as file:
        file.attrs["kind"] = KIND
        file.attrs["run"] = json.dumps(dict(run))
        grid = step.volume.grid
        for name in ("spacing", "origin", "direction"):
            file.attrs[name] = np.asarray(getattr(grid, name), dtype=np.float64)
        for name in ("objective", "level", "iteration", "seconds", "finished"):
            file.attrs[name] = getattr(step, name)
        file["values"] = step.volume.values
        if step.previous is not None:
            file["previous"] = step.previous
        file.attrs["pace"] = np.array(step.pace, np.float64)
        for name, array in step.state.items():
            file[f"state/{name}"] = array


def read_checkpoint(path: str | Path, run: Mapping[str, str]) -> Step:
    """The step after which to go on. Raises `FileError` if the file is missing, truncated, or of another run."""
    path = Path(path)
    if not path.exists():
        raise FileError(f"{path}: there is no checkpoint here to go on from; leave out --resume to start afresh")
    check_heap(path)
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("kind") != KIND:
                raise FileError(f"{path}: not a checkpoint of palpate reconstruct; leave out --resume")
            held = parse_json(str(file.attrs["run"]))
            values = read_dataset(path, file, "values")
            grid = Grid(values.shape, *(file.attrs[name] for name in ("spacing", "origin", "direction")))
            objective, seconds = float(file.attrs["objective"]), float(file.attrs["seconds"])
            level, iteration = int(file.attrs["level"]), int(file.attrs["iteration"])
            previous = read_dataset(path, file, "previous") if "previous" in file else None
            if previous is not None and previous.shape != values.shape:
                raise ValueError(f"previous: expected shape {values.shape}, got {previous.shape}")
            finished, pace = bool(file.attrs["finished"]), tuple(map(float, file.attrs["pace"]))
            state = {name: read_dataset(path, file, f"state/{name}") for name in file.get("state", {})}
            step = Step(Volume(values, grid), objective, level, iteration, seconds, finished, previous, pace, state)
    except (FileError, MemoryError):
        raise
    except Exception as problem:  # h5py raises almost anything on a damaged file
        raise FileError(f"{path}: truncated or damaged ({problem}); remove it and start afresh") from None
    differing = [name for name in sorted(set(held) | set(run)) if held.get(name) != run.get(name)]
    if differing:
        differences = "; ".join(f"{name} was {held.get(name)}, now {run.get(name)}" for name in differing)
        raise FileError(f"{path}: belongs to another run ({differences}); give the same options, or leave out --resume")
    return step


def with_checkpoints(steps: Iterator[Step], path: str | Path, run: Mapping[str, str], every: int) -> Iterator[Step]:
    """The same steps; every `every`-th is kept at `path`, and the last one whatever stops the run, Ctrl-C included."""
    last, kept = None, True
    try:
        for count, step in enumerate(steps, start=1):
            last, kept = step, False
            if count % every == 0 or step.finished:
                write_checkpoint(path, step, run)
                kept = True
            yield step
    finally:
        if last is not None and not kept:
            write_checkpoint(path, last, run)


def _words(value: Any) -> str:
    if isinstance(value, Grid):
        return f"{value.shape} voxels of {value.spacing} mm from {value.origin}"
    if isinstance(value, Labels | Volume):
        return hashlib.sha256(value.values.tobytes()).hexdigest()[:16]
    text = str(value).replace("'generalized'", "'generalised'")  # as version 0.1 wrote it
    return text.replace(", resolution=None", "").replace(", smooth=False", "")  # which it did not know
