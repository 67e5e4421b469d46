"""A link between two sites: a TCP proxy that delays what passes, with jitter and with what loss does to a stream.

Bytes pass in pieces of a packet. A lost one is held until it would have been sent again, and all behind it with it.
"""

import asyncio
import contextlib
import threading

import numpy as np

PACKET = 1400  # bytes
LEAST_HOLD = 0.2  # s, TCP's shortest time-out here
ROUND_TRIPS = 1.5  # held for so many, if that is longer


class DelayedLink:
    """delay: s each way; jitter: its relative half width, evenly; loss: of each packet. port: where it listens."""

    def __init__(self, target, delay, jitter=0.2, loss=0.05, seed=0):
        self.target, self.delay, self.jitter, self.loss = target, delay, jitter, loss
        self.rng = np.random.default_rng(seed)
        self.port = 0
        self.cut = False  # nothing passes any more, without a word

    def _release(self, now, before):
        """When a packet that comes now is there, and not before the one in front of it."""
        held = max(LEAST_HOLD, ROUND_TRIPS * 2 * self.delay) if self.rng.random() < self.loss else 0.0
        late = self.delay * (1 + self.rng.uniform(-self.jitter, self.jitter))
        return max(before, now + late + held)

    async def _one_way(self, reader, writer):
        clock, waiting, before = asyncio.get_running_loop().time, asyncio.Queue(), 0.0

        async def deliver():
            while (one := await waiting.get()) is not None:
                at, data = one
                if at > clock():
                    await asyncio.sleep(at - clock())
                if not self.cut:
                    with contextlib.suppress(OSError):  # who listens there has gone
                        writer.write(data)
                        await writer.drain()

        delivery = asyncio.create_task(deliver())
        with contextlib.suppress(OSError):
            while data := await reader.read(PACKET):
                before = self._release(clock(), before)
                waiting.put_nowait((before, data))
        waiting.put_nowait(None)
        with contextlib.suppress(OSError):
            await delivery
        writer.close()

    async def _connection(self, reader, writer):
        try:
            far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self.target)
        except OSError:
            return writer.close()
        await asyncio.gather(self._one_way(reader, far_writer), self._one_way(far_reader, writer))

    async def _serve(self, ready, ended):
        server = await asyncio.start_server(self._connection, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        ready.set()
        await ended.wait()
        server.close()
        left = asyncio.all_tasks() - {asyncio.current_task()}
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)


@contextlib.contextmanager
def delayed_link(target, delay, **how):
    """A link to a port of this machine, in a thread, during the block."""
    link, ready, loop, ended = DelayedLink(target, delay, **how), threading.Event(), asyncio.new_event_loop(), []

    def run():
        asyncio.set_event_loop(loop)
        ended.append(asyncio.Event())
        loop.run_until_complete(link._serve(ready, ended[0]))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    ready.wait()
    try:
        yield link
    finally:
        loop.call_soon_threadsafe(ended[0].set)
        thread.join(10)
        loop.close()
