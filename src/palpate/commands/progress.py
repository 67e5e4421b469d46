"""One line of progress for long work."""

import contextlib
from collections.abc import Callable, Iterator


@contextlib.contextmanager
def progress() -> Iterator[Callable[[str, float], None]]:
    """Gives say(what, share done): a bar with time spent; what is done stays as a line above it."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<44}"), BarColumn(bar_width=28), TimeElapsedColumn())
    with Progress(*columns) as bar:
        task = bar.add_task("", total=1.0)

        def say(what: str, share: float) -> None:
            bar.update(task, description=what, completed=share)
            if share >= 1:
                bar.console.print(f"  [green]✓[/green] {what}", highlight=False)
                bar.update(task, completed=0.0)

        yield say
        bar.update(task, visible=False)
