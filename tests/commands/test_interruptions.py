"""A sample of `make interrupt`."""

from fuzz import interruptions


def test_a_sample_of_interruptions():
    """No time is judged here: the machine may be busy."""
    counts = {"interrupt": 8, "kill": 6, "full_disk": 4, "together": 1}
    names = ("reconstruct", "touch")
    told, failures, _ = interruptions.run(counts, seed=3, names=names, seconds=60)
    assert not failures, failures[0]
    assert told.total() == sum(counts.values())
