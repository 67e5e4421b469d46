"""Errors of the command line speak of options, as typed, not of the keywords of Python."""

import re
import sys

import numpy as np
import pytest
from support import broken_files

import palpate as pp
from palpate.commands import main

KEYWORD = re.compile(r"(?<![-\w])[a-z_]+=(\.\.\.|'|\"|True|False|None|[-\d])|\b[a-z]+_[a-z_]+ is \d")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("options")
    broken_files.fill(made)
    values = np.zeros((12, 12, 24), int)
    values[3:9, 3:9, 3:9], values[3:9, 3:9, 14:22], values[5, 5, 5] = 1, 1, 2
    pp.write_labels(made / "two.nrrd", pp.Labels(values, pp.Grid(values.shape, (2, 2, 2)), {1: "organ", 2: "lump"}))
    values[:, :, 0] = 3
    values[:4, 3:9, 3:9] = 1
    pp.write_labels(made / "cut.nrrd", pp.Labels(values, pp.Grid(values.shape, (2, 2, 2)), {1: "organ", 2: "lump"}))
    return made


CASES = {
    "mesh two.nrrd --label organ --edge -2 -o m.vtu": "--edge: expected a positive length",
    "mesh two.nrrd --label organ --keep 5 -o m.vtu": "--keep: 5, but 'organ' has 2 parts",
    "mesh two.nrrd --label organ --keep some -o m.vtu": "--keep: expected 'largest'",
    "mesh two.nrrd --label organ --smooth -1 -o m.vtu": "--smooth: expected a length",
    "mesh two.nrrd --label organ --inclusion lump --keep 1,2,3 -o m.vtu": "--keep: no part of 'organ'",
    "mesh two.nrrd --label organ --inclusion lump --keep left -o m.vtu": "or use --keep all",
    "mesh cut.nrrd --label organ -o m.vtu": "with a flat wall: --closed-at-border",
    "reconstruct scan.h5 -o v.nii.gz": "--thickness",
    "reconstruct scan.h5 -o v.nii.gz --thickness 4 --spacing -1": "--spacing",
    "reconstruct scan.h5 -o v.nii.gz --thickness 4 --levels 0": "--levels",
    "reconstruct scan.h5 -o v.nii.gz --thickness 4 --neighbours 5": "neighbours: expected 6, 18 or 26",
    "reconstruct scan.h5 -o v.nii.gz --thickness 4 --relaxation 3 --method sart": "--relaxation",
    "fit mesh.vtu -o t.vtu --young 5 --poisson 0.5": "--element mixed",
    "fit mesh.vtu -o t.vtu --young -5": "--young",
    "scan simulate --views 0 -o s.h5": "--views: expected a whole number",
    "scan simulate --distance -5 -o s.h5": "--distance",
}


@pytest.mark.parametrize("words", CASES)
def test_the_option_is_named_as_it_is_typed(folder, monkeypatch, capsys, words):
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", ["palpate", *words.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err
    assert ended.value.code == 2, said
    assert CASES[words] in said
    assert not KEYWORD.search(said), said
