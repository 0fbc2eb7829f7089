"""What can be timed: one implementation, made ready to run over one problem's log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from benchmarks.peers.problems import Array


@dataclass(frozen=True)
class Program:
    """A call that runs a filter over a log, or over many.

    Attributes:
        call: does all the work and returns when it is done.
        means: what the call has returned → (T, n) means of the first log.
        steps: samples of each log.
        logs: that one call runs over.
        latencies: what the call has returned → (T,) s each single step took; ``None`` where steps are not
            called one by one.
        note: what a reader of its figures has to know.
    """

    call: Callable[[], Any]
    means: Callable[[Any], Array]
    steps: int
    logs: int = 1
    latencies: Callable[[Any], Array] | None = None
    note: str = ""
