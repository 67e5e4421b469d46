"""A small sample of `make mutate`, and that the machinery would see what it is there to see."""

import subprocess
import sys
from pathlib import Path

import pytest
from fuzz import hostile_files, mutated_files

import palpate as pp
from palpate.errors import FileError

SAMPLE = 150


def test_files_that_lie_about_themselves_are_refused_in_one_line():
    """One of each format and class, each in a process of its own. `make mutate` makes thirteen of each."""
    script = Path(hostile_files.__file__)
    told = subprocess.run([sys.executable, script, "1", "--seed", "3"], capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stdout + told.stderr
    assert told.stdout.splitlines()[-1] == "100 files, seed 3: 0 failures"


@pytest.mark.parametrize(
    ("asked", "wrong"),
    [
        ((2, "palpate: v.nrrd: truncated", 1, 10**8), "refused"),
        ((0, "", 1, 10**8), "exit 0: "),
        ((1, "ValueError: x", 1, 10**8), "exit 1: ValueError: x"),
        ((2, "palpate: truncated", 1, 10**8), "names no file: palpate: truncated"),
        ((2, "note: x\npalpate: v.nrrd: truncated", 1, 10**8), "2 lines"),
        ((2, "palpate: v.nrrd: " + "x" * 3000, 1, 10**8), "a line of 3017 characters"),
        ((2, "palpate: v.nrrd: truncated", 11, 10**8), "too long"),
        ((2, "palpate: v.nrrd: truncated", 1, 2 * 10**9), "1907 MB"),
    ],
)
def test_what_is_no_good_refusal_is_seen(asked, wrong):
    assert hostile_files.verdict("v.nrrd", *asked).startswith(wrong)


@pytest.mark.filterwarnings("ignore:Invalid value for VR")
def test_damaged_files_are_read_or_refused():
    told, failures = mutated_files.run(SAMPLE, seed=7)
    assert failures == []
    assert sum(told.values()) == SAMPLE
    refused = sum(times for name, times in told.items() if name.endswith("refused"))
    assert SAMPLE / 4 < refused < SAMPLE  # most damage matters, some does not


def test_a_mutant_is_the_same_again(tmp_path):
    kept = []
    for again in ("a", "b"):
        folder = tmp_path / again
        valid = mutated_files.seeds(folder / "valid")
        target = mutated_files.mutated(valid[0][1], folder, mutated_files.np.random.default_rng([1, 3]))
        kept.append(target.read_bytes())
        assert kept[0] != valid[0][1].read_bytes()
    assert kept[0] == kept[1]


def test_a_heap_of_texts_without_end_is_refused(tmp_path):
    """Mutant 220 of seed 2: the HDF5 library itself would read free space of no length for ever."""
    panel = pp.Panel((3, 4), (1, 1), (0, 0, 0))
    pp.write_scan(tmp_path / "s.h5", pp.Scan(mutated_files.np.ones((1, 3, 4)), 1, pp.Views([[0, 0, 600]], panel)))
    whole = (tmp_path / "s.h5").read_bytes()
    heap = whole.index(b"GCOL")
    at = heap + 16
    while whole[at : at + 2] != b"\0\0":  # past the texts to the free space
        at += 16 + (int.from_bytes(whole[at + 8 : at + 16], "little") + 7) // 8 * 8
    assert int.from_bytes(whole[at + 8 : at + 16], "little") > 0
    (tmp_path / "s.h5").write_bytes(whole[: at + 8] + bytes(8) + whole[at + 16 :])
    for reader in (pp.read_scan, pp.read_record):
        with pytest.raises(FileError, match=rf"s\.h5: damaged HDF5 file \(a heap of texts without end at byte {at}\)"):
            reader(tmp_path / "s.h5")


@pytest.mark.parametrize(
    ("reader", "outcome"),
    [
        ("__import__('os')._exit", "crash"),
        ("__import__('time').sleep", "hang"),
        ("bytearray", "MemoryError"),
        ("int", "ValueError"),
    ],
)
def test_what_must_not_be_is_seen(tmp_path, monkeypatch, reader, outcome):
    """A worker whose reader crashes, hangs, asks for too much, or lets a foreign error out."""
    spoilt = tmp_path / "spoilt.py"
    action = {"bytearray": "bytearray(3 * 2**30)", "int": "int('x')"}.get(reader, f"{reader}(99)")
    spoilt.write_text(
        f"import sys\nsys.path.insert(0, {str(mutated_files.Path(mutated_files.__file__).parents[1])!r})\n"
        f"from fuzz import mutated_files as mutations\nimport palpate as pp\n"
        f"pp.read_volume = lambda path: {action} if path != 'none' else None\n"
        "mutations.work()\n"
    )
    monkeypatch.setattr(mutated_files, "__file__", str(spoilt))
    monkeypatch.setattr(mutated_files, "SECONDS", 2)
    worker = mutated_files.Worker()
    assert worker.ask("read_volume", tmp_path / "v.nii").startswith(outcome)
    worker.stop()
