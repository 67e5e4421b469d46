"""How far behind a page is. Without it a slow way would fill with frames, and the page would see ever older ones."""

import asyncio
import time
from collections import deque

MOST_BEHIND = 1.0  # s, from a frame that was sent until the page says that it has come
REMEMBERED = 4096  # frames that were sent and of which nothing was said


class FrameFlow:
    """Of one page. Used on the event loop's thread only. A page that never says what has come gets all frames."""

    def __init__(self) -> None:
        self.sent = 0
        self._under_way: deque[tuple[int, float]] = deque(maxlen=REMEMBERED)  # number, and when it was sent
        self._tells = False
        self._told = asyncio.Event()

    def send(self) -> None:
        """A frame is sent."""
        self.sent += 1
        self._under_way.append((self.sent, time.monotonic()))

    def taken(self, count: int) -> None:
        """The page has taken so many frames."""
        self._tells = True
        while self._under_way and self._under_way[0][0] <= count:
            self._under_way.popleft()
        self._told.set()

    @property
    def behind(self) -> bool:
        """Whether the oldest frame that is under way was sent too long ago for another one to follow."""
        return self._tells and bool(self._under_way) and time.monotonic() - self._under_way[0][1] > MOST_BEHIND

    async def ready(self) -> None:
        """Until the page is not too far behind."""
        while self.behind:
            self._told.clear()
            await self._told.wait()
