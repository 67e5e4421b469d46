"""Lessons: what their files may say, cases that a seed draws, and when a session has passed."""

import json
import struct
import subprocess
import sys

import numpy as np
import pytest
import yaml
from support.example_organs import ellipsoid

import palpate as pp
from palpate.meshes.tet_mesh import TetMesh
from palpate.server.exam import Exam
from palpate.server.frame_message import frame_bytes
from palpate.server.lesson_server import exam_session
from palpate.server.messages import Frame, code
from palpate.server.scene_message import scene_bytes
from palpate.simulation.lesson import EXAM_FORCE, EXAM_LENGTH
from palpate.simulation.lesson_ceiling import pressed
from palpate.simulation.session import LUMP
from palpate.simulation.target_regions import connected_lumps
from palpate.tissue.spring_fitting import scattered_points, surface_normals


@pytest.fixture(scope="module")
def organ():
    mesh = ellipsoid(12)
    plain = TetMesh(mesh.nodes, mesh.tets, np.ones(len(mesh.tets), dtype=np.int32), {1: "organ"})
    return pp.Tissue(plain, 5.0, 0.45, pp.resting_on(plain, (0, 0, -1), depth=8.0))


@pytest.fixture(scope="module")
def file(organ, tmp_path_factory):
    folder = tmp_path_factory.mktemp("lesson")
    pp.write_tissue(folder / "tissue.vtu", organ)
    (folder / "lesson.yaml").write_text(pp.lesson_template("tissue.vtu"))
    return folder / "lesson.yaml"


@pytest.fixture(scope="module")
def lesson(file):
    return pp.read_lesson(file)


def changed(file, tmp_path, **changes):
    content = yaml.safe_load(file.read_text()) | changes
    path = tmp_path / "changed.yaml"
    path.write_text(yaml.safe_dump({key: value for key, value in content.items() if value is not None}))
    return path


def test_a_template_is_a_lesson(lesson, file):
    assert lesson.tools == ("press", "pull")
    assert lesson.views == ("plain",)
    assert lesson.organ == file.parent / "tissue.vtu"
    assert "lump" in lesson.asked.lower()
    assert (lesson.limits.kind, lesson.limits.force) == ("lump", 5.0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"title": None}, "title: missing"),
        ({"trains": ""}, "trains: missing"),
        ({"cannot": 3}, "cannot: missing"),
        ({"tool": ["press"]}, "tool: no such key"),
        ({"tools": ["press", "saw"]}, "tools: 'saw' is none"),
        ({"tools": []}, "tools: none given"),
        ({"views": ["inside"]}, "views: 'inside' is none"),
        ({"task": "touch"}, "task: 'touch'"),
        ({"time": -1}, "time: -1"),
        ({"time": "long"}, "time: 'long'"),
        ({"claims": 0}, "claims: 0"),
        ({"lumps": {"radius": [9, 6]}}, "lumps: radius"),
        ({"lumps": {"count": [1, 99]}}, "at most 5"),
        ({"lumps": {"colour": [1, 2]}}, "colour is no key"),
        ({"lumps": 3}, "lumps: expected"),
        ({"pass": {"found": 2}}, "found is a share"),
        ({"pass": {"luck": 1}}, "luck is no key"),
        ({"limits": {"force": 0}}, "force: 0"),
        ({"palpate lesson": 9}, "expected `palpate lesson: 1`"),
    ],
)
def test_a_lesson_that_cannot_be_is_refused(file, tmp_path, changes, said):
    path = changed(file, tmp_path, **changes)
    with pytest.raises(pp.errors.DataError, match=r"changed\.yaml") as refused:
        pp.read_lesson(path)
    assert said in str(refused.value)


def test_what_is_no_yaml_is_refused(tmp_path):
    (tmp_path / "a.yaml").write_text("title: [")
    with pytest.raises(pp.errors.FileError, match="not a YAML text"):
        pp.read_lesson(tmp_path / "a.yaml")
    with pytest.raises(pp.errors.FileError):
        pp.read_lesson(tmp_path / "missing.yaml")


