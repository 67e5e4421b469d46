"""Progress of long work, on stderr: a bar in a terminal, plain lines elsewhere."""

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator

LINE_DELAY = 1.0  # s, before a line says that a thing has begun: what is refused at once is one line, the refusal
LINE_INTERVAL = 10.0  # s, between two lines about the same thing where there is no terminal


@contextlib.contextmanager
def progress() -> Iterator[Callable[[str, float], None]]:
    """Gives say(what, share done): a bar with time spent and left; what is done stays as a line above it.

    A share of 0 that stays 0 shows that something goes on, not how far it is.
    """
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    # On stderr: what a command has to say goes to stdout, for others to read.
    console = Console(stderr=True)
    if not console.is_terminal:
        with plain_lines() as say:
            yield say
        return
    columns = (TextColumn("{task.description:<44}"), BarColumn(28), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task, reached = bar.add_task("", total=None), 1.0

        def say(what: str, share: float) -> None:
            nonlocal task, reached
            if share < reached or reached == 0 < share:  # another thing, or the first that is known of this one
                bar.remove_task(task)
                task = bar.add_task("", total=1.0 if share > 0 else None)
            reached = share
            bar.update(task, description=escape(what), completed=share)
            if share >= 1:
                bar.console.print(f"  [green]✓[/green] {escape(what)}", highlight=False)

        yield say


@contextlib.contextmanager
def plain_lines() -> Iterator[Callable[[str, float], None]]:
    """say(what, share done) that prints a line when a thing begins and ends, and every `LINE_INTERVAL` meanwhile."""
    reached, last, waiting = 1.0, 0.0, threading.Timer(0, lambda: None)

    def line(text: str) -> None:
        print(f"  {text}", file=sys.stderr, flush=True)

    def say(what: str, share: float) -> None:
        nonlocal reached, last, waiting
        begins, now = share < reached, time.monotonic()
        if share >= 1:
            waiting.cancel()
            line(f"done: {what}")
        elif begins or now - last >= LINE_INTERVAL:
            waiting.cancel()
            waiting = threading.Timer(
                LINE_DELAY if begins else 0, line, [f"{what}, {share:.0%}" if share > 0 else what]
            )
            waiting.daemon = True
            waiting.start()
            last = now
        reached = share

    try:
        yield say
    finally:
        waiting.cancel()


@contextlib.contextmanager
def doing(what: str) -> Iterator[None]:
    """Shows that something goes on during the block, where nothing tells how far it is."""
    with progress() as say:
        say(what, 0.0)
        yield
        say(what, 1.0)
