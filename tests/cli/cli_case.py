"""What the tests of the command line share: outcomes, and small logs."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from roadstate.core import Log


@dataclass(frozen=True)
class Outcome:
    """How a command ended and what it printed."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """The one object on standard output."""
        return json.loads(self.out)


Run = Callable[..., Outcome]
NOISE = 0.4
"""m/s: of the speed signal of the fixture ``noisy``."""


def assert_refusal(end: Outcome) -> None:
    """Exit 2, nothing on standard output, one line without a traceback on standard error."""
    assert end.status == 2
    assert end.out == ""
    assert end.err.endswith("\n")
    assert end.err.count("\n") == 1
    assert "Traceback" not in end.err


def csv(path: Path, header: str, rows: Sequence[Sequence[float | str]]) -> Path:
    """Write a small CSV file."""
    lines = [header, *(",".join(str(cell) for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def steady(count: int = 50, **channels: Sequence[float]) -> Log:
    """A log of constant speed on level road, with channels added or replaced."""
    time = 0.01 * np.arange(count)
    values = {"speed": np.full(count, 10.0), "accel_x": np.zeros(count)}
    return Log(time, values | {n: np.asarray(v, float) for n, v in channels.items()})
