"""A tissue that is cut while a session runs: forces before, at and after the cut, records, and what a display draws."""

import itertools
import shutil
import warnings

import numpy as np
import pytest
from support.example_organs import organ
from support.running_server import until

import palpate as pp
from palpate.meshes.display_surfaces import displayed_surface
from palpate.simulation.pointer import Pointer
from palpate.simulation.recording import start_journal
from palpate.simulation.session_cuts import RecordedCut, cut_columns, cuts_in
from palpate.simulation.session_journal import journal_path

RADIUS = 8.0
LARGEST_STEP = 0.5e-3  # N a tick: the force does not fall faster while a blade cuts at 20 mm/s


@pytest.fixture(scope="module")
def whole():
    return organ(12)


@pytest.fixture(scope="module")
def top(whole):
    return whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]


@pytest.fixture(scope="module")
def model(whole):
    return pp.model(whole, "compliance")


@pytest.fixture(scope="module")
def blade(whole, top):
    return pp.incision(whole, [top - (15, 0, 0), top + (15, 0, 0)], depth=12)


@pytest.fixture
def session(model):
    return pp.Session(model, radius=RADIUS, sweeps=4)


def hold(point, way=(0.5, 3.0, -0.5)):
    return pp.Command(True, tuple(map(float, point)), way)


def test_a_held_force_fades_into_that_of_the_cut_body(whole, top, session, blade):
    at = hold(top + (0, 8, 0))
    before = session.step([at] * 300)[-1]
    assert session.cut(blade)
    after = session.step([at] * 600)
    steps = np.diff(np.concatenate([before[None], after]), axis=0)
    hit = whole.surface.closest(top + (0, 8, 0))
    cut = pp.model(pp.cut(whole, blade), "compliance").push(hit.point, at.displacement, RADIUS).force
    assert np.linalg.norm(cut - before) > 5e-3, "the cut is felt"
    assert np.linalg.norm(steps, axis=1).max() < 0.06 * np.linalg.norm(cut - before), "but not at once"
    assert np.allclose(after[-1], cut, rtol=1e-4, atol=1e-6)


def test_a_blade_at_20_mm_a_second_lets_the_force_go_slowly(top, session, whole):
    at, felt = [hold(top + (0, 8, 0))] * 250, []
    session.step(at)
    for length in range(5, 35, 5):
        session.cut(pp.incision(whole, [top - (15, 0, 0), top + (length - 15, 0, 0)], depth=12), extend=length > 5)
        felt.append(session.step(at))
    assert np.linalg.norm(np.diff(np.concatenate(felt), axis=0), axis=1).max() <= LARGEST_STEP
    assert np.linalg.norm(felt[-1][-1] - felt[0][0]) > 5e-3


def test_a_blade_may_cut_what_is_pressed_together(top, session, whole):
    """The lips of the new piece press on each other at once, and the force of the tool has no step."""
    at, felt = [hold(top + (0, 8, 0), (0, -3.0, -1.0))] * 250, []
    session.step(at)
    for length in range(5, 35, 5):
        session.cut(pp.incision(whole, [top - (15, 0, 0), top + (length - 15, 0, 0)], depth=12), extend=length > 5)
        felt.append(session.step(at))
    assert np.linalg.norm(np.diff(np.concatenate(felt), axis=0), axis=1).max() <= LARGEST_STEP
    hit = whole.surface.closest(top + (0, 8, 0)).point
    closed, through = (
        pp.model(session.tissue, "compliance", contact=contact).push(hit, at[0].displacement, RADIUS).force
        for contact in (True, False)
    )
    assert np.allclose(felt[-1][-1], closed, rtol=2e-3, atol=1e-5)
    assert np.linalg.norm(closed - through) > 0.05 * np.linalg.norm(closed)
    session.undo()
    undone = session.step(at)
    assert np.linalg.norm(np.diff(undone, axis=0), axis=1).max() <= LARGEST_STEP


