"""The report of a score, and the command."""

import csv
import json

import pytest
from support.example_organs import organ
from support.running_server import ended
from support.scored_session import TOP, hold, press, session_of, stepped

import palpate as pp
from palpate.simulation.session import LUMP


@pytest.fixture(scope="module")
def files(models, tissue, tmp_path_factory):
    """A tissue and two sessions on it, on disk."""
    folder = tmp_path_factory.mktemp("scores")
    pp.write_tissue(folder / "tissue.vtu", tissue)
    for name, depth in (("session", 4.0), ("teacher", 2.0)):
        session = session_of(models["blocks"])
        stepped(session, press(depth, 300) + [[None]] * 60)
        session.step(press(depth, 30))
        session.mark(LUMP)
        session.step([[hold(TOP, (0, 0, -depth))]] * 50)
        pp.write_record(folder / f"{name}.h5", session.record())
    return folder


def test_the_command_writes_a_report_a_teacher_can_read(files, tissue):
    words = "score session.h5 tissue.vtu --task lump --reference teacher.h5 --force 0.5 --strain 0.1 -o out.html"
    code, out, err = ended(words, files)
    assert code == 0, err
    task = pp.Task("lump", force=0.5, strain=0.1)
    mine, other = (pp.score(pp.read_record(files / f"{n}.h5"), tissue, task) for n in ("session", "teacher"))
    assert mine.text() in out
    told = json.loads((files / "out.json").read_text())
    assert told == json.loads(json.dumps({"this session": mine.values(), "reference": other.values()}))
    page = (files / "out.html").read_text()
    assert "The target (lump) was found, with 0 wrong claims." in page
    assert page.count("<img") == 2
    with (files / "out.csv").open() as file:
        table = {row["measure"]: row for row in csv.DictReader(file)}
    row = table["greatest force"]
    assert float(row["this session"]) == pytest.approx(mine.max_force, rel=1e-3)
    assert float(row["difference"]) == pytest.approx(mine.max_force - other.max_force, rel=1e-2)
    for cell in row.values():
        assert f"<td>{cell}</td>" in page
    with (files / "out-curves.csv").open() as file:
        curves = list(csv.DictReader(file))
    assert {row["session"] for row in curves} == {"this session", "reference"}
    assert max(float(row["force_n"]) for row in curves) == mine.max_force
    assert max(float(row["strain"] or 0) for row in curves) == mine.max_strain


def test_a_session_alone_has_a_report_without_differences(files, tissue):
    found = pp.score(pp.read_record(files / "teacher.h5"), tissue)
    made = pp.score_report(files / "alone.html", found, command="palpate score ...")
    assert [path.name for path in made] == ["alone.html", "alone.json", "alone.csv", "alone-curves.csv"]
    assert all(path.exists() for path in made)
    assert "difference" not in made[2].read_text()
    assert "No task was set" in made[0].read_text()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("score session.h5 other.vtu", "open the tissue it was recorded with"),
        ("score none.h5 tissue.vtu", "none.h5: no such file"),
        ("score session.h5 tissue.vtu --task dance", "choose one of touch, lump, biopsy"),
        ("score session.h5 tissue.vtu -o no/report.html", "mkdir -p no"),
        ("touch tissue.vtu --task dance --no-browser", "choose one of touch, lump, biopsy"),
    ],
)
def test_what_the_command_refuses(files, words, why):
    if not (files / "other.vtu").exists():
        pp.write_tissue(files / "other.vtu", organ(7))
    before = sorted(path.name for path in files.iterdir())
    code, _, err = ended(words, files)
    assert code == 2
    assert why in err
    assert "Traceback" not in err
    assert sorted(path.name for path in files.iterdir()) == before


@pytest.mark.parametrize(("within", "found"), [("1", "0 of 1 found, 1 wrong"), ("50", "1 of 1 found, 0 wrong")])
def test_the_command_takes_how_far_beside_a_lump_a_mark_may_be(files, models, within, found):
    session = session_of(models["blocks"])
    stepped(session, press(3.0, 300, point=(16.0, 0.0, 19.2)))
    session.mark(LUMP)
    pp.write_record(files / "beside.h5", session.record())
    code, out, err = ended(f"score beside.h5 tissue.vtu --task lump --within {within} -o beside.html", files)
    assert code == 0, err
    assert found in out