def test_cases_keep_to_the_limits_and_to_their_seed(lesson, organ):
    limits, places = lesson.lumps, []
    skin = organ.mesh.nodes[organ.mesh.surface_nodes]
    for seed in range(40):
        case = pp.lesson_case(lesson, organ, seed)
        again = pp.lesson_case(lesson, organ, seed)
        assert np.array_equal(case.young, again.young)
        assert np.array_equal(case.mesh.nodes, organ.mesh.nodes)
        assert np.array_equal(case.mesh.tets, organ.mesh.tets)
        assert np.array_equal(case.fixed, organ.fixed)
        inside = case.mesh.region == 2
        assert case.mesh.names[2] == "lump"
        stiff = np.unique(case.young[inside])
        assert len(stiff) == 1
        assert limits.young[0] <= stiff[0] <= limits.young[1]
        assert (case.young[~inside] == 5.0).all()
        middles = case.mesh.nodes[case.mesh.tets[inside]].mean(axis=1)
        centre = middles.mean(axis=0)
        assert np.linalg.norm(middles - centre, axis=1).max() <= limits.radius[1] + organ.edge / 2
        assert np.linalg.norm(skin - centre, axis=1).min() >= limits.depth[0] + limits.radius[0] - organ.edge
        places.append(centre)
    assert np.std(places, axis=0).min() > 2, "all over the organ"
    assert len({tuple(place) for place in np.round(places, 3).tolist()}) == 40


def test_several_lumps_are_apart(file, tmp_path, organ):
    path = changed(
        file,
        tmp_path,
        lumps={"count": [3, 3], "radius": [6, 7], "depth": [1, 12]},
        organ=str(file.parent / "tissue.vtu"),
    )
    for seed in range(5):
        case = pp.lesson_case(pp.read_lesson(path), organ, seed)
        assert len(connected_lumps(case.mesh, 2)) == 3


def test_a_case_that_cannot_be_drawn_is_refused(file, tmp_path, lesson, organ):
    deep = pp.read_lesson(changed(file, tmp_path, lumps={"depth": [40, 50]}))
    with pytest.raises(pp.errors.DataError, match="none fits"):
        pp.lesson_case(deep, organ, 1)
    small = pp.read_lesson(changed(file, tmp_path, lumps={"radius": [0.5, 0.6]}))
    with pytest.raises(pp.errors.DataError, match="mesh the organ finer"):
        pp.lesson_case(small, organ, 1)
    with pytest.raises(pp.errors.DataError, match="regions inside already"):
        pp.lesson_case(lesson, pp.lesson_case(lesson, organ, 1), 1)
    with pytest.raises(pp.errors.DataError, match="seed"):
        pp.lesson_case(lesson, organ, -1)


def at_rest_and_touched(lesson, seed, where):
    """The scene, a frame before any touch, and one under a press, as a page gets them."""
    session = exam_session(Exam(lesson, seed))
    scene = scene_bytes(session, lesson.title, task=lesson.asked, tools=lesson.tools, views=lesson.views, exam=True)
    session.step([None] * 50)
    rest = session.frame()
    first = frame_bytes(rest, session.drawn(rest), exam=True)
    session.step([pp.Command(True, where, (0, 0, -2))] * 300)
    pressed = session.frame()
    return scene, first, frame_bytes(pressed, session.drawn(pressed), exam=True)


def test_until_a_touch_two_cases_send_the_same_bytes(lesson, organ):
    top = tuple(organ.mesh.nodes[np.argmax(organ.mesh.nodes[:, 2])])
    one, other = (at_rest_and_touched(lesson, seed, top) for seed in (1, 2))
    assert one[0] == other[0]
    assert b"lump" not in one[0].lower().replace(lesson.title.lower().encode(), b"").replace(
        lesson.asked.lower().encode(), b""
    )
    assert one[1] == other[1]
    assert len(one[2]) == len(other[2])
    header = json.loads(one[0][4 : 4 + int.from_bytes(one[0][:4], "little")])
    assert [part["inside"] for part in header["parts"]] == [False]
    assert header["tools"] == ["press", "pull"]
    assert header["models"] == []