def test_several_tools_hold_on(whole, top, session, blade):
    one, other = hold(top + (0, 9, 0), (0, 2, 0)), hold(top - (0, 9, 0), (0, -2, 0))
    before = session.step([[one, other]] * 300)[-1]
    session.cut(blade)
    after = session.step([[one, other]] * 600)[-1]
    opened = pp.model(pp.cut(whole, blade), "compliance")
    points = [whole.surface.closest(np.array(c.point)).point for c in (one, other)]
    both = opened.push(points, [one.displacement, other.displacement], [RADIUS] * 2).force
    assert np.allclose(after[:2], both, rtol=1e-3, atol=1e-5)
    assert np.linalg.norm(after[0]) < np.linalg.norm(before[0]), "softer"


def test_a_cut_taken_back_returns_forces_to_the_bit(top, session, blade, model):
    stroke = [hold(top + (0.02 * k - 4, 6, 0)) for k in range(400)]
    session.step([hold(top)] * 100 + [None] * 100)
    session.cut(blade)
    session.step([hold(top)] * 100 + [None] * 100)
    assert session.cuts == 1
    session.undo()
    assert session.cuts == 0
    assert session.tissue is model.tissue
    session.step([None] * 10)
    never = pp.Session(model, radius=RADIUS, sweeps=4)
    assert np.array_equal(session.step(stroke), never.step(stroke))


def test_a_longer_blade_takes_the_place_of_the_last_one(whole, top, session, blade):
    for length in (5.0, 10.0, 15.0):
        part = pp.incision(whole, [top - (15, 0, 0), top + (length, 0, 0)], depth=12)
        assert session.cut(part, extend=length > 5)
        session.step([None] * 3)
    assert session.cuts == 1
    mesh, at_once = session.mesh, pp.cut(whole, blade).mesh
    assert np.array_equal(mesh.tets, at_once.tets)
    assert np.array_equal(mesh.share, at_once.share)


def cut_session(model, top, whole, journal=None):
    """Cuts along and across, takes one back, with tools at work."""
    session = pp.Session(model, radius=RADIUS, sweeps=4)
    if journal:
        session.journal = start_journal(journal, session.description())
    at = itertools.count()

    def step(ticks):
        session.step(
            [[hold(top + (0.01 * next(at) - 4, 7, 0)), hold(top - (0, 8, 0), (0, -1.5, 0))] for _ in range(ticks)]
        )

    step(120)
    session.cut(pp.incision(whole, [top - (15, 0, 0), top + (4, 0, 0)], depth=11))
    step(77)
    session.cut(pp.incision(whole, [top - (15, 0, 0), top + (15, 0, 0)], depth=11), extend=True)
    step(130)
    session.cut(pp.incision(session.tissue, [top - (0, 12, 0), top + (0, 12, 0)], depth=9))
    step(90)
    session.undo()
    step(203)
    return session


def test_a_record_replays_to_the_bit(model, top, whole, tmp_path):
    journal = tmp_path / "session.h5"
    session = cut_session(model, top, whole, journal)
    record = session.record()
    assert [(one.tick, one.kind) for one in record.cuts] == [(120, "cut"), (197, "extend"), (327, "cut"), (417, "undo")]
    pp.write_record(tmp_path / "other.h5", record)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        shutil.copy(journal_path(journal), journal_path(tmp_path / "third.h5"))
        left = pp.read_record(tmp_path / "third.h5")
    for read in (pp.read_record(tmp_path / "other.h5"), left):
        assert [(one.tick, one.kind) for one in read.cuts] == [(one.tick, one.kind) for one in record.cuts]
        again = pp.Session(model, radius=RADIUS, sweeps=4)
        assert again.replay(read) is None
        assert again.cuts == 1
    without = pp.Session(model, radius=RADIUS, sweeps=4)
    assert without.replay(record.__class__(**{**vars(record), "cuts": ()})) is not None, "the cuts are in the digests"


def test_a_record_with_cuts_is_not_scored(model, top, whole):
    session = cut_session(model, top, whole)
    with pytest.raises(pp.errors.DataError, match="cut in this session"):
        pp.score(session.record(), whole)


