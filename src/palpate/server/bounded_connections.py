"""HTTP connections that are bounded: in number, and in the time that a request may take to arrive."""

import asyncio

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_CONNECTIONS = 64  # eight pages, each with a WebSocket and the six connections that a browser opens at once
REQUEST_TIMEOUT = 10.0  # s, from the first byte of a request, or from the connection, to its last
ARRIVING = (h11.IDLE, h11.SEND_BODY)
REFUSAL = b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"


class BoundedConnection(H11Protocol):
    """A connection that is refused beyond the limit, and ends if a request takes too long to arrive."""

    deadline: asyncio.TimerHandle | None = None

    @staticmethod
    def most() -> int:
        """How many there may be."""
        return MOST_CONNECTIONS

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Refuses the connection, or starts its clock. WebSockets count too: uvicorn keeps both in `connections`."""
        super().connection_made(transport)
        if len(self.connections) > self.most():
            transport.write(REFUSAL)
            transport.close()
        else:
            self._watch()

    def data_received(self, data: bytes) -> None:
        """Takes a part of a request."""
        super().data_received(data)
        self._watch()

    def connection_lost(self, problem: Exception | None) -> None:
        """Stops the clock."""
        super().connection_lost(problem)
        self._stop()

    def _watch(self) -> None:
        """Lets the clock run while a request arrives. uvicorn has one of its own for the pause after an answer."""
        if self.conn.their_state not in ARRIVING:
            self._stop()
        elif self.deadline is None:
            self.deadline = self.loop.call_later(REQUEST_TIMEOUT, self._expire)

    def _stop(self) -> None:
        if self.deadline is not None:
            self.deadline.cancel()
            self.deadline = None

    def _expire(self) -> None:
        if self.transport.get_protocol() is self:  # no WebSocket by now
            self.transport.abort()
