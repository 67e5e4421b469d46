"""Archives: the same bits as one command after the other, whatever fails, dies or is stopped."""

import csv
import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from distributed import Client, LocalCluster
from support.small_archive import left_over, small_archive
from typer.testing import CliRunner

import palpate as pp
from palpate.cluster import archive, connection
from palpate.cluster.command_process import run_command
from palpate.commands import app
from palpate.errors import ClusterError, DataError, FileError

OPTIONS = ("--thickness", "20", "--iterations", "4", "--no-check")
LONG = ("--thickness", "20", "--iterations", "40", "--tolerance", "0", "--no-check", "--spacing", "0.7")


@pytest.fixture(scope="module")
def workers():
    """A scheduler with two workers, as somebody else may have started it."""
    with LocalCluster(
        n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None, memory_limit=0, silence_logs=50
    ) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return small_archive(tmp_path_factory.mktemp("study"), 4)


@pytest.fixture(scope="module")
def serial(study, tmp_path_factory):
    """The same scans, one command after the other."""
    folder = tmp_path_factory.mktemp("serial")
    for scan in sorted(study.glob("*.h5")):
        words = ["reconstruct", str(scan), "-o", str(folder / f"{scan.stem}.nii.gz"), *OPTIONS]
        assert CliRunner().invoke(app, words).exit_code == 0
    return folder


def reconstruct(source, folder, on, *options):
    """The command over an archive."""
    return CliRunner().invoke(app, ["reconstruct", str(source), "-o", str(folder), *options, "--on", str(on)])


def runs_of(study, folder, options=OPTIONS):
    return [
        pp.CommandRun("reconstruct", scan, folder / f"{scan.stem}.nii.gz", options)
        for scan in sorted(study.glob("*.h5"))
    ]


def bits(folder):
    """Every volume of a folder, by name."""
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.nii.gz"))}


def rows(table):
    with table.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def states(table):
    return [row["state"] for row in rows(table)]


def test_an_archive_has_the_bits_of_one_command_after_the_other(study, serial, workers, tmp_path):
    result = reconstruct(study, tmp_path / "volumes", workers.scheduler_address, *OPTIONS, "--resume")
    assert result.exit_code == 0, result.output
    assert bits(tmp_path / "volumes") == bits(serial)
    assert states(tmp_path / "volumes" / "results.csv") == ["done"] * 4
    assert not left_over(tmp_path / "volumes")


def test_every_kind_of_option_reaches_the_command(study, workers, tmp_path):
    """Values, switches, switches off, files named from another folder than the workers'."""
    first = sorted(study.glob("*.h5"))[0]
    grid = pp.Grid((3, 9, 10), (5, 3, 3), (-13, -12, 4))
    pp.write_volume(tmp_path / "grid.nii.gz", pp.Volume(np.zeros(grid.shape, np.float32), grid))
    like = os.path.relpath(tmp_path / "grid.nii.gz")
    options = (
        "--like",
        like,
        "--prior",
        "quadratic",
        "--strength=0.02",
        "--neighbours",
        "6",
        "--no-check",
        "--levels",
        "1",
    )
    alone = CliRunner().invoke(app, ["reconstruct", str(first), "-o", str(tmp_path / "alone.nii.gz"), *options])
    assert alone.exit_code == 0, alone.output
    (tmp_path / "one.txt").write_text(f"# a comment\n{first}\n")
    result = reconstruct(tmp_path / "one.txt", tmp_path / "volumes", workers.scheduler_address, *options)
    assert result.exit_code == 0, result.output
    assert (tmp_path / "volumes" / f"{first.stem}.nii.gz").read_bytes() == (tmp_path / "alone.nii.gz").read_bytes()


def test_the_table_says_what_the_report_of_one_scan_says(study, workers, tmp_path):
    first = sorted(study.glob("*.h5"))[0]
    report = tmp_path / "report.json"
    words = ["reconstruct", str(first), "-o", str(tmp_path / "v.nii.gz"), *OPTIONS[:4], "--report", str(report)]
    assert CliRunner().invoke(app, words).exit_code == 0
    (tmp_path / "one.txt").write_text(f"{first}\n")
    assert (
        reconstruct(tmp_path / "one.txt", tmp_path / "volumes", workers.scheduler_address, *OPTIONS[:4]).exit_code == 0
    )
    row, figures = rows(tmp_path / "volumes" / "results.csv")[0], json.loads(report.read_text())
    figures.pop("reconstruction_s")
    assert {name: row[name] for name in figures} == {name: str(value) for name, value in figures.items()}
    scan, volume = pp.read_scan(first), pp.read_volume(tmp_path / "v.nii.gz")
    left = pp.residuals(scan, volume)
    assert figures["deviance"] == pytest.approx(left.deviance.mean(), rel=1e-6)
    assert (figures["views"], figures["rows"], figures["columns"]) == scan.counts.shape
    found = [*pp.check_scan(scan, volume.grid), *pp.check_residuals(left)]
    assert found
    assert all(str(finding) in figures["check"] for finding in found)
    height = abs(scan.views.source[:, 2]).mean()
    assert figures["source_to_panel_mm"] == pytest.approx(height, abs=1e-3)  # the panel is at z = 0


