"""How many frames are under way to a page. Without a limit a narrow way would fill, and a page see ever older ones."""

import asyncio
import math
import time
from collections import deque

TELLING = 0.1  # s between two words of a page, from the first frame on
WAITING = 2 * TELLING  # s that frames may take beyond the time of an empty way
LEAST = 1  # frame that may be under way on any way
REMEMBERED = 4096  # frames that were sent and of which nothing was said
COUNTED = 1.0  # s over which frames are counted that come
FORGOTTEN = 3.0  # s in which the rate falls by e where the way carries less than before
UNEVEN = 1.25  # times the time of an empty way that the way may take by itself
GROWTH = 1.1  # of the rate with a word of a page, where frames are held back and none has waited


class FrameFlow:
    """Of one page. Used on the event loop's thread only. A page that never says what has come gets all frames.

    As many frames are under way as come while one goes and is told of: their rate times the round trip of an empty way, as in
    BBR (Cardwell et al., ACM Queue 14, 2016). The rate falls only while this limit holds frames back, since a paused
    replay sends few over any way. A way that has become longer lets ever fewer under way, until one goes alone and
    tells how long it is now.
    """

    def __init__(self) -> None:
        self.sent = 0
        # Of each frame: its number, when it was sent, and whether it is alone on the way.
        self._in_flight: deque[tuple[int, float, bool]] = deque(maxlen=REMEMBERED)
        self._acknowledged: deque[tuple[float, int]] = deque()  # when the page said how many have come
        self._tells = False
        self._told = asyncio.Event()
        self._rate = 0.0  # frames a second that come
        self._round_trip = 0.0  # s, from a frame to the page's word of it on an empty way
        self._tried = self._held_back = False

    def send(self) -> None:
        """A frame is sent."""
        self.sent += 1
        self._in_flight.append((self.sent, time.monotonic(), not self._in_flight))

    def taken(self, count: int) -> None:
        """The page has taken so many frames."""
        self._tells = True
        count = min(count, self.sent)
        now = time.monotonic()
        self._count(now, count)
        came = []
        while self._in_flight and self._in_flight[0][0] <= count:
            came.append(self._in_flight.popleft())
        if came:
            self._measure(now, came)
        self._held_back = False
        self._told.set()

    def _count(self, now: float, count: int) -> None:
        """The rate of the frames that come."""
        acknowledged = self._acknowledged
        if not acknowledged:
            acknowledged.append((now - TELLING, 0))
        while len(acknowledged) > 1 and acknowledged[1][0] <= now - COUNTED:
            acknowledged.popleft()
        then, before = acknowledged[0]
        rate = (count - before) / max(now - then, 1e-3)
        if self._held_back:
            self._rate *= math.exp((acknowledged[-1][0] - now) / FORGOTTEN)
        self._rate = max(rate, self._rate)
        acknowledged.append((now, count))

    def _measure(self, now: float, came: list[tuple[int, float, bool]]) -> None:
        """The time of an empty way, from frames of which the page has just said that they have come.

        The newest came a moment ago, the first up to `TELLING` before. One that was alone did not wait for others.
        """
        for _, sent, alone in came:
            if alone and self._tried:
                self._round_trip = max(self._round_trip, now - sent - TELLING)
        took = now - came[-1][1]
        self._round_trip, self._tried = min(self._round_trip, took) if self._tried else took, True
        if self._held_back and took < UNEVEN * self._round_trip + WAITING / 4:
            self._rate *= GROWTH

    @property
    def behind(self) -> bool:
        """Whether too many frames are under way for another one to follow."""
        if self._tells and len(self._in_flight) >= LEAST + self._rate * (self._round_trip + WAITING):
            self._held_back = True
            return True
        return False

    async def ready(self) -> None:
        """Until the page is not too far behind."""
        while self.behind:
            self._told.clear()
            await self._told.wait()
