"""Studies whose runs are spread over workers: the same bits, what fails, what is left and goes on."""

import os
import subprocess
import sys

import pytest

import palpate as pp
from palpate.cluster import connection
from palpate.cluster.file_tasks import FileTask, write_files
from palpate.report.stages import silent

CODE = """
import os, time
from pathlib import Path

def note(path):
    with open(path.with_suffix(".count"), "a") as file:
        file.write(f"{os.getpid()} ")
    path.write_text(path.stem)

def dies_once(path):
    note(path)
    if path.with_suffix(".count").read_text().count(" ") == 1:
        path.unlink()
        os._exit(1)

def dies(path):
    os._exit(1)

def refuses(path):
    raise ValueError(f"{path.name}: cannot be")
"""


@pytest.fixture
def parts(tmp_path, monkeypatch):
    """A module that workers find too."""
    (tmp_path / "parts_of_a_test.py").write_text(CODE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    import parts_of_a_test

    yield parts_of_a_test
    del sys.modules["parts_of_a_test"]


def test_each_file_is_written_once_by_any_worker_and_none_that_is_there(parts, tmp_path):
    tasks = [FileTask(tmp_path / f"{k}.txt", parts.note) for k in range(6)]
    tasks[2].path.write_text("kept")
    said = []
    write_files(tasks, 2, lambda what, share: said.append((what, share)))
    texts = [task.path.read_text() for task in tasks]
    assert texts == ["0", "1", "kept", "3", "4", "5"]
    counts = [task.path.with_suffix(".count") for task in tasks if task.path.stem != "2"]
    writers = {count.read_text() for count in counts}
    assert all(text.count(" ") == 1 for text in writers)
    assert len(writers) == 2
    assert str(os.getpid()) not in {text.strip() for text in writers}
    assert said[-1][1] == 1.0
    write_files(tasks, 2, lambda *_: pytest.fail("all are there"))


def test_a_worker_that_dies_is_replaced_and_one_that_always_does_is_said(parts, tmp_path):
    write_files([FileTask(tmp_path / "once.txt", parts.dies_once)], 1, silent)
    assert (tmp_path / "once.txt").read_text() == "once"
    with pytest.raises(pp.errors.ClusterError, match="workers died at one task"):
        write_files([FileTask(tmp_path / "never.txt", parts.dies)], 1, silent)


def test_what_a_task_raises_is_raised_and_the_others_files_stay(parts, tmp_path):
    tasks = [FileTask(tmp_path / "good.txt", parts.note), FileTask(tmp_path / "bad.txt", parts.refuses)]
    with pytest.raises(ValueError, match=r"bad.txt: cannot be"):
        write_files(tasks, 1, silent)
    assert not (tmp_path / "bad.txt").exists()


def test_a_study_that_times_its_runs_does_not_spread(tmp_path):
    words = [sys.executable, "-m", "palpate", "study", "realtime", "--on", "2", "-o", str(tmp_path / "study")]
    refused = subprocess.run(words, capture_output=True, text=True)
    assert refused.returncode == 2
    assert "times what it does" in " ".join(refused.stderr.split())
    assert not (tmp_path / "study").exists()


@pytest.mark.parametrize("study", [pp.doubt_study, pp.detection_study])
def test_where_nobody_works_nothing_of_an_earlier_run_is_lost(study, tmp_path):
    with pytest.raises(pp.errors.DataError, match="on: 'many'"):
        study(tmp_path / "new", quick=True, on="many")
    assert not (tmp_path / "new").exists()


def test_files_are_made_again_and_stay_until_then(parts, tmp_path, monkeypatch):
    monkeypatch.setattr(connection, "PATIENCE", 1)
    tasks = [FileTask(tmp_path / f"{k}.txt", parts.note) for k in range(2)]
    for task in tasks:
        task.path.write_text("earlier")
    with pytest.raises(pp.errors.ClusterError, match="no scheduler answers"):
        write_files(tasks, "tcp://127.0.0.1:1", silent, again=True)
    assert [task.path.read_text() for task in tasks] == ["earlier", "earlier"]
    write_files(tasks, 1, silent, again=True)
    assert [task.path.read_text() for task in tasks] == ["0", "1"]
