"""A progress bar on standard error, for work of more than a second, on a terminal."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

_PATIENCE = 1.0  # s


class Work:
    """One piece of work that may be shown."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._bar: Progress | None = None
        self._task: TaskID | None = None
        self._what = ""
        self._total: float | None = None
        self._done = 0.0
        self._over = False

    def begin(self, what: str) -> None:
        """What is done from now on."""
        with self._lock:
            self._what, self._total, self._done = what, None, 0.0
            self._show()

    def advance(self, done: int, total: int) -> None:
        """How much of it is done."""
        with self._lock:
            self._done, self._total = float(done), float(total)
            self._show()

    def _show(self) -> None:
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, description=self._what, completed=self._done, total=self._total)

    def _appear(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns: tuple[Any, ...] = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TimeElapsedColumn(),
        )
        with self._lock:
            if self._over:
                return
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._task = self._bar.add_task(self._what, total=self._total)
            self._bar.start()

    def _vanish(self) -> None:
        with self._lock:
            self._over = True
            if self._bar is not None:
                self._bar.stop()


@contextmanager
def working() -> Iterator[Work]:
    """Work that shows itself if it takes long, and leaves no trace when it ends."""
    work = Work()
    if not sys.stderr.isatty():
        yield work
        return
    timer = threading.Timer(_PATIENCE, work._appear)
    timer.daemon = True
    timer.start()
    try:
        yield work
    finally:
        timer.cancel()
        work._vanish()
