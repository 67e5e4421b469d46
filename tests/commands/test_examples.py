"""What we tell people to type works: the example in each help, the README, and examples/."""

import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.example_organs import organ
from support.jax_here import required_jax
from support.running_server import HERE, ended, interrupted, start

import palpate as pp
from palpate.samples import sample

ROOT = Path(__file__).parents[2]
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
    assert "1 piece of" in done("cut", folder)
    assert len(pp.read_tissue(folder / "cut.vtu").mesh.nodes) > len(mesh.nodes)
    touched = start(example("touch"), folder)
    address = touched.stdout.readline()
    assert "http://127.0.0.1:" in address
    code, out, err = interrupted(touched, lambda: True)
    assert code == 0, err
    assert "session recorded in session.h5" in out
    assert pp.read_record(folder / "session.h5").length > 0


def test_a_hollow_organ(folder):
    code, out, err = ended("mesh labels.nii.gz --label aorta --wall 2 -o aorta.vtu", folder)
    assert code == 0, err
    assert "0 handles" in out
    mesh = pp.read_mesh(folder / "aorta.vtu")
    assert mesh.names == {1: "aorta wall"}
    assert len(mesh.centerline.openings) == 1
    ended("mesh labels.nii.gz --label aorta --wall 3 --edge 5 -o coarse.vtu", folder)
    mesh = pp.read_mesh(folder / "coarse.vtu")
    code, out, err = ended("fit coarse.vtu --young 400 --rest-on 0,1,0 -o tissue.vtu", folder)
    assert code == 0, err
    held = pp.read_tissue(folder / "tissue.vtu").held
    assert held[pp.fixed_at_openings(mesh)].all()


def test_ask(tmp_path):
    folder = tmp_path
    pp.write_tissue(folder / "tissue.vtu", organ(7))
    asked = start(f"{example('ask')} --no-browser", folder)
    assert "Which is stiffer? Answer at  http://127.0.0.1:" in asked.stdout.readline()
    code, out, err = interrupted(asked, lambda: True)
    assert code == 0, err
    assert "0 of 60 trials answered; the same command with --resume goes on" in out
    assert pp.read_answers(folder / "answers.jsonl").experiment == pp.ForcedChoice()
    code, _, err = ended(example("ask"), folder)
    assert code == 2
    assert "answers.jsonl: is there already" in err
    for words, wrong in (("--question colour", "question"), ("--levels 1,x", "--levels")):
        code, _, err = ended(f"ask tissue.vtu -o other.jsonl {words}", folder)
        assert code == 2
        assert wrong in err
        assert not (folder / "other.jsonl").exists()


def test_scene(folder):
    """With the file in the help."""
    text = ended("scene --help", Path.cwd())[1]
    lines = [line.strip() for line in text.splitlines()]
    first = lines.index("palpate scene: 1")
    last = next(k for k in range(first, len(lines)) if lines[k].startswith("bones:"))
    inner = ("liver", "stomach")
    indented = [f"  {line}" if line.startswith(inner) else line for line in lines[first : last + 1]]
    (folder / "abdomen.yaml").write_text("\n".join(indented))
    assert "3 organs and bones of" in done("scene", folder)
    assert pp.read_tissue(folder / "abdomen.vtu").mesh.names == {5: "liver", 6: "stomach", 31: "vertebrae_L1"}


def test_demo_as_far_as_its_first_file(folder):
    """All of it is run by the tests of the demos."""
    code, _, said = interrupted(start(example("demo"), folder), (folder / "demo" / "scan.h5").exists)
    assert code == 130
    assert "--resume" in said


def test_doctor_tells_the_truth(folder):
    import tomllib
    from importlib.metadata import version

    from palpate import _core
    from palpate.server.access_control import STATIC

    said = done("doctor", folder)
    project = Path(__file__).parents[2] / "pyproject.toml"
    for needed in tomllib.loads(project.read_text())["project"]["dependencies"]:
        name = re.split(r"[<>=]", needed)[0]
        assert re.search(rf"^ *{re.escape(name)} {re.escape(version(name))}$", said, re.MULTILINE), name
    assert f"palpate {pp.__version__}," in said
    assert (
        f"kernels: {_core.base.instruction_set()}, {_core.base.threads()} threads of {os.cpu_count()} processors"
        in said
    )
    assert float(re.search(r"projector: ([\d.]+) G voxel-views", said)[1]) > 0
    assert ("page: bundled" in said) == (STATIC / "index.html").is_file()
    assert "samples: all there" in said


