"""Scores of sessions: what they say is so."""

import dataclasses

import numpy as np
import pytest
from support.brick_meshes import block
from support.example_organs import organ
from support.scored_session import LUMP_TOP, RADIUS, TOP, hold, in_which_region, needle, press, session_of, stepped

import palpate as pp
from palpate.errors import DataError
from palpate.simulation.scoring import EVERY, SessionScorer
from palpate.simulation.session import LUMP, SAMPLE


def test_a_slow_press_and_its_scores(models, tissue):
    """Way, force, work and strain of a press, against the model's own answer to a push."""
    session = session_of(models["blocks"])
    commands = press(4.0, 1000) + press(4.0, 100, 4.0)
    force = stepped(session, commands)[:, 0]
    answer = models["blocks"].push(TOP, (0, 0, -4.0), RADIUS, tolerance=1e-4)
    found = pp.score(session.record(), tissue, pp.Task(strain=0.05))
    assert found.path[0] == pytest.approx(4.0, rel=0.015)  # but for what it went before the first look
    assert found.path[1:] == (0, 0, 0)
    assert found.touches == 1
    assert found.max_force == pytest.approx(np.linalg.norm(answer.force), rel=0.02)
    assert found.max_force == np.linalg.norm(force, axis=1).max()
    assert found.mean_force == pytest.approx(np.linalg.norm(force, axis=1).mean(), rel=2e-3)
    assert found.work == pytest.approx(0.5 * 4.0 * answer.force[2], rel=0.03)  # half of force times way: it is linear
    assert found.seconds == pytest.approx(1.09)
    gradients = []
    for tet in tissue.mesh.tets:
        rest, now = tissue.mesh.nodes[tet], (tissue.mesh.nodes + answer.displacement)[tet]
        gradients.append(np.linalg.solve(rest[1:] - rest[0], now[1:] - now[0]).T)
    stretch = np.linalg.svd(np.array(gradients))[1][:, 0] - 1
    assert found.max_strain == pytest.approx(stretch.max(), rel=0.02)
    assert found.strained == pytest.approx(tissue.mesh.volumes[stretch > 0.05].sum(), rel=0.05)
    first = found.strain_time[np.argmax(found.strain > 0.05)]
    assert found.over_strain == pytest.approx(1.1 - first + 0.1)
    assert len(found.time) == len(found.force) == 110
    assert found.force.max() == found.max_force


def test_time_above_a_force_is_that_of_the_ticks(models, tissue):
    session = session_of(models["blocks"])
    force = stepped(session, press(4.0, 400) + press(0.0, 400, 4.0) + [[None]] * 50)
    size = np.linalg.norm(force, axis=2).max(axis=1)
    limit = 0.6 * size.max()
    found = pp.score(session.record(), tissue, pp.Task(force=float(limit)))
    assert found.over_force == pytest.approx((size > limit).sum() / 1000)
    assert 0.1 < found.over_force < 0.7


def test_a_lump_is_found_where_it_is(models, tissue):
    session = session_of(models["blocks"])
    stepped(session, press(3.0, 300))
    session.mark(LUMP)
    stepped(session, [[None]] * 200)
    session.mark(LUMP)  # no tool on the organ
    stepped(session, press(3.0, 300, point=(38.0, 0.0, 0.0)))
    session.mark(LUMP)  # far from it
    found = pp.score(session.record(), tissue, pp.Task("lump"))
    assert (found.target, found.found, found.sought, found.wrong) == ("lump", 1, 1, 2)
    right, idle, far = found.claims
    assert right.right
    assert right.distance == pytest.approx(25 - LUMP_TOP, abs=1.5)
    assert right.nearest <= right.distance
    assert (idle.right, idle.distance) == (False, None)
    assert not far.right
    assert far.distance > 25
    assert found.seconds == pytest.approx(0.29, abs=0.02)
    assert "1 of 1 found, 2 wrong" in found.text()


@pytest.mark.parametrize("depth", [2.0, 6.0, 10.0, 12.0, 17.0, 30.0])
def test_a_sample_is_right_where_the_tip_is_in_the_lump_as_it_lies_then(models, tissue, depth):
    """Beside a finger that pushes the tissue aside; by the tet of the deformed body in which the tip is.

    With smoothed elements the organ gives way more, so that a needle pierces it at 6 mm; of P1 it did at 5.
    """
    session = session_of(models["compliance"])
    aside = hold((14.0, 0.0, 23.0), (-5.0, 0, -4.0))
    stepped(session, [[aside, needle(d)] for d in np.linspace(0, depth, 600)] + [[aside, needle(depth)]] * 200)
    session.mark(SAMPLE, 1)
    frame = session.frame()
    found = pp.score(session.record(), tissue, pp.Task("biopsy"))
    (claim,) = found.claims
    if depth == 2:
        assert frame.insertion[1] == 0  # it has only dented the skin
        assert (claim.right, claim.distance) == (False, None)
        return
    assert found.punctures == 1
    assert np.dot(frame.axis[1], (0, 0, -1)) == pytest.approx(1, abs=1e-6)
    tip = np.array(frame.point[1]) + frame.displacement[1] + frame.insertion[1] * np.array(frame.axis[1])
    np.testing.assert_allclose(tip, frame.tip[1], atol=0.2)
    label = in_which_region(tissue.mesh, tissue.mesh.nodes + session.displacement, tip)
    assert claim.right == (label == 2)
    assert claim.right == (depth in (10.0, 12.0, 17.0)), claim
    assert (claim.distance == 0) == claim.right
    if depth == 30:
        assert claim.distance > 1