def test_a_failure_ends_its_own_run_only_and_says_why(study, serial, workers, tmp_path):
    damaged = small_archive(tmp_path / "study", 3)
    whole = (damaged / "scan-001.h5").read_bytes()
    (damaged / "scan-001.h5").write_bytes(whole[: len(whole) // 2])
    alone = CliRunner().invoke(
        app, ["reconstruct", str(damaged / "scan-001.h5"), "-o", str(tmp_path / "v.nii.gz"), *OPTIONS]
    )
    volumes = tmp_path / "volumes"
    result = reconstruct(damaged, volumes, workers.scheduler_address, *OPTIONS)
    assert result.exit_code == 1
    assert bits(volumes) == {
        name: data for name, data in bits(serial).items() if name in ("scan-000.nii.gz", "scan-002.nii.gz")
    }
    assert states(volumes / "results.csv") == ["done", "failed", "done"]
    reason = rows(volumes / "results.csv")[1]["reason"]
    assert reason == str(alone.exception)
    assert json.loads((volumes / "scan-001.nii.gz.run.json").read_text())["reason"] == reason
    assert f"scan-001.h5: {reason}" in result.output
    (damaged / "scan-001.h5").write_bytes(whole)  # mended, it is made, and the others are not made again
    assert reconstruct(damaged, volumes, workers.scheduler_address, *OPTIONS).exit_code == 0
    assert states(volumes / "results.csv") == ["kept", "done", "kept"]
    assert not left_over(volumes)


def test_threads_of_runs_and_workers_do_not_exceed_the_processors(study, tmp_path, monkeypatch):
    monkeypatch.delenv("PALPATE_THREADS", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 6)
    with connection.connected(2) as (client, threads):
        assert sum(client.nthreads().values()) * threads == 6
    plugin = tmp_path / "seen.py"  # what the command's process sees
    plugin.write_text(f"import os\nopen({str(tmp_path / 'seen')!r}, 'w').write(os.environ['PALPATE_THREADS'])\n")
    scan = sorted(study.glob("*.h5"))[0]
    run_command(pp.CommandRun("reconstruct", scan, tmp_path / "v.nii.gz", OPTIONS, (plugin,)), threads=3)
    assert (tmp_path / "seen").read_text() == "3"


def working(folder):
    """Whether some run is in the midst of its work: its checkpoint is there."""
    return any(folder.glob("*.checkpoint.h5"))


def wait_for(condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def commands_below(process):
    """The processes of commands that workers have started."""
    return [
        p for p in psutil.Process(process).children(recursive=True) if "palpate.cluster.command_process" in p.cmdline()
    ]


@pytest.fixture(scope="module")
def long_study(tmp_path_factory):
    return small_archive(tmp_path_factory.mktemp("long"), 3, side=40)


@pytest.fixture(scope="module")
def long_serial(long_study, tmp_path_factory):
    folder = tmp_path_factory.mktemp("serial")
    for run in runs_of(long_study, folder, LONG):
        assert run_command(run).state == "done"
    return folder


def test_a_worker_that_is_killed_costs_no_bit(long_study, long_serial, workers, tmp_path):
    records = []
    runs = runs_of(long_study, tmp_path, LONG)
    work = threading.Thread(target=lambda: records.extend(pp.run_archive(runs, workers.scheduler_address)))
    work.start()
    wait_for(lambda: working(tmp_path))
    with Client(workers) as client:
        one = next(iter(client.run(os.getpid).values()))
    children = commands_below(one)
    os.kill(one, signal.SIGKILL)
    work.join(120)
    assert {record.state for record in records} <= {"done", "kept"}
    assert len(records) == 3
    assert bits(tmp_path) == bits(long_serial)
    assert not psutil.wait_procs(children, timeout=20)[1]  # what it had started has ended
    assert not left_over(tmp_path)


def test_a_command_that_is_killed_is_a_failure_with_its_signal(long_study, long_serial, workers, tmp_path):
    records = []
    runs = runs_of(long_study, tmp_path, LONG)[:1]
    work = threading.Thread(target=lambda: records.extend(pp.run_archive(runs, workers.scheduler_address)))
    work.start()
    wait_for(lambda: working(tmp_path))
    commands_below(os.getpid())[0].kill()
    work.join(120)
    assert records[0].state == "failed"
    assert "signal 9" in records[0].reason
    assert not bits(tmp_path)
    assert pp.run_archive(runs, workers.scheduler_address)[0].state == "done"  # it goes on from the checkpoint
    assert bits(tmp_path).items() <= bits(long_serial).items()


def palpate(*words):
    """The command in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "palpate", *map(str, words)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def test_ctrl_c_ends_all_and_the_same_command_goes_on(long_study, long_serial, tmp_path):
    words = ("reconstruct", long_study, "-o", tmp_path, *LONG, "--on", 2)
    process = palpate(*words)
    wait_for(lambda: working(tmp_path))
    below = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "the same command goes on" in said
    assert "Traceback" not in said
    assert not psutil.wait_procs(below, timeout=20)[1]
    assert palpate(*words).wait(120) == 0
    assert bits(tmp_path) == bits(long_serial)


def test_a_client_that_is_killed_leaves_what_the_same_command_goes_on_with(long_study, long_serial, workers, tmp_path):
    words = ("reconstruct", long_study, "-o", tmp_path, *LONG, "--on", workers.scheduler_address)
    process = palpate(*words)
    wait_for(lambda: working(tmp_path))
    process.kill()
    process.wait()
    assert palpate(*words).wait(120) == 0
    assert bits(tmp_path) == bits(long_serial)
    assert not left_over(tmp_path)


def test_a_scheduler_that_dies_is_said_and_another_one_goes_on(long_study, long_serial, workers, tmp_path):
    file = tmp_path / "scheduler.json"
    environment = {**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "3s"}
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment}
    scheduler = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "dask",
            "scheduler",
            "--port",
            "0",
            "--host",
            "127.0.0.1",
            "--no-dashboard",
            "--scheduler-file",
            file,
        ],
        **silent,
    )
    wait_for(file.exists)
    worker = subprocess.Popen(
        [sys.executable, "-m", "dask", "worker", "--scheduler-file", file, "--nthreads", "1", "--no-dashboard"],
        **silent,
    )
    volumes = tmp_path / "volumes"
    process = palpate("reconstruct", long_study, "-o", volumes, *LONG, "--on", file)
    wait_for(lambda: working(volumes))
    scheduler.kill()
    said, _ = process.communicate(timeout=90)
    worker.terminate()
    worker.wait(60)
    assert process.returncode == 2, said
    assert "the scheduler is gone" in said
    assert "the same command goes on" in said
    assert reconstruct(long_study, volumes, workers.scheduler_address, *LONG).exit_code == 0
    assert bits(volumes) == bits(long_serial)


def test_a_list_gives_each_scan_its_own_options_and_output(study, workers, tmp_path):
    first, second = sorted(study.glob("*.h5"))[:2]
    (tmp_path / "list.csv").write_text(
        f"input,output,thickness,prior,check\n{first},a.nii.gz,20,quadratic,no\n{second},b.nrrd,30,,no\n"
    )
    result = reconstruct(tmp_path / "list.csv", tmp_path / "volumes", workers.scheduler_address, "--iterations", "3")
    assert result.exit_code == 0, result.output
    for scan, name, options in (
        (first, "a.nii.gz", ("--thickness", "20", "--prior", "quadratic")),
        (second, "b.nrrd", ("--thickness", "30")),
    ):
        alone = tmp_path / name
        words = ["reconstruct", str(scan), "-o", str(alone), "--iterations", "3", "--no-check", *options]
        assert CliRunner().invoke(app, words).exit_code == 0
        a, b = pp.read_volume(alone), pp.read_volume(tmp_path / "volumes" / name)
        np.testing.assert_array_equal(a.values, b.values)
        assert a.grid == b.grid


def test_volumes_become_labels_and_labels_meshes_the_same_way(serial, workers, tmp_path):
    segment = [
        "segment",
        str(serial),
        "-o",
        str(tmp_path / "labels"),
        "--lower",
        "0.02",
        "--on",
        workers.scheduler_address,
    ]
    result = CliRunner().invoke(app, segment)
    assert result.exit_code == 0, result.output
    made = sorted((tmp_path / "labels").glob("*.nii.gz"))
    assert [path.name for path in made] == sorted(bits(serial))
    for path in made:
        expected = pp.segment(pp.read_volume(serial / path.name), 0.02)
        np.testing.assert_array_equal(pp.read_labels(path).values, expected.values)
    z, y, x = np.indices((14, 14, 14)) - 6.5
    ball = pp.Labels(
        (z * z + y * y + x * x < 25).astype(np.int32), pp.Grid((14, 14, 14), (2, 2, 2), (0, 0, 0)), {1: "ball"}
    )
    (tmp_path / "balls").mkdir()
    pp.write_labels(tmp_path / "balls" / "ball.nii.gz", ball)
    options = ["--label", "1", "--edge", "4"]
    for source, target, more in (
        ("balls/ball.nii.gz", "ball.vtu", []),
        ("balls", "meshes", ["--on", workers.scheduler_address]),
    ):
        words = ["mesh", str(tmp_path / source), "-o", str(tmp_path / target), *options, *more]
        result = CliRunner().invoke(app, words)
        assert result.exit_code == 0, result.output
    alone, many = pp.read_mesh(tmp_path / "ball.vtu"), pp.read_mesh(tmp_path / "meshes" / "ball.vtu")
    np.testing.assert_array_equal(alone.nodes, many.nodes)
    np.testing.assert_array_equal(alone.tets, many.tets)


def test_a_table_for_other_programs_holds_the_same(study, tmp_path):
    import pyarrow.parquet

    runs = runs_of(study, tmp_path)[:2]
    records = [
        pp.RunRecord("k", "done", "", 1.5, "here", ("note: a",), {"deviance": 1.25}),
        pp.RunRecord("l", "failed", 'no, "that" is none', 0.5, "there"),
    ]
    pp.write_results(tmp_path / "t.csv", runs, records)
    pp.write_results(tmp_path / "t.parquet", runs, records)
    table = pyarrow.parquet.read_table(tmp_path / "t.parquet").to_pylist()
    assert [{n: "" if v is None else str(v) for n, v in row.items()} for row in table] == rows(tmp_path / "t.csv")
    assert table[0]["deviance"] == 1.25
    assert table[1]["reason"] == records[1].reason


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ("nothing", "no such file"),
        ("empty", "holds no .h5"),
        ("scan.h5", "expected a folder, or a list"),
        ("unknown.csv", "unknown column 'depth'"),
        ("no-input.csv", "no column input"),
        ("short.csv", "line 3: expected 2 values"),
        ("gone.csv", "gone.h5: no such file"),
        ("twice.csv", "2 runs would write it"),
        ("switch.csv", "expected yes or no"),
    ],
)
def test_what_cannot_be_done_is_said_before_work(source, text, tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "connected", None)  # nothing may be started
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    Path("scan.h5").write_bytes(b"")
    Path("unknown.csv").write_text("input,depth\nscan.h5,3\n")
    Path("no-input.csv").write_text("scan,thickness\nscan.h5,3\n")
    Path("short.csv").write_text("input,thickness\nscan.h5,3\nscan.h5\n")
    Path("gone.csv").write_text("input\ngone.h5\n")
    Path("twice.csv").write_text("input,output\nscan.h5,a.nii.gz\nscan.h5,a.nii.gz\n")
    Path("switch.csv").write_text("input,check\nscan.h5,maybe\n")
    result = reconstruct(source, "volumes", 2)
    assert isinstance(result.exception, DataError | FileError), result.output
    assert text in str(result.exception)


@pytest.mark.parametrize("on", ["0", "-1", "many", "slurm", "slurm:x", "http://here"])
def test_what_is_no_place_to_run_is_said(on, study, tmp_path):
    with pytest.raises(DataError, match="on: "):
        pp.run_archive(runs_of(study, tmp_path), on)


def test_a_scheduler_that_does_not_answer_is_said(study, tmp_path, monkeypatch):
    monkeypatch.setattr(connection, "PATIENCE", 1)
    with pytest.raises(ClusterError, match=r"no scheduler answers at tcp://127\.0\.0\.1:9"):
        pp.run_archive(runs_of(study, tmp_path), "tcp://127.0.0.1:9")
    with pytest.raises(FileError, match="no such file"):
        pp.run_archive(runs_of(study, tmp_path), "missing.json")
