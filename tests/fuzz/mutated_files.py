"""Damaged files on purpose: whatever is in them, a reader answers with a volume, a scan, or a clear refusal.

    python tests/fuzz/mutated_files.py 5000 --seed 1

makes so many mutants of valid DICOM, HDF5, NIfTI and geometry files and reads each in a worker process that has 2 GB of
memory and ten seconds for it. It prints what came of them, and ends with 1 if one crashed, hung, took more memory, or let
an error out that is not palpate's own or does not name the file. A mutant is made again from its number and the seed.
"""

import argparse
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from itertools import count as counting
from pathlib import Path

import numpy as np

MEMORY = 2 * 1024**3
SECONDS = 10
HOSTILE = [0, 0xFF, 0x7F, 0x80]
WORDS = [
    "",
    "nan",
    "inf",
    "-1",
    "0",
    "1e308",
    "99999999999",
    "abc",
    "1\\2\\3\\4\\5\\6\\7",
    "\x00",
    "é",
    "9" * 300,
    "-0.0",
]
YAML = [
    "",
    "nan",
    ".inf",
    "-1",
    "0",
    "1e308",
    "99999999999",
    "abc",
    "[]",
    "{}",
    "[1, 2]",
    "null",
    "true",
    "'",
    "&a [*a]",
]


# --- the valid files -------------------------------------------------------------------------------------------------


