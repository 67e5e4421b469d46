"""One line of progress for long work."""

import contextlib
from collections.abc import Callable, Iterator


@contextlib.contextmanager
def progress() -> Iterator[Callable[[str, float], None]]:
    """Gives say(what, share done): a bar with time spent and left; what is done stays as a line above it.

    A share of 0 that stays 0 shows that something goes on, not how far it is.
    """
    import sys

    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    # On stderr: what a command has to say goes to stdout, for others to read.
    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda what, share: print(f"  done: {what}", file=sys.stderr) if share >= 1 else None
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