def test_the_target_is_the_stiffest_region_unless_named(tissue):
    mesh = tissue.mesh
    middles = mesh.nodes[mesh.tets].mean(axis=1)
    region = mesh.region.copy()
    region[np.linalg.norm(middles - (20, 0, 0), axis=1) < 9] = 3
    both = pp.TetMesh(mesh.nodes, mesh.tets, region, {1: "organ", 2: "lump", 3: "cyst"})
    two = pp.Tissue(both, {"organ": 5.0, "lump": 50.0, "cyst": 1.0}, 0.45, tissue.fixed)
    session = pp.Session(pp.model(two), radius=RADIUS, sweeps=1)
    session.step([None])
    assert pp.score(session.record(), two, pp.Task("lump")).target == "lump"
    assert pp.score(session.record(), two, pp.Task("lump", "cyst")).target == "cyst"
    with pytest.raises(DataError, match=r"'stone'.*there are lump, cyst"):
        pp.score(session.record(), two, pp.Task("lump", "stone"))


def test_an_idle_session_has_scores(models, tissue):
    session = session_of(models["blocks"])
    found = pp.score(session.record(), tissue)
    assert (found.seconds, found.max_force, found.mean_force, found.work, len(found.time)) == (0, 0, 0, 0, 0)
    session.step([None] * 25)
    found = pp.score(session.record(), tissue, pp.Task("lump"))
    assert (found.found, found.sought, found.touches, len(found.force)) == (0, 1, 0, 3)


def test_a_record_of_another_tissue_has_no_score_here(models):
    session = session_of(models["blocks"])
    session.step([None])
    with pytest.raises(DataError, match="open the tissue it was recorded with"):
        pp.score(session.record(), organ(7))


@pytest.mark.parametrize(
    ("change", "words"),
    [({"kind": "dance"}, "choose one of touch, lump, biopsy"), ({"within": 0}, "within: 0"), ({"force": -1}, "force: -1"),
     ({"strain": float("nan")}, "strain: nan")],
)  # fmt: skip
def test_tasks_that_cannot_be(change, words):
    with pytest.raises(DataError, match=words):
        pp.Task(**change)


def test_an_organ_without_a_lump_sets_no_such_task(tissue):
    plain = pp.Tissue(pp.TetMesh(tissue.mesh.nodes, tissue.mesh.tets), 5.0, 0.45, tissue.fixed)
    session = pp.Session(pp.model(plain), radius=RADIUS, sweeps=1)
    with pytest.raises(DataError, match="no lump in it"):
        pp.score(session.record(), plain, pp.Task("biopsy"))


def test_a_watch_refuses_steps_that_it_cannot_see(models):
    session = session_of(models["blocks"])
    watch = SessionScorer(session, pp.Task())
    watch.see(session.step([[None]] * EVERY))
    with pytest.raises(DataError, match="at most 10"):
        watch.see(session.step([[None]] * (EVERY + 1)))


def test_record_is_judged_with_its_own_settings(models, tissue):
    """A needle force that the record does not name as this palpate has it is another simulator: refused."""
    session = session_of(models["blocks"])
    session.step([None])
    record = session.record()
    with pytest.raises(DataError, match="puncture"):
        pp.score(dataclasses.replace(record, settings={**record.settings, "puncture": 9.0}), tissue)


def test_a_mark_on_an_organ_without_lumps_is_a_claim_that_is_wrong():
    whole = block(4)
    session = pp.Session(pp.model(whole, "compliance"), radius=20.0, sweeps=4)
    session.step([pp.Command(True, (25.0, 25.0, 50.0), (0.0, 0.0, -2.0))] * 100)
    session.mark(LUMP)
    session.mark(SAMPLE)
    found = pp.score(session.record(), whole, pp.Task())
    assert [claim.right for claim in found.claims] == [False, False]


def test_a_mark_may_lie_as_far_beside_a_lump_as_the_task_says(models, tissue):
    """Of one session, a mark some way beside; a millimetre less than that is not enough."""
    session = session_of(models["blocks"])
    stepped(session, press(3.0, 300, point=(16.0, 0.0, 19.2)))
    session.mark(LUMP)
    record = session.record()
    (claim,) = pp.score(record, tissue, pp.Task("lump", within=50.0)).claims
    to_the_ball = np.linalg.norm((16.0, 0.0, 19.2 - 10.0)) - 9.0  # see LUMP_TOP
    assert claim.distance == pytest.approx(to_the_ball, abs=1.5)
    beside = claim.distance - claim.nearest
    assert 1.5 < beside < 20
    for within, right in ((beside - 1, False), (beside + 1, True)):
        found = pp.score(record, tissue, pp.Task("lump", within=within))
        assert (found.found, found.wrong) == (int(right), int(not right))