def seeds(folder):
    """Kind of reader and path of each valid file, made in `folder`."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from pydicom.uid import JPEG2000Lossless, RLELossless
    from support import dicom_files

    import palpate as pp
    from palpate.scans.geometry_template import template
    from palpate.volumes import dicom_items

    folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    volume = pp.Volume(rng.random((3, 8, 9)), pp.Grid((3, 8, 9), (2, 1, 1)))
    number, generate = counting(10**20), dicom_items.generate_uid
    dicom_items.generate_uid = lambda prefix=None: (
        f"2.25.{next(number)}"
    )  # of one length, so that a mutant is repeatable
    try:
        for name in ("v.nii", "v.nii.gz", "v.tif", "v.ome.tif", "tomosynthesis.dcm"):
            pp.write_volume(folder / name, volume)
    finally:
        dicom_items.generate_uid = generate
    (folder / "series").mkdir()
    y = np.full((3, 30, 40), 50_000, np.uint16)
    y[:, 10:20, 10:20] = rng.integers(5_000, 20_000, (3, 10, 10))
    for k in range(3):
        dicom_files.ct_slice(folder / "series" / f"{k}.dcm", y[k], (0, 0, 2.0 * k))
    (folder / "views").mkdir()
    for k in range(3):
        dicom_files.view(folder / "views" / f"{k}.dcm", y[k], PositionerPrimaryAngle=10 * k - 10, InstanceNumber=k)
    dicom_files.breast_projection(folder / "projections.dcm", y, [-10, 0, 10])
    frames = [
        dicom_files.item(PlanePositionSequence=[dicom_files.item(ImagePositionPatient=[0, 0, k])]) for k in range(2)
    ]
    shared = dicom_files.item(
        PixelMeasuresSequence=[dicom_files.item(PixelSpacing=[1, 1])],
        PlaneOrientationSequence=[dicom_files.item(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])],
    )
    for name, syntax in (("rle.dcm", RLELossless), ("jpeg2000.dcm", JPEG2000Lossless)):
        pixels = rng.integers(0, 500, (2, 64, 64)).astype(np.uint16)
        tags = {"PerFrameFunctionalGroupsSequence": frames, "SharedFunctionalGroupsSequence": [shared]}
        dicom_files.save(folder / name, dicom_files.ENHANCED_CT, pixels, syntax, Modality="CT", **tags)
    panel = pp.Panel((30, 40), (1, 1), (-20, -15, 0))
    scan = pp.Scan(y, 50_000, pp.arc_views(panel, [-10, 0, 10], radius=600))
    pp.write_scan(folder / "scan.h5", scan)
    for motion in ("arc", "rotating", "free"):
        (folder / f"{motion}.yaml").write_text(template(motion))
    volumes = ("v.nii", "v.nii.gz", "tomosynthesis.dcm", "series", "rle.dcm", "jpeg2000.dcm", "v.tif", "v.ome.tif")
    return [
        *(("read_volume", folder / name) for name in volumes),
        *(("read_scan", folder / name) for name in ("views", "projections.dcm", "scan.h5", "scan.h5")),
        *(("read_geometry", folder / f"{motion}.yaml") for motion in ("arc", "rotating", "free")),
    ]


# --- the damage ------------------------------------------------------------------------------------------------------


def of_bytes(path, rng):
    """Flips, runs of one hostile value, cuts, doubled and missing stretches; half of them in the first 2 kB."""
    data = bytearray(path.read_bytes())
    reach = min(len(data), 2048) if rng.random() < 0.5 else len(data)
    kind = rng.integers(6)
    at = int(rng.integers(reach))
    length = int(2 ** rng.integers(0, 8))
    if kind == 0:
        for place in rng.integers(0, reach, rng.integers(1, 30)):
            data[place] = rng.integers(256)
    elif kind == 1:
        data[at : at + int(2 ** rng.integers(0, 4))] = bytes([rng.choice(HOSTILE)]) * int(2 ** rng.integers(0, 4))
    elif kind == 2:
        del data[at:]
    elif kind == 3:
        del data[at : at + length]
    elif kind == 4:
        data[at:at] = data[at : at + length]
    else:
        data[at ^ 1 if at ^ 1 < len(data) else at] ^= 1 << int(rng.integers(8))
    path.write_bytes(bytes(data))


def of_tags(path, rng):
    """One DICOM tag, somewhere in the tree, is left out, emptied, or given a value that cannot be."""
    import pydicom

    dataset = pydicom.dcmread(path)
    elements = [(home, element.tag) for home in nested(dataset) for element in home if element.tag != (0x7FE0, 0x10)]
    for _ in range(rng.integers(1, 3)):
        home, tag = elements[rng.integers(len(elements))]
        if tag not in home:
            continue
        element = home[tag]
        if rng.random() < 0.3 or element.VR == "SQ":
            del home[tag]
            continue
        word = WORDS[rng.integers(len(WORDS))]
        try:
            if element.VR in ("US", "SS", "UL", "SL"):
                element.value = int(rng.choice([0, 1, 2, 255, 4096, 32767, 65535])) & (
                    0x7FFF if element.VR[0] == "S" else 0xFFFF
                )
            elif element.VR in ("FD", "FL"):
                value = float(rng.choice([np.nan, np.inf, 0, -1, 1e38, 1e-38]))
                element.value = [value] * max(1, element.VM - int(rng.integers(2)))
            elif element.VM > 1:
                element.value = [word] * int(rng.integers(1, element.VM + 2))
            else:
                element.value = word
        except (ValueError, TypeError, OverflowError):
            del home[tag]
    try:
        with pydicom.config.disable_value_validation():
            dataset.save_as(path)
    except (OSError, ValueError, TypeError, AttributeError, KeyError):  # a value that no DICOM file can hold
        of_bytes(path, rng)


def nested(dataset):
    yield dataset
    for element in dataset:
        if element.VR == "SQ":
            for inner in element.value:
                yield from nested(inner)


def of_datasets(path, rng):
    """One HDF5 dataset is left out, or another in its place: huge and unwritten, a text, complex, NaN, of no axis."""
    import h5py

    with h5py.File(path, "r+") as file:
        names = []
        file.visititems(lambda name, thing: names.append(name) if isinstance(thing, h5py.Dataset) else None)
        name = names[rng.integers(len(names))]
        old = file[name][()]
        del file[name]
        kind = rng.integers(9)
        shape = tuple(int(n * rng.choice([1, 1000, 10**6])) for n in old.shape)
        if kind == 0:
            file.create_dataset(
                name, shape=shape, dtype=rng.choice(["f4", "f8", "u1"]), chunks=True if old.ndim else None
            )
        elif kind == 1:
            file[name] = "text"
        elif kind == 2:
            file[name] = old * 1j
        elif kind == 3:
            file[name] = np.full(old.shape, rng.choice([np.nan, np.inf, -1, 0, 1e300]))
        elif kind == 4:
            file[name] = old[..., :-1]
        elif kind == 5:
            file[name] = old[None]
        elif kind == 6:
            file.create_group(name)
        elif kind == 7:
            file[name] = float(rng.choice([0, np.nan, -5]))
        if rng.random() < 0.2:
            file.attrs[str(rng.choice(["format", "version"]))] = str(rng.choice(["x", "nan", "2"]))


def of_nifti(path, rng):
    """One field of a NIfTI-1 header takes a value that cannot be."""
    data = bytearray(path.read_bytes())
    fields = [(40 + 2 * k, "<i2") for k in range(8)] + [(76 + 4 * k, "<f4") for k in range(8)]
    fields += [
        (70, "<i2"),
        (72, "<i2"),
        (0, "<i4"),
        (108, "<f4"),
        (112, "<f4"),
        (116, "<f4"),
        (123, "u1"),
        (252, "<i2"),
    ]
    fields += [(254, "<i2"), *((256 + 4 * k, "<f4") for k in range(18)), (344, "u1"), (348, "u1")]
    for _ in range(rng.integers(1, 4)):
        at, kind = fields[rng.integers(len(fields))]
        kind = np.dtype(kind)
        value = (
            rng.choice([0, -1, 1, 2, 32767, -32768, 300])
            if kind.kind != "f"
            else rng.choice([np.nan, np.inf, 0, -1, 1e38, 1e-38])
        )
        data[at : at + kind.itemsize] = np.array(value).astype(kind).tobytes()
    path.write_bytes(bytes(data))


def of_text(path, rng):
    """A value or a line of a YAML text is another, is missing, is doubled, or moves to another depth."""
    lines = path.read_text().splitlines()
    live = [k for k, line in enumerate(lines) if line.strip() and not line.strip().startswith("#")]
    for _ in range(rng.integers(1, 4)):
        k = int(rng.choice(live))
        kind = rng.integers(6)
        word = YAML[rng.integers(len(YAML))]
        key, colon, value = lines[k].partition(":")
        if kind <= 2 and colon:
            parts = value.split("#")[0].strip().strip("[]").split(",")
            parts[rng.integers(len(parts))] = word
            lines[k] = f"{key}: {'[' if '[' in value else ''}{', '.join(parts)}{']' if ']' in value else ''}"
        elif kind == 3:
            lines[k] = ""
        elif kind == 4:
            lines[k] = "  " + lines[k]
        else:
            lines[k] = lines[k] + "\n" + lines[k].replace(":", f": {word}" if rng.random() < 0.5 else ":", 1)
    path.write_text("\n".join(lines) + "\n")


def mutated(source, folder, rng):
    """A damaged copy of a valid file, or of a folder of which one file is damaged."""
    target = folder / source.name
    if source.is_dir():
        shutil.copytree(source, target)
        files = sorted(target.iterdir())
        victim = files[rng.integers(len(files))]
    else:
        shutil.copy(source, target)
        victim = target
    own = {".dcm": of_tags, ".h5": of_datasets, ".nii": of_nifti, ".yaml": of_text}.get(victim.suffix, of_bytes)
    (own if rng.random() < 0.5 else of_bytes)(victim, rng)
    return target


# --- the readers -----------------------------------------------------------------------------------------------------


def work():
    """Reads what it is told, line by line, and says what came of it."""
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    import palpate as pp
    from palpate.errors import PalpateError

    for line in sys.stdin:
        reader, path = json.loads(line)
        try:
            result = getattr(pp, reader)(path)
            values = {"read_volume": "values", "read_scan": "counts"}.get(reader)
            outcome = "valid" if values is None or np.isfinite(getattr(result, values)).all() else "not finite"
        except PalpateError as refusal:
            outcome = "refused" if Path(path).name in str(refusal) else f"names no file: {refusal}"
        except BaseException as problem:
            import traceback

            place = traceback.extract_tb(problem.__traceback__)[-1]
            outcome = f"{type(problem).__name__}: {str(problem)[:200]} ({place.filename}:{place.lineno})"
        print(json.dumps(outcome), flush=True)


class Worker:
    """A process that reads, started anew after a crash or a hang."""

    def __init__(self):
        self.process = None

    def ask(self, reader, path):
        if self.process is None or self.process.poll() is not None:
            environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
            command = [sys.executable, __file__, "--worker"]
            pipe = subprocess.PIPE
            self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment)
            self.tell("read_volume", "none")  # what it takes to start is not the file's
            self.process.stdout.readline()
        self.tell(reader, str(path))
        if not select.select([self.process.stdout], [], [], SECONDS)[0]:
            self.stop()
            return "hang"
        answer = self.process.stdout.readline()
        return json.loads(answer) if answer else f"crash (exit {self.process.wait()})"

    def tell(self, reader, path):
        self.process.stdin.write(json.dumps([reader, path]) + "\n")
        self.process.stdin.flush()

    def stop(self):
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process.stdin.close()
            self.process.stdout.close()
            self.process = None


def run(count, seed, keep=None, first=0):
    """How often each reader did what, and the failures: number, file, outcome. keep: a folder for mutants that failed."""
    told, failures, worker = Counter(), [], Worker()
    with tempfile.TemporaryDirectory() as folder:
        valid = seeds(Path(folder) / "valid")
        for n in range(first, first + count):
            rng = np.random.default_rng([seed, n])
            reader, source = valid[n % len(valid)]
            where = Path(folder) / "mutant"
            where.mkdir()
            target = mutated(source, where, rng)
            outcome = worker.ask(reader, target)
            told[f"{source.name}: {outcome if outcome in ('valid', 'refused') else 'FAILED'}"] += 1
            if outcome not in ("valid", "refused"):
                failures.append((n, source.name, outcome))
                if keep:
                    shutil.copytree(where, Path(keep) / str(n))
            shutil.rmtree(where)
    worker.stop()
    return told, failures


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--keep", help="folder for the mutants that failed")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        work()
        return 0
    told, failures = run(given.count, given.seed, given.keep, given.first)
    for name, times in sorted(told.items()):
        print(f"{times:6d}  {name}")
    for n, name, outcome in failures:
        print(f"mutant {n} of {name}: {outcome}")
    print(f"{given.count} mutants, seed {given.seed}: {len(failures)} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
