"""Playing records: so many ticks a second as the speed says, by a clock of the test's own; what a page asks is obeyed."""

import asyncio
from itertools import pairwise
from types import SimpleNamespace

import pytest
from support.example_organs import organ

import palpate as pp
from palpate.server import playback
from palpate.server.live_session import LiveSession
from palpate.server.messages import Play, PlayStep
from palpate.server.playback import Playback
from palpate.simulation.replay import Replay

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


def test_it_stops_at_the_end_and_begins_again(shown):
    player, ticks = shown(Play(PlayStep.speed, 4.0), Play(PlayStep.seek, 2900.0), frames=4)
    assert ticks[-1] == 3000
    assert not player.playing
    player.obey(Play(PlayStep.play, 0.0))
    assert (player.playing, player.position) == (True, 0.0)
    player.obey(Play(PlayStep.seek, 1e12))
    assert player.position == 3000
