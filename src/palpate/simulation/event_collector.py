"""A thread that collects the events of a session which runs by the clock."""

from collections.abc import Callable
from threading import Event, Thread
from weakref import WeakMethod

COLLECT_INTERVAL = 0.5  # s; the queues of the loop hold the events of 16 s at least


class EventCollector:
    """Calls a method of a session now and then, until it is stopped. It does not keep the session alive."""

    def __init__(self, collect: Callable[[], None]) -> None:
        self._stopped = Event()
        self._thread = Thread(target=_collect_until, args=(self._stopped, WeakMethod(collect)), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ends the thread."""
        self._stopped.set()
        self._thread.join()


def _collect_until(stopped: Event, method: WeakMethod[Callable[[], None]]) -> None:
    while not stopped.wait(COLLECT_INTERVAL) and (collect := method()):
        collect()
        del collect  # it would keep the session alive
