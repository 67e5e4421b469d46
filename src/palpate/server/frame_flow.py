"""How many frames are under way to a page. Without a limit a narrow way would fill, and the page would see ever older ones."""

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
LOOK = 10.0  # s after which the way is let run empty, to see how long it is by now


class FrameFlow:
    """Of one page. Used on the event loop's thread only. A page that never says what has come gets all frames.

    As many frames are under way as come while one goes and is told of: their rate times the time of an empty way, as in
    BBR (Cardwell et al., ACM Queue 14, 2016). The rate falls only while this limit holds frames back, since a paused
    replay sends few over any way. Frames that wait hide that a way has become longer; so it runs empty now and then.
    """

    def __init__(self) -> None:
        self.sent = 0
        self._under_way: deque[tuple[int, float]] = deque(maxlen=REMEMBERED)  # number, and when it was sent
        self._words: deque[tuple[float, int]] = deque()  # when the page said how many have come
        self._tells = False
        self._told = asyncio.Event()
        self._rate = 0.0  # frames a second that come
        self._shortest = math.inf  # s, from a frame to the page's word of it
        self._looked = time.monotonic()  # when it was about that
        self._held_back = self._emptying = False

    def send(self) -> None:
        """A frame is sent."""
        self.sent += 1
        self._under_way.append((self.sent, time.monotonic()))

    def taken(self, count: int) -> None:
        """The page has taken so many frames."""
        self._tells = True
        count = min(count, self.sent)
        now, took = time.monotonic(), None
        while self._under_way and self._under_way[0][0] <= count:
            took = now - self._under_way.popleft()[1]
        self._count(now, count)
        if took is not None:
            self._measure(now, took)
        if self._emptying and not self._under_way:
            self._emptying, self._shortest, self._looked = False, math.inf, now  # the next word tells
        self._held_back = False
        self._told.set()

    def _count(self, now: float, count: int) -> None:
        """The rate of the frames that come."""
        words = self._words
        if not words:
            words.append((now - TELLING, 0))
        while len(words) > 1 and words[1][0] <= now - COUNTED:
            words.popleft()
        then, before = words[0]
        rate = (count - before) / max(now - then, 1e-3)
        if self._held_back:
            self._rate *= math.exp((words[-1][0] - now) / FORGOTTEN)
        self._rate = max(rate, self._rate)
        words.append((now, count))

    def _measure(self, now: float, took: float) -> None:
        """The newest frame that has come took so long."""
        if took < UNEVEN * self._shortest + WAITING / 4:
            self._shortest, self._looked = min(took, self._shortest), now
        elif now - self._looked > LOOK:
            self._emptying = True

    @property
    def behind(self) -> bool:
        """Whether too many frames are under way for another one to follow."""
        if not self._tells or not self._under_way:
            return False
        shortest = 0.0 if math.isinf(self._shortest) else self._shortest
        if self._emptying or len(self._under_way) >= LEAST + self._rate * (shortest + WAITING):
            self._held_back = True
        return self._held_back

    async def ready(self) -> None:
        """Until the page is not too far behind."""
        while self.behind:
            self._told.clear()
            await self._told.wait()