def test_damaged_cuts_are_refused(blade):
    cuts = RecordedCut(3, "cut", blade), RecordedCut(9, "undo")
    columns = cut_columns(cuts)
    assert [(one.tick, one.kind) for one in cuts_in(columns)] == [(3, "cut"), (9, "undo")]
    assert np.array_equal(cuts_in(columns)[0].blade.points, blade.points)
    for name, bad in {
        "cuts": np.array([[3, 7], [9, 2]]),
        "cut_sizes": columns["cut_sizes"] + 1,
        "cut_points": columns["cut_points"][1:],
        "cut_triangles": columns["cut_triangles"] + 1000,
    }.items():
        with pytest.raises((ValueError, pp.errors.DataError)):
            cuts_in({**columns, name: bad})
    with pytest.raises(ValueError, match="blade without"):
        cuts_in({**columns, "cuts": np.array([[3, 2], [9, 2]])})


def test_by_the_clock_the_loop_goes_on(whole, top, model, blade):
    session, pointer = pp.Session(model, radius=RADIUS), Pointer()
    at = hold(top + (0, 8, 0))
    session.start(pointer)
    with session:
        pointer.send(at, None, 0)
        until(lambda: session.frame().tick > 400)
        assert session.cut(blade)
        first = session.frame().tick
        until(lambda: session.frame().body == 1)
        until(lambda: session.frame().tick > first + 1500)
        frame = session.frame()
        assert frame.faults == 0
        hit = whole.surface.closest(top + (0, 8, 0))
        cut = pp.model(pp.cut(whole, blade), "compliance").push(hit.point, at.displacement, RADIUS).force
        assert np.allclose(frame.force[0], cut, rtol=1e-3, atol=1e-5)
        drawn = session.drawn(frame)
        assert drawn.shape == session.displayed.places.shape
        until(lambda: session.undo())
        until(lambda: session.frame().body == 2)
    record = session.record()
    assert [one.kind for one in record.cuts] == ["cut", "undo"]
    again = pp.Session(model, radius=RADIUS, sweeps=int(record.settings["sweeps"]))
    assert again.replay(record) is None


