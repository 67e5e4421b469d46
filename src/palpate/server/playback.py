"""Plays the records of one replay, or of two side by side, as the pages ask: paused, at a speed, from a tick on."""

import asyncio
import contextlib
import time
from collections.abc import Sequence

import numpy as np

from palpate.server.live_session import LiveSession
from palpate.server.message_kinds import PlayStep
from palpate.server.messages import Play, Position, encode, timeline_bytes
from palpate.simulation.record_events import bin_ticks, force_curve, limit_events, record_events
from palpate.simulation.record_player import RecordPlayer
from palpate.simulation.session import RATE, Session
from palpate.simulation.session_compatibility import recorded_settings

FRAME_TIME = 1 / 60  # s between frames
MOST_BEHIND = 0.25  # s: what a slow machine loses more, it does not catch up
TELL_INTERVAL, CURVE_INTERVAL = 0.25, 1.0  # s
PULSE = 0.5  # s between frames of a pause in a room: its pages take a server that is silent for lost (room-liveness.ts)


class Playback:
    """Used on the event loop's thread only. lives: the replays; pages of the first one have the timeline."""

    def __init__(self, lives: Sequence[LiveSession]) -> None:
        self.lives = lives
        self.players: list[RecordPlayer] = [live.player for live in lives if live.player is not None]
        self.length = max(player.record.length for player in self.players)
        self.playing, self.speed, self.position = True, 1.0, 0.0
        self.sought = 0  # how often a tick was asked for
        self.curves = [np.zeros(0) for _ in self.players]
        self._changed = asyncio.Event()
        self._pause = PULSE if any(live.room for live in lives) else None  # s between frames while paused

    @property
    def opened(self) -> bool:
        """Whether a page has come: a replay begins with the first one."""
        return any(live.pages for live in self.lives)

    def obey(self, message: Play) -> None:
        """Obeys a page."""
        if message.step == PlayStep.seek:
            self.position = float(min(message.value, self.length))
            self.sought += 1
        elif message.step == PlayStep.speed:
            self.speed = message.value
        else:
            self.playing = message.step == PlayStep.play
            if self.playing and self.position >= self.length:
                self.position = 0.0
                self.sought += 1
        self.wake()

    def wake(self) -> None:
        """A page has come, or asked for something."""
        self._changed.set()

    def greetings(self) -> list[bytes]:
        """What a page is told when it comes."""
        return [self.timeline(), self.where(1.0)]

    def where(self, there: float) -> bytes:
        """The position as a message. there: share of the way to it that is computed."""
        return encode(Position(int(self.playing), self.speed, self.position, there, self.sought))

    def timeline(self) -> bytes:
        """The timeline as a message."""
        told = []
        for live, player, curve in zip(self.lives, self.players, self.curves, strict=True):
            record, width = player.record, bin_ticks(player.record)
            events = [*record_events(record), *limit_events(curve, width, record.settings["limit"])]
            told.append((live.title, record.length, width, sorted(events, key=lambda one: one.tick), curve))
        return timeline_bytes(told)

    async def run(self) -> None:
        """Plays until it is cancelled."""
        before, shown, arrived = time.monotonic(), None, 0
        try:
            while True:
                now = time.monotonic()
                going = self.playing and self.opened
                if going:
                    self.position = min(self.length, self.position + self.speed * RATE * min(now - before, MOST_BEHIND))
                before, sought = now, self.sought
                await self._show(int(self.position), sought, tells=sought != arrived)
                if self.position >= self.length:
                    self.playing = False
                arrived = sought
                state = self.playing, self.speed, self.sought
                if state != shown and sought == self.sought:
                    shown = state
                    await self.lives[0].tell(self.where(1.0))
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._changed.wait(), FRAME_TIME if going else self._pause)
                self._changed.clear()
        finally:
            self.sought += 1  # a way that is being computed ends

    async def _show(self, tick: int, sought: int, tells: bool) -> None:
        """Goes to a tick and publishes its frames, unless another one is asked for meanwhile.

        tells: whether the pages hear how far the way has come, if it takes long.
        """
        for live, player in zip(self.lives, self.players, strict=True):
            goal = min(tick, player.record.length)
            start = player.tick if player.tick <= goal else 0
            way = asyncio.create_task(asyncio.to_thread(player.go_to, goal, lambda: sought == self.sought))
            while not (await asyncio.wait([way], timeout=TELL_INTERVAL))[0]:
                there = max(0.0, min(0.99, (player.tick - start) / max(goal - start, 1)))
                for each in self.lives if tells else ():
                    await each.tell(self.where(there))
            if await way:
                live.publish_replay()

    async def measure(self) -> None:
        """Computes the curves of the forces beside the playing, and tells the pages as they grow."""
        for k, player in enumerate(self.players):
            first, tension = player.session.first, player.session.tension
            fresh = Session(first, **recorded_settings(player.record), tension=tension)
            curve, told = force_curve(fresh, player.record), time.monotonic()
            while (newest := await asyncio.to_thread(next, curve, None)) is not None:
                self.curves[k] = newest
                if time.monotonic() - told > CURVE_INTERVAL:
                    told = time.monotonic()
                    await self.lives[0].tell(self.timeline())
            await self.lives[0].tell(self.timeline())
