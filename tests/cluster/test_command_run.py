"""Runs of commands: when one is made again, who makes it, and what it goes on from."""

import os
import threading
import time

import pytest
from support.small_archive import left_over, small_archive

import palpate as pp
from palpate.cluster import command_run
from palpate.cluster.command_process import locked, run_command
from palpate.cluster.command_run import RunRecord, absolute_run, run_key

OPTIONS = ("--thickness", "20", "--iterations", "4", "--no-check")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return small_archive(tmp_path_factory.mktemp("study"), 4)


def test_a_run_is_made_again_when_what_it_depends_on_has_changed_and_only_then(study, tmp_path, monkeypatch):
    scans = small_archive(tmp_path / "study", 1)
    output = tmp_path / "v.nii.gz"

    def state(*options):
        run = pp.CommandRun("reconstruct", scans / "scan-000.h5", output, (*OPTIONS, *options))
        return run_command(absolute_run(run)).state

    assert state() == "done"
    assert state() == "kept"
    os.utime(scans / "scan-000.h5")  # the same contents
    assert state() == "kept"
    assert state("--levels", "1") == "done"
    (scans / "scan-000.h5").write_bytes((sorted(study.glob("*.h5"))[1]).read_bytes())
    assert state("--levels", "1") == "done"
    output.write_bytes(b"something else")
    assert state("--levels", "1") == "done"
    output.unlink()
    assert state("--levels", "1") == "done"
    monkeypatch.setattr(command_run, "__version__", "9.9")
    assert state("--levels", "1") == "done"
    record = command_run.record_path(output)
    record.write_text(record.read_text()[:-20])  # a disk that was full once
    assert state("--levels", "1") == "done"


def test_a_file_that_an_option_names_counts_by_its_contents(tmp_path):
    (tmp_path / "scan.h5").write_bytes(b"1")
    (tmp_path / "labels.nii.gz").write_bytes(b"2")
    run = pp.CommandRun(
        "segment", tmp_path / "scan.h5", tmp_path / "out.nii.gz", ("--onto", str(tmp_path / "labels.nii.gz"))
    )
    before = run_key(run)
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    for name in ("scan.h5", "labels.nii.gz"):
        (moved / name).write_bytes((tmp_path / name).read_bytes())
    options = ("--onto", str(moved / "labels.nii.gz"))
    assert run_key(pp.CommandRun("segment", moved / "scan.h5", moved / "out.nii.gz", options)) == before
    (tmp_path / "labels.nii.gz").write_bytes(b"3")
    assert run_key(run) != before


def test_a_plugin_counts_by_its_contents(tmp_path):
    plugin, scan = tmp_path / "mine.py", tmp_path / "scan.h5"
    plugin.write_bytes(b"1")
    scan.write_bytes(b"1")
    runs = [pp.CommandRun("reconstruct", scan, tmp_path / "out.nii.gz", (), plugins) for plugins in ((), (plugin,))]
    keys = [run_key(run) for run in runs]
    plugin.write_bytes(b"2")
    assert run_key(runs[0]) == keys[0]
    assert len({*keys, run_key(runs[1])}) == 3


def test_a_folder_counts_by_the_names_and_contents_of_its_files(tmp_path):
    (tmp_path / "series/more").mkdir(parents=True)
    first, second = tmp_path / "series/1.dcm", tmp_path / "series/more/2.dcm"
    first.write_bytes(b"1")
    second.write_bytes(b"2")
    run = pp.CommandRun("reconstruct", tmp_path / "series", tmp_path / "out.nii.gz", ())
    keys = [run_key(run)]
    second.write_bytes(b"3")
    keys.append(run_key(run))
    second.rename(tmp_path / "series/more/3.dcm")
    keys.append(run_key(run))
    first.unlink()
    keys.append(run_key(run))
    assert len(set(keys)) == 4


def test_two_that_want_the_same_output_make_it_once(study, tmp_path):
    run = absolute_run(pp.CommandRun("reconstruct", study / "scan-000.h5", tmp_path / "out.nii.gz", OPTIONS))
    found = []
    threads = [threading.Thread(target=lambda: found.append(run_command(run).state)) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == ["done", "kept", "kept"]
    assert not left_over(tmp_path)


def test_one_at_a_time_holds_a_lock_and_no_lock_is_left(tmp_path):
    inside, most = [0], [0]

    def work():
        for _ in range(30):
            with locked(tmp_path / "out"):
                inside[0] += 1
                most[0] = max(most[0], inside[0])
                time.sleep(0.0005)
                inside[0] -= 1

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1]
    assert not list(tmp_path.iterdir())


def test_a_checkpoint_of_another_run_is_gone_before_a_run_begins(study, tmp_path, monkeypatch):
    """Otherwise a run that is killed at once would go on from there the next time."""
    output = tmp_path / "out.nii.gz"
    checkpoint = tmp_path / "out.nii.gz.checkpoint.h5"
    found = []
    monkeypatch.setattr(
        "palpate.cluster.command_process.run_in_process",
        lambda run, threads, resume, lock: found.append((resume, checkpoint.exists())) or RunRecord("", "failed"),
    )
    run, other = (
        pp.CommandRun("reconstruct", study / "scan-000.h5", output, (*OPTIONS, "--spacing", spacing))
        for spacing in ("2", "3")
    )
    for one, wanted in ((run, (False, False)), (run, (True, True)), (other, (False, False))):
        assert run_command(one).state == "failed"
        assert found[-1] == wanted
        checkpoint.touch()