def test_a_session_may_begin_with_a_cut_tissue_and_touch_its_lips(whole, top, blade):
    opened = pp.cut(whole, blade)
    cut = pp.model(opened, "compliance")
    lips = {"compliance": cut, "blocks": pp.model(opened, "compliance", contact=False)}  # `blocks` knows of no contact
    for name, exact in lips.items():
        model = cut if name == "compliance" else pp.model(opened, name)
        session = pp.Session(model, radius=RADIUS, sweeps=40)
        lip = opened.mesh.places[opened.mesh.skin.triangles[opened.mesh.skin.lip]].mean(axis=1)
        for point in (top + (0, 8, 0), lip[len(lip) // 2]):
            at = opened.surface.closest(np.ascontiguousarray(point, dtype=float)).point
            session.step([None] * 200)
            force = session.step([hold(at)] * 600)[-1]
            assert np.allclose(force, exact.push(at, hold(at).displacement, RADIUS).force, rtol=5e-3, atol=1e-5)
    assert pp.Session(cut).settings.radius == pytest.approx(2 * opened.edge)


def test_what_cannot_be_cut_changes_nothing(whole, top, model, blade):
    session = pp.Session(model, radius=RADIUS, sweeps=4)
    for change in (session.undo, lambda: session.cut(blade, extend=True)):
        with pytest.raises(pp.errors.DataError, match="nothing has been cut"):
            change()
    other = pp.Session(pp.model(whole, "blocks"), radius=RADIUS)
    with pytest.raises(pp.errors.MaterialError, match="change to compliance"):
        other.cut(blade)
    relaxing = whole.replace(relaxation=pp.Relaxation((0.3,), (0.5,)))
    with pytest.raises(pp.errors.MaterialError, match="relaxes"):
        pp.Session(pp.model(relaxing, "compliance"), radius=RADIUS).cut(blade)
    assert session.cut(blade)
    assert not session.cut(blade), "one change is on its way"
    with pytest.raises(pp.errors.DataError, match="tension"):
        pp.Session(model, tension=-1)


def test_another_model_of_the_cut_tissue(top, session, blade):
    session.cut(blade)
    session.step([hold(top)] * 50)
    assert session.change(pp.model(session.tissue, "multigrid"))
    session.step([hold(top)] * 400)
    with pytest.raises(pp.errors.DataError, match="another tissue"):
        session.change(session.first)


def test_what_is_drawn_moves_with_the_body(whole, blade):
    opened = pp.cut(whole, blade)
    drawn = displayed_surface(opened.mesh)
    linear = opened.mesh.nodes @ np.array([[0.1, 0.2, 0.0], [0.0, -0.1, 0.3], [0.2, 0.0, 0.1]])
    carried = drawn.carried(linear[drawn.nodes].astype(np.float32))
    expected = drawn.places @ np.array([[0.1, 0.2, 0.0], [0.0, -0.1, 0.3], [0.2, 0.0, 0.1]])
    assert np.allclose(carried, expected, atol=1e-4)
    a, b, c = (drawn.places[drawn.triangles[:, k]] for k in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6 == pytest.approx(whole.mesh.volumes.sum()), "it is closed"
    assert len(drawn.lips) == 2
    lips = (drawn.triangles >= drawn.lips[0]).all(axis=1)
    assert np.count_nonzero(lips) == np.count_nonzero(opened.mesh.skin.lip)
    assert (drawn.triangles[~lips] < drawn.lips[0]).all(), "the lips have vertices of their own"
    lump = np.linalg.norm(drawn.places[drawn.lips[1] :] - (0, 0, 10), axis=1)
    other = np.linalg.norm(drawn.places[drawn.lips[0] : drawn.lips[1]] - (0, 0, 10), axis=1)
    assert lump.max() < 9 + 2 * whole.edge, "of the lump"
    assert len(lump) > 5
    assert other.min() > 9 - 2 * whole.edge


def test_tension_opens_the_picture_alone(whole, top, model, blade):
    slack, tense = pp.Session(model, radius=RADIUS, sweeps=4), pp.Session(model, radius=RADIUS, sweeps=4, tension=2.0)
    for session in (slack, tense):
        session.cut(blade)
    at = [hold(top + (0, 8, 0))] * 100
    assert np.array_equal(slack.step(at), tense.step(at))
    assert slack.displayed.gape is None
    moved = pp.gape(tense.tissue, tension=2.0)
    drawn = tense.displayed
    assert np.abs(drawn.gape).max() > 0.5
    assert np.allclose(drawn.gape, drawn.carried(moved[drawn.nodes].astype(np.float32)), atol=1e-4)


@pytest.mark.parametrize("pieces", [1, 3])
def test_a_closed_loop_through_a_cut_costs_what_the_cut_takes(whole, top, model, pieces):
    """A hand pulls beside a way, a blade passes there, the hand lets go: all hands have done the work of the cut."""
    session = pp.Session(model, radius=RADIUS, sweeps=4, toughness=0.2, blade_friction=2e-5)
    point = tuple(map(float, top + (0, 8, 0)))
    depth = np.concatenate([np.linspace(0, 3, 8000)[1:], np.full(400, 3.0)])
    ways = np.outer(depth, (0.2, 0.9, 0.4))
    session.step([pp.Command(True, point, (0, 0, 0))] * 300)  # a hold begins softly; the way is slow, since tools lag
    pressed = session.step([pp.Command(True, point, tuple(way)) for way in ways])
    for piece in range(pieces):
        end = top + (-15 + 30 * (piece + 1) / pieces, 0, 0)
        assert session.cut(pp.incision(whole, [top - (15, 0, 0), end], depth=12), extend=piece > 0)
        session.step([pp.Command(True, point, tuple(ways[-1]))] * 1200)
    back = ways[::-1]
    let_go = session.step([pp.Command(True, point, tuple(way)) for way in back])

    def work(force, way):  # of the hand, against the tissue's force
        return -float(((force[1:] + force[:-1]) / 2 * np.diff(way, axis=0)).sum())

    (cut,) = session.cutting_work
    net = work(pressed, ways) + work(let_go, back) + cut.total
    assert cut.released > 0.05 * cut.fracture, "what was pulled is felt by the blade"
    assert net == pytest.approx(1e-3 * 0.2 * cut.area + 2e-5 * cut.area, rel=0.02)
    assert session.undo()
    assert session.cutting_work == ()
