"""A small sample of `make mutate`, and that the machinery would see what it is there to see."""

import mutations
import pytest

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
