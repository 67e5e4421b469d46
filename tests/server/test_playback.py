"""Playing records: so many ticks a second as the speed says, by a clock of the test's own; what a page asks is obeyed."""

import asyncio
import struct
import time
from itertools import pairwise
from types import SimpleNamespace

import pytest
from support.example_organs import organ
from websockets.sync.client import connect

import palpate as pp
from palpate.server import playback
from palpate.server.live_session import LiveSession
from palpate.server.loopback_server import loopback_socket
from palpate.server.message_kinds import PlayStep
from palpate.server.messages import BINARY, Frame, Play, Position, code, encode
from palpate.server.playback import Playback
from palpate.server.touch import replayed, running_session
from palpate.simulation.replay import Replay

FRAME, POSITION = (BINARY.index(kind) + 1 for kind in (Frame, Position))
STEP = 0.05  # s of the test's clock between two looks at it


@pytest.fixture
def live():
    model = pp.model(organ(6), "springs")
    session = pp.Session(model, radius=14.0, sweeps=2)
    session.step([pp.Command(True, (0.0, 0.0, 25.0), (0, 0, -3))] * 3000)
    return LiveSession(pp.Session(model, radius=14.0, sweeps=2), Replay(session.record()))


@pytest.fixture
def shown(live, monkeypatch):
    """Ticks that are published while the given messages come, each after one frame more."""

    def run(*messages, frames=12):
        clock, ticks, waiting = iter(range(10**6)), [], list(messages)
        monkeypatch.setattr(playback, "time", SimpleNamespace(monotonic=lambda: STEP * next(clock)))
        monkeypatch.setattr(playback, "FRAME_TIME", 0.0)
        live.pages = {object(): asyncio.Event()}

        async def tell(what):
            return None

        async def play():
            live.tell = tell
            player, done = Playback([live]), asyncio.Event()

            def publish():
                ticks.append(live.player.tick)
                if waiting:
                    player.obey(waiting.pop(0))
                elif len(ticks) >= frames:
                    done.set()

            live.publish_replay = publish
            running = asyncio.create_task(player.run())
            await asyncio.wait_for(done.wait(), 60)
            running.cancel()
            return player

        return asyncio.run(play()), ticks

    return run


@pytest.mark.parametrize("speed", [0.25, 1.0, 4.0])
def test_so_many_ticks_pass_as_the_speed_says(shown, speed):
    _, ticks = shown(Play(PlayStep.speed, speed))
    steps = [b - a for a, b in pairwise(ticks[2:])]
    assert steps == pytest.approx([1000 * STEP * speed] * len(steps), abs=1)


def test_a_page_goes_to_a_tick_and_playing_goes_on_from_there(shown):
    _, ticks = shown(Play(PlayStep.seek, 2000.0), Play(PlayStep.seek, 100.0))
    assert 2000 <= ticks[1] <= 2100
    assert 100 <= ticks[2] <= 200 < ticks[-1] < 1000


def test_no_page_is_told_that_it_is_there_before_it_is(live, monkeypatch):
    """On a slow machine a short way takes long too. Playing on is no way of which pages are told."""
    monkeypatch.setattr(playback, "TELL_INTERVAL", 0.01)
    live.pages = {object(): asyncio.Event()}
    go, log = live.player.go_to, []

    def slow(tick, goes_on):
        time.sleep(0.04)
        return go(tick, goes_on)

    async def play():
        async def tell(what):
            log.append(struct.unpack(code(Position), what)[1:])

        monkeypatch.setattr(live.player, "go_to", slow)
        monkeypatch.setattr(live, "tell", tell)
        player = Playback([live])
        player.obey(Play(PlayStep.pause, 0.0))

        def publish():
            log.append(live.player.tick)
            if log == [0]:
                player.obey(Play(PlayStep.seek, 600.0))

        monkeypatch.setattr(live, "publish_replay", publish)
        running = asyncio.create_task(player.run())
        while log[-1:] != [(0, 1.0, 600.0, 1.0, 1)]:
            await asyncio.sleep(0.01)
        player.obey(Play(PlayStep.play, 0.0))
        while not isinstance(log[-1], int) or log[-1] <= 700:
            await asyncio.sleep(0.01)
        running.cancel()

    asyncio.run(asyncio.wait_for(play(), 60))
    there = log.index(600)
    before = [one for one in log[:there] if isinstance(one, tuple) and one[-1] == 1]
    assert len(before) >= 2
    assert all(share < 1 for *_, share, _ in before)
    after = [one for one in log[there:] if isinstance(one, tuple)]
    assert [share for *_, share, _ in after] == [1.0, 1.0]  # at the pause's tick, and once as it plays


def test_it_stops_at_the_end_and_begins_again(shown):
    player, ticks = shown(Play(PlayStep.speed, 4.0), Play(PlayStep.seek, 2900.0), frames=4)
    assert ticks[-1] == 3000
    assert not player.playing
    player.obey(Play(PlayStep.play, 0.0))
    assert (player.playing, player.position) == (True, 0.0)
    player.obey(Play(PlayStep.seek, 1e12))
    assert player.position == 3000


def test_a_page_that_comes_to_a_pause_is_shown_it(live):
    """Also that of the second replay, which the page opens once it knows that there are two."""
    record, tissue = live.player.record, live.session.first.tissue
    served = replayed({"mine": record, "hers": record}, {"organ": tissue}, 0.0, ())
    with running_session(served, loopback_socket(None)) as address:
        base, token = address.split("/?")
        where = f"{base.replace('http', 'ws')}/socket?{token}"
        with connect(where, origin=base) as first:
            first.send(encode(Play(PlayStep.play, 0.0)))
            first.send(encode(Play(PlayStep.pause, 0.0)))
            until(first, lambda data: data[0] == POSITION and not struct.unpack(code(Position), data)[1])
            for asked in (where, f"{where}&beside=1"):
                with connect(asked, origin=base) as late:
                    until(late, lambda data: data[0] == FRAME)


def until(page, wanted):
    """Until a message of the server is as wanted."""
    while not wanted(page.recv(timeout=10)):
        pass
