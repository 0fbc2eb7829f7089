"""A bar on standard error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from benchmarks.accuracy.run import Progress
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar


@contextmanager
def shown() -> Iterator[Progress]:
    """What to call with each piece of work while the bar is there."""
    columns = (BarColumn(20), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("")

        def tell(what: str, done: int, total: int) -> None:
            bar.update(task, description=what, completed=done, total=total)

        yield tell