def test_an_exam_tells_what_a_screen_can_show(lesson, organ):
    top = tuple(organ.mesh.nodes[np.argmax(organ.mesh.nodes[:, 2])])
    *_, pressed = at_rest_and_touched(lesson, 3, top)
    values = struct.unpack_from(code(Frame), pressed)
    numbers = np.array(values[1:], dtype=float)
    names = list(Frame.__dataclass_fields__)
    assert names.index("point") == 9
    point, displacement, force = numbers[11:23], numbers[23:35], numbers[35:47]
    for got, step in ((point, EXAM_LENGTH), (displacement, EXAM_LENGTH), (force, EXAM_FORCE)):
        assert np.allclose(got, step * np.rint(got / step), atol=1e-5)
        assert np.abs(got).max() > 0
    assert np.isnan(numbers[-8:-5]).all(), "no estimates"
    assert numbers[-2] == np.float32(EXAM_LENGTH)


def session_with_claims(lesson, seed, places):
    """A record in which a hand presses at places and claims each to be the lump."""
    session = exam_session(Exam(lesson, seed))
    for place in places:
        at = session.tissue.surface.closest(np.ascontiguousarray(place, dtype=float))
        inward = -1.5 * np.array(session.tissue.surface.normal(at))
        session.step([pp.Command(True, tuple(at.point), tuple(inward))] * 150)
        session.mark(LUMP, 0)
        session.step([None] * 60)
    return session.record()


def lump_centre(lesson, organ, seed):
    case = pp.lesson_case(lesson, organ, seed)
    return case.mesh.nodes[case.mesh.tets[case.mesh.region == 2]].mean(axis=(0, 1))


def test_a_session_passes_or_says_why_not(lesson, organ, tmp_path, file):
    centre = lump_centre(lesson, organ, 5)
    good = session_with_claims(lesson, 5, [centre])
    pp.write_record(tmp_path / "session.h5", good)
    result = pp.lesson_result(pp.read_record(tmp_path / "session.h5"), lesson)
    assert result.passed
    assert (result.seed, result.channel) == (5, "screen")
    assert "passed" in result.text()
    wrong = session_with_claims(lesson, 5, [-centre, -centre * (1, -1, 1)])
    result = pp.lesson_result(wrong, lesson)
    assert not result.passed
    assert "0 of 1 found" in result.failed
    assert any("wrong claims" in reason for reason in result.failed)
    other = pp.read_lesson(changed(file, tmp_path, claims=2, organ=str(file.parent / "tissue.vtu")))
    with pytest.raises(pp.errors.DataError, match="not in"):
        pp.lesson_result(good, other)
    plain = pp.Session(pp.model(organ, "compliance"))
    plain.step([None] * 100)
    with pytest.raises(pp.errors.DataError, match="in no lesson"):
        pp.lesson_result(plain.record(), lesson)
    told = json.loads(good.lesson)
    assert set(told) == {"title", "digest", "seed", "channel", "tools", "views", "time"}


def test_a_claim_without_a_touch_is_wrong(lesson, organ):
    session = exam_session(Exam(lesson, 4))
    session.step([None] * 30)
    session.mark(LUMP, 0)
    session.step([None] * 70)
    assert pp.lesson_result(session.record(), lesson).score.found == 0


