"""Names that version 0.2 changed: the table in the changelog says how, an old name says the new one."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import palpate as pp

CHANGELOG = Path(__file__).parent.parent / "CHANGELOG.md"
RENAMED = re.findall(r"^\| `pp\.(\w+)` \| `pp\.(\w+)` \|$", CHANGELOG.read_text(), re.MULTILINE)
PANEL = pp.Panel((6, 8), (1, 1), (-3.5, -2.5, 0))
SCAN = pp.simulate_scan(
    pp.Phantom([(pp.Ellipsoid((0, 0, 4), 2), 0.02)]),
    pp.arc_views(PANEL, [-9, 0, 9], radius=200, pivot=(0, 0, 0)),
    1e4,
    seed=1,
)
GRID = pp.Grid((3, 6, 8), (2, 1, 1), (-3.5, -2.5, 1))
FEW = {"levels": 1, "iterations": 2, "tolerance": 0}


def test_the_changelog_has_the_table():
    assert len(RENAMED) == len(pp._RENAMED) == 11


@pytest.mark.parametrize(("old", "new"), RENAMED)
def test_an_old_name_raises_an_error_that_says_the_new(old, new):
    assert old not in pp.__all__
    assert new in pp.__all__
    assert callable(getattr(pp, new))
    with pytest.raises(AttributeError, match=rf"palpate\.{old} has been renamed to palpate\.{new} "):
        getattr(pp, old)


def test_a_name_that_never_was_has_the_usual_error():
    with pytest.raises(AttributeError, match="refinish"):
        _ = pp.refinish


@pytest.mark.parametrize("call", [pp.reconstruct, lambda *a, **k: list(pp.iterates(*a, **k))[-1].volume])
def test_the_old_spelling_of_optimizer_warns_and_gives_the_same_volume(call):
    new = call(SCAN, GRID, optimizer="descent", **FEW)
    with pytest.warns(DeprecationWarning, match="optimizer=") as warned:
        old = call(SCAN, GRID, optimiser="descent", **FEW)
    assert warned[0].filename == __file__  # so that the default filters show it to who wrote the call
    assert old.values.tobytes() == new.values.tobytes()
    assert call(SCAN, GRID, optimizer="momentum", **FEW).values.tobytes() != new.values.tobytes()


def test_both_spellings_of_the_generalized_potential_are_one():
    assert pp.Prior("generalised", 1, 0.1) == pp.Prior("generalized", 1, 0.1)


def test_the_command_takes_the_old_spelling_and_says_the_new(tmp_path):
    pp.write_scan(tmp_path / "scan.h5", SCAN)
    words = [
        sys.executable,
        "-m",
        "palpate",
        "reconstruct",
        tmp_path / "scan.h5",
        "--thickness",
        "6",
        "--iterations",
        "2",
    ]
    said, volumes = [], []
    for spelling in ("optimiser", "optimizer"):
        output = tmp_path / f"{spelling}.nii.gz"
        done = subprocess.run(
            [*words, f"--{spelling}", "descent", "-o", output], capture_output=True, text=True, timeout=120
        )
        assert done.returncode == 0, done.stderr
        said.append(done.stderr)
        volumes.append(pp.read_volume(output).values)
    assert "--optimizer" in said[0]
    assert "optimi" not in said[1]
    assert (volumes[0] == volumes[1]).all()
