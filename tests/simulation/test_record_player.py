"""Seeking in a record: every state is that of playing, to the bit; and what happened stands at its tick."""

import numpy as np
import pytest
from support.example_organs import organ

import palpate as pp
from palpate.simulation.record_events import bin_ticks, force_curve, limit_events, record_events
from palpate.simulation.record_player import RecordPlayer

TOP = (0.0, 0.0, 25.0)
HOW = {"radius": 8.0, "sweeps": 3}


@pytest.fixture(scope="module")
def recorded(models):
    """Presses, a change of model under the hand, a needle, a claim, a note."""
    session = pp.Session(models["blocks"], **HOW)
    session.step([None] * 130)
    session.step([pp.Command(True, TOP, (0, 0, -0.01 * k)) for k in range(400)])
    session.mark(0)
    session.note("hard", TOP)
    assert session.change(models["springs"], 4)
    session.step([pp.Command(True, TOP, (0.5, 0, -4))] * 520)
    session.step([None] * 150)
    session.step([[None, None, None, pp.Command(True, (25, 0, 18), (-6, 0, -6), "needle")]] * 300)
    return session.record()


def player(models, record):
    return RecordPlayer(pp.Session(models["blocks"], **HOW), record)


def state(of):
    return of.session.displacement.tobytes()


@pytest.mark.parametrize("tick", [0, 1, 529, 530, 531, 900, 1499, 1500])
def test_every_way_to_a_tick_ends_in_the_state_of_playing(models, recorded, tick):
    played = player(models, recorded)
    for k in range(0, tick + 1, 16):  # as the page plays
        assert played.go_to(min(k, tick))
    played.go_to(tick)
    ahead, back = player(models, recorded), player(models, recorded)
    ahead.go_to(tick)
    back.go_to(1200)
    back.go_to(300)
    back.go_to(tick)
    assert played.tick == ahead.tick == back.tick == tick
    assert state(played) == state(ahead) == state(back)
    digests = back.session.record().digests
    assert np.array_equal(digests, recorded.digests[recorded.digest_ticks <= tick])


def test_going_back_over_a_cut_takes_it_back_and_forwards_cuts_again():
    tissue = organ(7)
    model = pp.model(tissue, "compliance")
    session = pp.Session(model, radius=12.0)
    press = [pp.Command(True, TOP, (0, 0, -2))]
    session.step(press * 200)
    assert session.cut(pp.incision(tissue, [(-8, 0, 25), (8, 0, 25)], depth=8))
    session.step(press * 200)
    record, end = session.record(), session.displacement.tobytes()
    seeking = RecordPlayer(pp.Session(model, radius=12.0, sweeps=session.settings.sweeps), record)
    seeking.go_to(400)
    assert (seeking.session.cuts, state(seeking)) == (1, end)
    seeking.go_to(150)
    assert seeking.session.cuts == seeking.session.bodies == 0
    seeking.go_to(400)
    assert (seeking.session.cuts, state(seeking)) == (1, end)


def test_a_way_that_is_not_wanted_any_more_ends(models, recorded):
    seeking, asked = player(models, recorded), iter([True, False])
    assert not seeking.go_to(1500, lambda: next(asked))
    assert 0 < seeking.tick < 1500
    assert seeking.go_to(10**9)
    assert seeking.tick == recorded.length


def test_events_stand_at_the_tick_at_which_they_happened(recorded):
    events = [(event.tick, event.kind) for event in record_events(recorded)]
    assert events == [
        (130, "touch"), (530, "model"), (530, "claim"), (530, "note"), (1050, "release"), (1200, "touch"),
    ]  # fmt: skip
    texts = [event.text for event in record_events(recorded)]
    assert texts[1:4] == ["Model springs", "Claim: a lump is here", "Note: hard"]
    assert texts[-1] == "Tool 4 drives a needle"


def test_the_curve_of_forces_is_the_greatest_of_any_tool_in_each_bin(models, recorded):
    width = bin_ticks(recorded)
    *_, curve = force_curve(pp.Session(models["blocks"], **HOW), recorded)
    force = np.concatenate([f for _, f in pp.Session(models["blocks"], **HOW).replayed(recorded, 100)])
    size = np.sqrt((force**2).sum(axis=2)).max(axis=1)
    assert len(curve) == recorded.length // width
    np.testing.assert_array_equal(curve, [part.max() for part in np.split(size, len(curve))])
    limit = 0.5 * curve.max()
    (first, *_) = limit_events(curve, width, limit)
    assert size[: first.tick].max() <= limit < size[first.tick : first.tick + width].max()
