"""Where there is no terminal progress comes in plain lines on stderr, from each command that may take long."""

import subprocess
import sys

import pytest
from support.example_organs import organ
from support.running_server import HERE, ended

import palpate as pp
from palpate.commands import progress


class Now:
    """A timer that has run off when it is started."""

    def __init__(self, seconds, call, arguments=()):
        self.call, self.arguments = call, arguments

    def start(self):
        self.call(*self.arguments)

    def cancel(self):
        pass


def test_a_line_when_a_thing_begins_and_ends_and_now_and_then_between(monkeypatch, capsys):
    monkeypatch.setattr(progress.threading, "Timer", Now)
    monkeypatch.setattr(progress, "LINE_INTERVAL", 1e9)
    with progress.progress() as say:
        for what, share in (("one", 0.0), ("one", 0.3), ("one", 1.0), ("two", 0.0), ("two", 0.5), ("two", 1.0)):
            say(what, share)
    assert capsys.readouterr().err.splitlines() == ["  one", "  done: one", "  two", "  done: two"]
    monkeypatch.setattr(progress, "LINE_INTERVAL", 0.0)
    with progress.progress() as say:
        for share in (0.0, 0.25, 0.5, 1.0):
            say("three", share)
    assert capsys.readouterr().err.splitlines() == ["  three", "  three, 25%", "  three, 50%", "  done: three"]


def test_what_is_refused_at_once_is_the_refusal_only(monkeypatch, capsys):
    monkeypatch.setattr(progress, "LINE_DELAY", 30.0)
    with pytest.raises(ValueError, match="refused"), progress.doing("one"):
        raise ValueError("refused")
    assert capsys.readouterr().err == ""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("long")
    tissue = organ(7)
    pp.write_mesh(folder / "mesh.vtu", tissue.mesh)
    pp.write_tissue(folder / "tissue.vtu", tissue)
    with pp.Session(pp.model(tissue, "blocks"), radius=14.0, sweeps=2) as session:
        session.step([pp.Command(True, (0.0, 0.0, 25.0), (0.0, 0.0, -2.0))] * 300)
        pp.write_record(folder / "session.h5", session.record())
    return folder


COMMANDS = {
    "scan simulate --pixels 24 24 --pitch 8 --views 3 -o scan.h5": ["done: simulating 3 views"],
    "scan import breast -o breast.h5": ["done: importing breast"],
    "reconstruct scan.h5 -o volume.nii.gz --thickness 40 --spacing 16 --iterations 2": ["done: level 0"],
    "segment volume.nii.gz -o labels.nii.gz": ["done: segmenting volume.nii.gz"],
    "fit mesh.vtu --young 5 -o fitted.vtu": ["done: trying models"],
    "score session.h5 tissue.vtu -o report.html": ["done: replaying session.h5", "done: writing the report"],
}


def test_each_command_says_what_it_does_and_nothing_of_it_on_stdout(folder):
    for words, expected in COMMANDS.items():
        code, out, err = ended(words, folder)
        assert code == 0, err
        for line in expected:
            assert f"  {line}" in err, (words, err)
        assert "done:" not in out


def test_lines_come_at_once_through_a_pipe(folder):
    """Not when the program ends: who watches a log sees that it runs."""
    words = [sys.executable, "-m", "palpate", "scan", "simulate", "--views", "300", "-o", "large.h5"]
    run = subprocess.Popen(words, cwd=folder, env=HERE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert run.stderr.readline() == "  simulating 300 views\n"
    assert run.poll() is None
    run.kill()
    run.communicate()


def test_the_first_words_of_fit_are_of_the_model_that_touch_begins_with(folder):
    code, out, err = ended("fit mesh.vtu --young 5 -o first.vtu", folder)
    assert code == 0, err
    assert out.startswith("palpate touch first.vtu begins with compliance (linear finite elements")
    assert out.index("springs against linear finite elements") > out.index("\n")


def test_the_page_of_a_demo_has_the_slices(tmp_path, monkeypatch):
    from palpate.commands.demo import DemoName, demo

    grid = pp.Grid((2, 3, 4), (1.0, 1.0, 1.0))
    shown = {}
    for which, name in ((DemoName.breast, "volume.nii.gz"), (DemoName.kidney, "ct.nii.gz")):
        pp.write_volume(tmp_path / name, pp.Volume([[[0.0] * 4] * 3] * 2, grid))
        monkeypatch.setattr(pp, "run_demo", lambda *given, **more: {"organ": "tissue"}, raising=False)
        monkeypatch.setattr(pp, "touch", lambda tissue, **given: shown.update(given))
        demo(which, tmp_path, browser=True, training=False, port=None, resume=False)
        assert [image.grid.shape for image in shown["images"]] == [(2, 3, 4)]
        shown.clear()
