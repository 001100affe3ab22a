"""The progress bar."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(quiet: bool) -> Iterator[Callable[[str, float], None] | None]:
    """A callback (text, done share) that drives a progress bar on stderr."""
    if quiet:
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:<44}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"), TimeElapsedColumn())
    bar = Progress(*columns, console=Console(stderr=True))
    task = bar.add_task("start", total=1.0)

    def show(text: str, share: float) -> None:
        bar.start()  # not before the first step, so that a bad study file is told in one line
        bar.update(task, description=text, completed=share)

    try:
        yield show
    finally:
        if bar.live.is_started:  # stopping what never began would print an empty line
            bar.stop()
