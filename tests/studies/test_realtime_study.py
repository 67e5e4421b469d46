"""`palpate study realtime --quick`, and the tallies and clocks that it reads."""

import csv
import html
import os
import re
import shutil

import numpy as np
import pytest
from support.example_organs import organ

import palpate as pp
from palpate import _core
from palpate.errors import FileError
from palpate.simulation.session_settings import sweeps_in_tick
from palpate.studies.realtime.browser import pages
from palpate.studies.realtime.config import QUICK, path
from palpate.studies.realtime.loop_timing import at_share


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """As where there is no browser: what it says then is judged, too."""
    folder = tmp_path_factory.mktemp("realtime")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shutil, "which", lambda name: None)
        report = pp.realtime_study(folder / "study", quick=True, docs=folder / "docs")
    assert report == folder / "study" / "report.html"
    return folder


def table(study, name):
    with (study / "study" / "tables" / f"{name}.csv").open() as file:
        return list(csv.DictReader(file))


def test_the_tables_hold_what_was_timed(study):
    for row in table(study, "ticks"):
        assert 0 < float(row["p50_ms"]) <= float(row["p99_ms"]) <= float(row["p99.9_ms"])
        assert int(row["sweeps"]) == sweeps_in_tick(1e-3 * float(row["sweep_ms"]))
    loops = table(study, "loops")
    assert [row["model"] for row in loops] == list(QUICK.models)
    for row in loops:
        assert 0 < float(row["ticks_a_second"]) < 1100
        assert float(row["mean_force_n"]) > 0.05  # it did press
        assert 0 < float(row["largest_step"]) < 0.5
        assert row["faults"] == "0"
        assert float(row["processor_p50_ms"]) > 0
    for row in table(study, "memory"):
        assert float(row["before_mb"]) > 20
        assert float(row["model_mb"]) > 0


def test_the_report_has_the_tables_and_says_what_was_missing(study):
    text = html.unescape(re.sub("<[^>]+>", " ", (study / "study" / "report.html").read_text()))
    for row in table(study, "ticks"):
        assert f"{float(row['p99_ms']):.3f}" in text
    for row in table(study, "loops"):
        assert f"{float(row['ticks_a_second']):.1f}" in text
        assert f"{float(row['largest_step']):.2%}" in text
    assert "Not measured: no Chromium on the PATH: apt-get install chromium" in text
    assert "No mesh of 20,000 nodes and no browser in this run: nothing to judge." in text
    page = (study / "docs" / "realtime.md").read_text()
    assert "## Rate of the loop" in page
    for picture in re.findall(r"\]\((images/[^)]+)\)", page):
        assert (study / "docs" / picture).exists()


def test_it_goes_on_from_what_is_there_and_mixes_nothing(study):
    runs = sorted((study / "study" / "runs").iterdir())
    before = {run: run.stat().st_mtime_ns for run in runs}
    pp.realtime_study(study / "study", quick=True, resume=True)
    assert {run: run.stat().st_mtime_ns for run in runs} == before
    with pytest.raises(FileError, match="holds the study 'realtime --quick"):
        pp.realtime_study(study / "study", resume=True)


@pytest.mark.browser
def test_pictures_and_delays_are_counted_in_a_real_browser():
    row = pages(QUICK, *QUICK.kidneys[0])["pages"][0]
    if "missing" in row:
        (pytest.fail if os.environ.get("PALPATE_REQUIRE_BROWSER") == "1" else pytest.skip)(row["missing"])
    assert row["mode"] == "Wireframe"
    assert row["rendering"] == "software"
    assert row["pictures_a_second"] > 0
    assert row["delays"] > 0
    assert 0 < row["delay_p50_ms"] <= row["delay_p99_ms"]


def test_the_loops_tallies_count_every_tick_once():
    session = pp.Session(pp.model(organ(5)), radius=14.0, sweeps=1)
    assert all(tally.sum() == 0 for tally in session.loop.tallies())
    with session:
        session.start(pp.Pointer())
        while session.frame().tick < 200:
            pass
    ticks = session.frame().tick - 1  # the last one, which lets go, is not by the clock
    assert [int(tally.sum()) for tally in session.loop.tallies()] == [ticks] * 3


def test_shares_of_a_tally():
    count = np.zeros(1001, dtype=np.int64)
    count[[3, 50]] = 900, 100
    assert at_share(count, 0.5) == pytest.approx(0.04)
    assert at_share(count, 0.9) == pytest.approx(0.04)
    assert at_share(count, 0.901) == pytest.approx(0.51)
    count[1000] = 100_000  # more than 10 ms
    assert at_share(count, 0.5) is None


def test_an_empty_thread_keeps_its_beat():
    woken, late = _core.benchmark.timer_jitter(50, 500)
    assert len(woken) == 50
    assert (woken >= 0).all()  # never before its deadline
    assert 0 <= late < 50
    with pytest.raises(ValueError, match="at least 1"):
        _core.benchmark.timer_jitter(0)


def test_a_thread_that_reads_takes_longer_for_more():
    little, much = (np.median(_core.benchmark.memory_read_jitter(30, size, 500)) for size in (400, 400_000))
    assert 0 <= little < much
    with pytest.raises(ValueError, match="at least 1"):
        _core.benchmark.memory_read_jitter(1, 0)


def test_the_finger_keeps_to_the_skin_at_its_speed():
    tissue = organ(9)
    points, press = path(tissue, 1500)
    for x in points[::100]:
        assert tissue.surface.closest(x).distance < 1e-9
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() < 0.2
    assert press[1] > 0