def test_who_claims_anywhere_is_right_by_chance(lesson, organ):
    """200 cases, each with a claim at a random place of the skin: as often right as the skin near the lump is of all skin."""
    rng, right, chance = np.random.default_rng(8), [], []
    surface = organ.mesh.surface
    corners = organ.mesh.nodes[surface]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    middles = corners.mean(axis=1)
    for seed in range(200):
        lump = connected_lumps(pp.lesson_case(lesson, organ, seed).mesh, 2)[0]
        allowed = lump.depth + lesson.limits.within
        near = np.array([lump.distance(x) for x in middles[::8]]) <= allowed
        chance.append(np.average(near, weights=area[::8]))
        at = rng.choice(len(area), p=area / area.sum())
        right.append(lump.distance(middles[at]) <= allowed)
    off = (np.mean(right) - np.mean(chance)) / np.sqrt(np.mean(chance) * (1 - np.mean(chance)) / 200)
    assert abs(off) < 3
    assert 0.01 < np.mean(chance) < 0.4


def test_a_bot_finds_what_can_be_felt(file, tmp_path, lesson, organ):
    there = str(file.parent / "tissue.vtu")
    lumps = {"depth": [1, 4], "radius": [8, 9], "young": [100, 100]}
    shallow = changed(file, tmp_path, organ=there, claims=1, lumps=lumps)
    easy = pp.lesson_ceiling(pp.read_lesson(shallow), organ, cases=12)
    assert easy.sought == 12
    assert easy.share > 0.8
    soft = changed(file, tmp_path, organ=there, claims=1, lumps={**lumps, "young": [5, 5]})
    hopeless = pp.lesson_ceiling(pp.read_lesson(soft), organ, cases=12)
    assert hopeless.share < 0.5, "what is as soft as the organ cannot be felt"
    assert easy.interval[0] < easy.share <= easy.interval[1]
    with pytest.raises(pp.errors.DataError, match="cases"):
        pp.lesson_ceiling(lesson, organ, cases=0)


def test_the_bot_presses_as_the_model_does(organ):
    model = pp.model(organ, "compliance")
    points = scattered_points(organ, 5)
    for point, normal, force in zip(points, surface_normals(organ, points), pressed(model, points), strict=True):
        exact = np.linalg.norm(model.push(point, -2 * normal, 2 * organ.edge).force)
        assert force == pytest.approx(exact, abs=0.0051)


def test_an_exam_counts_claims_and_time(lesson):
    class Seen:
        tick, contact = 0, [0, 0, 0, 0]

    exam, frame = Exam(lesson, 1), Seen()
    assert not exam.ends(frame)
    frame.tick, frame.contact = 5000, [1, 0, 0, 0]
    assert not exam.ends(frame)
    assert [exam.claim() for _ in range(3)] == ["", "", ""]
    assert "3 claims" in exam.claim()
    frame.tick = 5000 + 180_000
    assert not exam.ends(frame)
    frame.tick += 1
    assert exam.ends(frame)
    assert not exam.ends(frame), "once"
    assert exam.claim() == "The time is over."
    assert not exam.allows(1)
    assert not Exam(lesson, 1).allows(2), "no needle in this lesson"


def run(folder, *words):
    return subprocess.run(
        [sys.executable, "-m", "palpate", *words], cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )


def test_the_commands(organ, tmp_path, lesson):
    pp.write_tissue(tmp_path / "tissue.vtu", organ)
    made = run(tmp_path, "lesson", "new", "lesson.yaml", "--organ", "tissue.vtu")
    assert made.returncode == 0, made.stderr
    checked = run(tmp_path, "lesson", "check", "lesson.yaml", "--cases", "3")
    assert checked.returncode == 0, checked.stderr
    assert checked.stdout.count("case ") == 3
    assert "finds" in checked.stdout
    own = pp.read_lesson(tmp_path / "lesson.yaml")
    pp.write_record(tmp_path / "session.h5", session_with_claims(own, 5, [lump_centre(own, organ, 5)]))
    scored = run(tmp_path, "lesson", "score", "session.h5", "lesson.yaml", "-o", "report.html")
    assert scored.returncode == 0, scored.stderr
    assert "passed" in scored.stdout
    assert (tmp_path / "report.html").exists()
    (tmp_path / "lesson.yaml").write_text("title: nothing")
    assert run(tmp_path, "lesson", "check", "lesson.yaml").returncode == 2
