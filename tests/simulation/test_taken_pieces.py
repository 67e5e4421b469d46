"""Pieces that the cuts of a session free: the body is without them, they are told, and come back with undo."""

import numpy as np
import pytest
from fuzz.random_cuts import gaps
from support.example_organs import organ

import palpate as pp
from palpate.server.cutting_stroke import told_of_pieces

RADIUS = 8.0
BOX = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
SIDES = [
    *((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)),
    *((2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)),
]


@pytest.fixture(scope="module")
def whole():
    return organ(10)


@pytest.fixture(scope="module")
def model(whole):
    return pp.model(whole, "compliance")


@pytest.fixture
def session(model):
    return pp.Session(model, radius=RADIUS, sweeps=4, toughness={"organ": 164, "lump": 300})


def lump(tissue):
    """Tetrahedra of the lump."""
    return np.flatnonzero(tissue.mesh.region == {v: k for k, v in tissue.mesh.names.items()}["lump"])


def around_the_lump(tissue, part=1.0):
    """A closed blade around the lump, or around its half at smaller x."""
    nodes = tissue.mesh.nodes[tissue.mesh.tets[lump(tissue)]].reshape(-1, 3)
    low, high = nodes.min(axis=0) - 0.37, nodes.max(axis=0) + 0.41
    high[0] = low[0] + part * (high[0] - low[0])
    return pp.Blade((low + high) / 2 + BOX * (high - low) / 2, SIDES)


def beheading(tissue, below=9.0):
    """A flat blade through everything, `below` mm under the top."""
    top = tissue.mesh.nodes[:, 2].max() - below
    return pp.Blade.swept([(-200, -200, top), (200, -200, top)], (0, 1, 0), 400)


def test_a_lump_that_is_cut_out_is_told(whole, session):
    mesh = whole.mesh
    assert session.cut(around_the_lump(whole))
    size = mesh.volumes[lump(whole)].sum()
    assert session.taken["lump"] == pytest.approx(size, rel=1e-9)
    assert session.taken["lump"] + session.taken["organ"] == pytest.approx(
        mesh.volumes.sum() - session.mesh.volumes.sum()
    )
    assert told_of_pieces(session, whole).endswith("came free: 100% of lump. Pull or Grasp takes it out.")
    assert gaps(session.mesh.skin.triangles) == [], "the hole is closed"


def test_what_is_left_in_the_organ_is_told(whole, session):
    assert session.cut(around_the_lump(whole, part=0.5))
    corners, volume = whole.mesh.nodes[whole.mesh.tets[lump(whole)]], whole.mesh.volumes[lump(whole)]
    weights = np.random.default_rng(1).dirichlet(np.ones(4), 20_000)  # points that fill a tetrahedron evenly
    beyond = np.einsum("pk,tk->tp", weights, corners[:, :, 0]) < around_the_lump(whole, part=0.5).points[:, 0].max()
    assert session.taken["lump"] == pytest.approx(beyond.mean(axis=1) @ volume, rel=0.01)
    out = beyond.mean(axis=1) @ volume / volume.sum()
    assert float(told_of_pieces(session, whole).split(": ")[1].split("%")[0]) == pytest.approx(100 * out, abs=1.0)
    session.step([None] * 3)
    assert session.cut(around_the_lump(whole))
    assert told_of_pieces(session, whole).endswith("100% of lump. Pull or Grasp takes it out.")


def test_the_force_of_what_is_left_is_that_of_a_push_on_it(whole, session):
    blade = around_the_lump(whole)
    session.cut(blade)
    left = pp.cut(whole, blade, loose="remove")
    top = whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]
    force = session.step([pp.Command(True, tuple(top), (0.0, 0.0, -3.0))] * 600)[-1]
    expected = pp.model(left, "compliance").push(top, (0, 0, -3), RADIUS).force
    assert force == pytest.approx(expected, abs=1e-3 * np.linalg.norm(expected))


def test_a_hand_on_what_comes_free_feels_the_body_no_more_and_others_hold_on(whole, session):
    top = whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]
    side = whole.surface.closest(np.array((60.0, 0.0, 0.0))).point
    pull, press = pp.Command(True, tuple(top), (0.0, 0.0, 2.0)), pp.Command(True, tuple(side), (-1.0, 0.0, 0.0))
    before = session.step([[pull, press]] * 300)[-1]
    assert np.linalg.norm(before[0]) > 0.05
    assert session.cut(beheading(whole))
    after = session.step([[pull, press]] * 600)
    assert not after[5:, 0].any(), "it weighs nothing, since nobody knows its density"
    assert np.linalg.norm(after[-1, 1]) > 0.5 * np.linalg.norm(before[1])
    session.step([[pp.Command(), press]] * 5)
    lower = session.tissue.surface.closest(top).point
    assert np.linalg.norm(session.step([[pp.Command(True, tuple(lower), (0, 0, -2)), press]] * 300)[-1, 0]) > 0.05


