"""The example at the head of each command's help works as it stands."""

import os
import re
import shutil
from pathlib import Path

import pytest
from running import ended, interrupted, start

import palpate as pp
from palpate.samples import sample

SAMPLES = {name: sample("abdomen") / name for name in ("ct.nii.gz", "labels.nii.gz", "label_names.json")}


def example(command):
    """The words after `palpate` of the example in the help, which is the first thing it says."""
    said = ended(f"{command} --help", Path.cwd())[1]
    found = re.search(r"^\s*Example: palpate (\S.*?)\s*$", said, re.MULTILINE)
    assert found, said
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    assert lines[0].startswith("Usage: ")
    assert lines[1].startswith("Example: "), "the help starts with the example"
    assert found[1].startswith(command)
    return found[1]


@pytest.fixture
def folder(tmp_path):
    for name, path in SAMPLES.items():
        shutil.copy(path, tmp_path / name)
    return tmp_path


def done(command, folder):
    """Runs the example and gives what it printed."""
    code, out, err = ended(example(command), folder)
    assert code == 0, err
    return out


def test_scan_import(folder):
    assert "7 views" in done("scan import", folder)
    assert pp.read_scan(folder / "breast.h5").shape == (7, 170, 615)


def test_scan_simulate(folder):
    done("scan simulate", folder)
    assert pp.read_scan(folder / "scan.h5").shape == (8, 512, 512)


def test_scan_template_and_every_other_one_loads(folder):
    done("scan template", folder)
    assert len(pp.read_geometry(folder / "geometry.yaml").views) > 1
    for motion in ("rotating", "circular", "linear", "hypocycloid", "free"):
        assert ended(f"scan template --motion {motion} -o {motion}.yaml", folder)[0] == 0
        assert len(pp.read_geometry(folder / f"{motion}.yaml").views) > 1


def test_scan_as_a_whole(folder):
    done("scan", folder)
    assert (folder / "breast.h5").exists()


def test_reconstruct_as_far_as_the_first_checkpoint(folder):
    """The whole run takes a minute; the same one is the first half of the breast demo."""
    done("scan import", folder)
    code, _, said = interrupted(start(example("reconstruct"), folder), (folder / "breast.nii.gz.checkpoint.h5").exists)
    assert code == 130
    assert "--resume" in said


def test_segment(folder):
    assert " ml" in done("segment", folder)
    assert pp.read_labels(folder / "labels.nii.gz").values.max() == 1


def test_mesh_fit_and_touch(folder):
    assert "kidney_left" in done("mesh", folder)
    mesh = pp.read_mesh(folder / "kidney.vtu")
    assert 100e3 < mesh.volumes.sum() < 200e3  # mm³, a kidney
    assert "springs against linear finite elements" in done("fit", folder)
    tissue = pp.read_tissue(folder / "tissue.vtu")
    assert (tissue.mesh.nodes == mesh.nodes).all()
    touched = start(example("touch"), folder)
    address = touched.stdout.readline()
    assert "http://127.0.0.1:" in address
    code, out, err = interrupted(touched, lambda: True)
    assert code == 0, err
    assert "session recorded in session.h5" in out
    assert pp.read_record(folder / "session.h5").length > 0


def test_demo_as_far_as_its_first_file(folder):
    """All of it is run by the tests of the demos."""
    code, _, said = interrupted(start(example("demo"), folder), (folder / "demo" / "scan.h5").exists)
    assert code == 130
    assert "--resume" in said


def test_doctor_tells_the_truth(folder):
    import tomllib
    from importlib.metadata import version

    from palpate import _core
    from palpate.server.app import STATIC

    said = done("doctor", folder)
    project = Path(__file__).parents[1] / "pyproject.toml"
    for needed in tomllib.loads(project.read_text())["project"]["dependencies"]:
        name = re.split(r"[<>=]", needed)[0]
        assert re.search(rf"^ *{re.escape(name)} {re.escape(version(name))}$", said, re.MULTILINE), name
    assert f"palpate {pp.__version__}," in said
    assert f"kernels: {_core.instruction_set()}, {_core.threads()} threads of {os.cpu_count()} processors" in said
    assert float(re.search(r"projector: ([\d.]+) G voxel-views", said)[1]) > 0
    assert ("page: bundled" in said) == (STATIC / "index.html").is_file()
    assert "samples: all there" in said


def test_doctor_names_what_is_missing_and_fails(monkeypatch, capsys, tmp_path):
    from importlib.metadata import PackageNotFoundError

    from typer.testing import CliRunner

    from palpate.commands import app, doctor
    from palpate.server import app as served

    def version(name):
        if name == "meshio":
            raise PackageNotFoundError(name)
        return "1"

    monkeypatch.setattr(doctor, "version", version)
    monkeypatch.setattr(served, "STATIC", tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 1
    assert "meshio missing; install it: pip install meshio" in result.output
    assert "page: missing" in result.output
    assert "browser: none found here" in result.output