def test_doctor_names_what_is_missing_and_fails(monkeypatch, capsys, tmp_path):
    from importlib.metadata import PackageNotFoundError

    from typer.testing import CliRunner

    from palpate.commands import app, doctor
    from palpate.server import access_control

    def version(name):
        if name == "meshio":
            raise PackageNotFoundError(name)
        return "1"

    monkeypatch.setattr(doctor, "version", version)
    monkeypatch.setattr(access_control, "STATIC", tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 1
    assert "meshio missing; install it: pip install meshio" in result.output
    assert "page: missing" in result.output
    assert "plugins: none" in result.output
    assert "browser: none found here" in result.output


def blocks(language):
    """The README's code in one language."""
    return re.findall(rf"^```{language}\n(.*?)^```", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)


COMMANDS = [line for block in blocks("sh") for line in block.splitlines() if line.startswith("palpate ")]


def test_the_readme_shows_the_whole_way():
    shown = {line.split()[1] for line in COMMANDS}
    assert shown == {"demo", "scan", "reconstruct", "view", "segment", "mesh", "fit", "touch", "export", "score"}


@pytest.mark.parametrize("line", COMMANDS)
def test_each_command_of_the_readme_has_these_options(line):
    import typer
    from typer.main import get_command

    from palpate.commands import app

    words = shlex.split(line, comments=True)
    command, context = get_command(app), None
    while hasattr(command, "commands"):  # a group
        context = typer.Context(command, parent=context, info_name=words.pop(0))
        command = command.get_command(context, words[0])
        assert command is not None, words
    command.make_context(words.pop(0), words, parent=context)  # reads all the words, and refuses what it does not know


def test_the_readmes_python_works(monkeypatch):
    """As it stands, but for voxels and elements so coarse that it takes seconds."""
    (code,) = blocks("python")
    reconstruct, tetrahedralize, touched = pp.reconstruct, pp.tetrahedralize, []
    coarse = {"spacing": 3.0, "levels": 1}
    monkeypatch.setattr(pp, "reconstruct", lambda scan, **given: reconstruct(scan, **given | coarse))
    monkeypatch.setattr(pp, "tetrahedralize", lambda *given, **more: tetrahedralize(*given, **more | {"edge": 14.0}))
    monkeypatch.setattr(pp, "touch", touched.append)
    names = {}
    exec(code, names)
    assert touched == [names["tissue"]]
    force = names["answer"].force
    assert np.linalg.norm(force) < 2 * force[2] < 2  # soft tissue pushes up with tenths of a newton
    assert force[2] > 0.02


def test_the_example_program_ends_with_a_force():
    done = subprocess.run(
        [sys.executable, ROOT / "examples" / "from_python.py", "--quick"], env=HERE, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert 0.02 < float(re.search(r"pushes back with ([\d.]+) N", done.stdout)[1]) < 1


def example_module(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "examples" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_example_of_an_own_potential_finds_the_ball():
    """0.04 1/mm in truth; a narrow arc smears it along the rays."""
    assert 0.024 < example_module("own_potential").main() < 0.045


def test_the_example_of_an_own_likelihood_forgives_outliers():
    plain, ours = example_module("own_likelihood").main()
    assert ours < 0.8 * plain


def test_the_example_of_a_denoiser_predicts_left_out_views_better_than_its_input():
    """Shorter training than a reader's; untrained, the network gives back its input."""
    required_jax()
    example = example_module("denoise_with_jax")
    deviance = example.main(steps=25)
    assert set(deviance) == {"SIRT", "denoised", "M-MAP"}
    assert deviance["denoised"] < deviance["SIRT"] - 0.01
    x = np.full((4, 5, 6), 0.02, np.float32)
    np.testing.assert_allclose(example.network(example.start(), x), x, rtol=1e-6)


@pytest.mark.parametrize("name", sorted(path.stem for path in (ROOT / "examples").glob("own_*.py")))
def test_the_guide_names_the_example(name):
    assert f"examples/{name}.py" in (ROOT / "docs" / "extending.md").read_text()


def test_the_example_likelihood_keeps_the_promises_of_one():
    """Slope by differences; "optimal" parabolas lie above."""
    views = pp.Views([(0, 0, 500)], pp.Panel((1, 1), (1, 1), (0, 0, 0)))
    model = example_module("own_likelihood").Robust.of(pp.Scan(np.full((1, 1, 1), 900.0), 2e4, views))
    at = model.line_integrals.item()

    def value(l):
        return model.value(np.full((1, 1, 1), l, np.float32))

    for l in (at - 1, at - 0.05, at + 0.05, at + 1):
        here, whole = value(l), np.full((1, 1, 1), l, np.float32)
        slope, curvature = model.slope(whole).item(), model.curvature(whole).item()
        assert slope == pytest.approx((value(l + 0.01) - value(l - 0.01)) / 0.02, rel=1e-3)
        for x in np.linspace(0, 2 * at, 50):
            assert here + slope * (x - l) + curvature / 2 * (x - l) ** 2 >= value(x) - 1e-5 * (1 + value(x))