def test_undo_gives_it_back_and_the_next_cut_goes_on_from_there(whole, session, model):
    top = whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]
    press = pp.Command(True, tuple(top), (0.0, 0.0, -2.0))
    assert session.cut(beheading(whole))
    session.step([None] * 3)
    on_it = [session.tissue.surface.closest(np.array((x, 0.0, 30.0))).point for x in (-8.0, 8.0)]
    assert session.cut(pp.incision(session.tissue, on_it, depth=6)), "what is left is cut"
    assert session.cuts == 2
    for _ in range(2):
        session.step([None] * 3)
        session.undo()
    session.step([None] * 3)
    assert session.taken == {}
    untouched = pp.Session(model, radius=RADIUS, sweeps=4)
    assert np.array_equal(session.step([press] * 200), untouched.step([press] * 200))


def test_its_work_counts_the_whole_cut(whole, session):
    """Though one of its lips is no longer there."""
    blade = beheading(whole)
    session.cut(blade)
    top = np.flatnonzero(whole.mesh.nodes[:, 2] > whole.mesh.nodes[:, 2].max() - 5)
    kept = pp.cut(whole.replace(fixed=np.union1d(whole.fixed, top)), blade)  # held on both sides: nothing comes free
    expected = pp.cutting_work(whole, kept, {"organ": 164, "lump": 300})
    assert session.cutting_work[-1].area == pytest.approx(expected.area, rel=1e-9)
    assert session.cutting_work[-1].fracture == pytest.approx(expected.fracture, rel=1e-6)


def test_a_blade_meets_nothing_where_a_piece_was_taken_away(whole, session):
    """Its upper end goes through the air where the top was: only what it cuts of what is left counts."""
    session.cut(beheading(whole))
    session.step([None] * 3)
    on_it = [session.tissue.surface.closest(np.array((x, 0.5, 30.0))).point for x in (-8.0, 8.0)]
    assert session.cut(pp.incision(session.tissue, on_it, depth=6))
    assert session.cutting_work[-1].area == pytest.approx(16 * 6, rel=0.02)


def test_what_is_left_is_kept_in_a_file(whole, session, tmp_path):
    session.cut(around_the_lump(whole))
    pp.write_tissue(tmp_path / "left.vtu", session.tissue)
    left = pp.read_tissue(tmp_path / "left.vtu")
    assert left.mesh.figures == session.mesh.figures
    assert "ml taken away" in left.mesh.text()
    top = whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]
    forces = [pp.model(t, "compliance").push(top, (0, 0, -2), RADIUS).force for t in (left, session.tissue)]
    assert np.array_equal(*forces)
    with pytest.raises(pp.errors.MaterialError, match="taken away"):
        pp.export(left, tmp_path / "left.html")


def test_a_record_takes_the_same_pieces_away(whole, session, model, tmp_path):
    top = whole.mesh.nodes[np.argmax(whole.mesh.nodes[:, 2])]
    press = pp.Command(True, tuple(top), (0.0, 0.0, -2.0))
    session.step([press] * 100)
    session.cut(around_the_lump(whole))
    session.step([press] * 300)
    pp.write_record(tmp_path / "session.h5", session.record())
    again = pp.Session(model, radius=RADIUS, sweeps=4, toughness={"organ": 164, "lump": 300})
    assert again.replay(pp.read_record(tmp_path / "session.h5")) is None
    assert again.taken == session.taken


def test_where_nothing_would_be_left_the_cut_is_refused(whole):
    """The held nodes lie on both sides of the blade, three on neither."""
    nodes = whole.mesh.nodes[whole.fixed]
    three = whole.fixed[[nodes[:, 0].argmin(), nodes[:, 0].argmax(), nodes[:, 1].argmax()]]
    session = pp.Session(pp.model(whole.replace(fixed=three), "compliance"), radius=RADIUS)
    x = np.sort(whole.mesh.nodes[three][:, 0])[:2].mean()
    with pytest.raises(pp.errors.MaterialError, match="no piece of the cut tissue is held"):
        session.cut(pp.Blade.swept([(x, -200, 100), (x, 200, 100)], (0, 0, -1), 400))
    assert session.cuts == 0
