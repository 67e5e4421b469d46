"""A small sample of `make mutate`, and that the machinery would see what it is there to see."""

import mutations
import pytest

import palpate as pp
from palpate.errors import FileError

SAMPLE = 150


@pytest.mark.filterwarnings("ignore:Invalid value for VR")
def test_damaged_files_are_read_or_refused():
    told, failures = mutations.run(SAMPLE, seed=7)
    assert failures == []
    assert sum(told.values()) == SAMPLE
    refused = sum(times for name, times in told.items() if name.endswith("refused"))
    assert SAMPLE / 4 < refused < SAMPLE  # most damage matters, some does not


def test_a_mutant_is_the_same_again(tmp_path):
    kept = []
    for again in ("a", "b"):
        folder = tmp_path / again
        valid = mutations.seeds(folder / "valid")
        target = mutations.mutated(valid[0][1], folder, mutations.np.random.default_rng([1, 3]))
        kept.append(target.read_bytes())
        assert kept[0] != valid[0][1].read_bytes()
    assert kept[0] == kept[1]


def test_a_heap_of_texts_without_end_is_refused(tmp_path):
    """Mutant 220 of seed 2: the HDF5 library itself would read free space of no length for ever."""
    panel = pp.Panel((3, 4), (1, 1), (0, 0, 0))
    pp.write_scan(tmp_path / "s.h5", pp.Scan(mutations.np.ones((1, 3, 4)), 1, pp.Views([[0, 0, 600]], panel)))
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
        f"import sys\nsys.path.insert(0, {str(mutations.Path(mutations.__file__).parent)!r})\n"
        f"import mutations, palpate as pp\npp.read_volume = lambda path: {action} if path != 'none' else None\n"
        "mutations.work()\n"
    )
    monkeypatch.setattr(mutations, "__file__", str(spoilt))
    monkeypatch.setattr(mutations, "SECONDS", 2)
    worker = mutations.Worker()
    assert worker.ask("read_volume", tmp_path / "v.nii").startswith(outcome)
    worker.stop()
