"""Writes the other files of this folder: PYTHONPATH=tests python tests/data/0.1/make.py, with version 0.1 installed.

It is kept to say how they were made. It uses names of 0.1, and later versions need not run it.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import digest
import numpy as np

import palpate as pp
from palpate.reconstruction import checkpoint

HERE = Path(__file__).parent
GRID = pp.Grid((12, 22, 28), (3, 2, 2), (-27, -21, 4))
OPTIONS = ["--levels", "2", "--iterations", "12", "--tolerance", "0", "--checkpoint-every", "1"]
RUNS = {  # of each checkpoint: the scan, the optimiser, and the iterate after which the run is stopped
    "momentum": ("turned", "auto", 29),
    "swept": ("flat", "auto", 26),
    "subsets": ("turned", "subsets", 28),
    "descent": ("turned", "descent", 10),
}

GEOMETRY = """\
units: cm
values: photons
incident: [5000, 5100, 5200, 5300]
background: 12
unmeasured: -1
stack:
  axes: [view, column, row]
panel:
  shape: [12, 16]
  pitch: [0.2, 0.25]
  centre: [0.3, -0.1, -5]
  row_axis: [0, 1, 0]
  column_axis: [1, 0, 0]
views:
  motion: rotating
  angles: {first: -30, last: 30, count: 4}
  source: [0, 0, 45]
  pivot: [0, 0, 1]
  axis: [0, 1, 0]
"""


def scans():
    """Two scans with a mask, a geometry file with its stack, a template of one, and what is in them."""
    template = HERE / "template.yaml"
    subprocess.run([sys.executable, "-m", "palpate", "scan", "template", "--motion", "arc", "-o", template], check=True)
    views = digest.views_arrays(pp.read_geometry(template).views)
    made = {f"template/{key}": values for key, values in views.items()}
    for name in ("flat", "turned"):
        pp.write_scan(HERE / f"{name}.h5", digest.scan_of(name))
        made.update(arrays_of(name, digest.scan_of(name)))
    (HERE / "geometry.yaml").write_text(GEOMETRY)
    stack = np.random.default_rng(2).integers(100, 5000, (4, 16, 12)).astype(np.int16)
    stack[:, 3, 5] = -1
    np.save(HERE / "stack.npy", stack)
    return {**made, **arrays_of("stack", pp.import_scan(HERE / "stack.npy", HERE / "geometry.yaml"))}


def arrays_of(name, scan):
    made = {key: getattr(scan, key) for key in ("counts", "incident", "background", "mask")}
    made.update(digest.views_arrays(scan.views))
    return {f"{name}/{key}": values for key, values in made.items()}


def stopped(arguments, after):
    """Runs the command in this process and stops it, as Ctrl-C would, after so many checkpoints."""
    write, count = checkpoint.write_checkpoint, 0

    def counted(*words):
        nonlocal count
        write(*words)
        count += 1
        if count == after:
            raise KeyboardInterrupt

    checkpoint.write_checkpoint = counted
    sys.argv = ["palpate", *arguments]
    try:
        pp.commands.main()
    except SystemExit:
        pass
    finally:
        checkpoint.write_checkpoint = write


def volumes():
    """A volume, a checkpoint in the midst of each run, and what the same run gives that is not stopped."""
    import palpate.commands  # noqa: F401

    truth = HERE / "volume.nii.gz"
    pp.write_volume(truth, digest.body().volume(GRID))
    made = {"volume/values": pp.read_volume(truth).values, **grid_arrays("volume", GRID)}
    for name, (scan, optimiser, after) in RUNS.items():
        with tempfile.TemporaryDirectory() as folder:
            output = Path(folder) / "volume.nii.gz"
            words = ["reconstruct", str(HERE / f"{scan}.h5"), "-o", str(output), "--like", str(truth), *OPTIONS]
            words += ["--optimiser", optimiser]
            stopped(words, after)
            shutil.copy(f"{output}.checkpoint.h5", HERE / f"{name}.checkpoint.h5")
            subprocess.run([sys.executable, "-m", "palpate", *words], check=True)
            made[f"resumed/{name}"] = pp.read_volume(output).values
    return made


def grid_arrays(name, grid):
    made = {key: np.array(getattr(grid, key)) for key in ("shape", "spacing", "origin", "direction")}
    return {f"{name}/{key}": values for key, values in made.items()}


def organ():
    """Labels, their mesh, the fitted tissue, a session on it, and its score."""
    labels, tissue = digest.kidney_labels(), digest.kidney()
    pp.write_labels(HERE / "labels.nii.gz", labels)
    pp.write_mesh(HERE / "mesh.vtu", tissue.mesh)
    pp.write_tissue(HERE / "tissue.vtu", tissue)
    tissue = pp.read_tissue(HERE / "tissue.vtu")  # that of the file, whose numbers may be rounded
    session, forces = digest.recorded(tissue)
    pp.write_record(HERE / "session.h5", session.record())
    made = {"labels/values": labels.values, **grid_arrays("labels", labels.grid)}
    made.update({f"mesh/{key}": values for key, values in digest.mesh_arrays(tissue.mesh).items()})
    for key in ("young", "poisson", "fixed"):
        made[f"tissue/{key}"] = getattr(tissue, key)
    made["tissue/springs"] = np.array([tissue.springs.rsc, tissue.springs.scale])
    for key in ("points", "push", "worst", "rms", "truth_force", "spring_force", "error_map"):
        made[f"tissue/{key}"] = getattr(tissue.report, key)
    result = pp.score(session.record(), tissue, pp.Task("biopsy", target="lump", strain=0.1, force=0.5))
    made.update({f"score/{key}": np.array(value) for key, value in digest.figures(result).items()})
    made["score/force"] = result.force
    made["instructions"] = np.array(session.record().instructions)
    return {**made, "session/forces": forces, "session/displacement": session.displacement}


if __name__ == "__main__":
    np.savez_compressed(HERE / "expected.npz", **scans(), **volumes(), **organ())
