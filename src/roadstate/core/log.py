"""A log: canonical channels in SI units on one time base."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from roadstate.core import tabular
from roadstate.core.channels import CHANNELS, channel
from roadstate.core.errors import InputError
from roadstate.core.held import sampled

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Log:
    """Canonical channels on one time base; NaN means missing.

    Whatever numpy makes numbers of, lists too, becomes arrays of float64.

    Attributes:
        time: (T,) in s, strictly increasing; the step may vary.
        channels: name → (T,) values in the channel's SI unit.
        metadata: vehicle, source files, frame; must be JSON-able.

    Raises:
        InputError: a name that is not canonical, values that are no numbers, a shape that differs, or time
            that does not increase.
    """

    time: Array
    channels: Mapping[str, Array]
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.channels, Mapping):
            kind = type(self.channels).__name__
            raise InputError(f"channels that are a {kind}", mend="give {name: values}")
        object.__setattr__(self, "time", _numbers("time", self.time))
        object.__setattr__(self, "channels", {n: _numbers(n, v) for n, v in self.channels.items()})
        if self.time.ndim != 1 or len(self.time) == 0:
            raise InputError("a log needs at least one sample")
        bad = ~np.isfinite(self.time)
        if not bad.any():
            bad[1:] = ~(np.diff(self.time) > 0)
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                f"time does not increase at row {row}", mend="sort the log and drop repeated rows"
            )
        for name, values in self.channels.items():
            if name == "time":
                raise InputError("time cannot be a channel beside itself")
            channel(name)
            if values.shape != self.time.shape:
                raise InputError(f"{name} has shape {values.shape}, time has {self.time.shape}")

    def __getitem__(self, name: str) -> Array:
        return self.time if name == "time" else self.channels[name]

    def __contains__(self, name: object) -> bool:
        return name in self.channels

    def __len__(self) -> int:
        return len(self.time)

    @property
    def references(self) -> dict[str, Array]:
        """The channels that carry truth (``ref_*``)."""
        return {n: v for n, v in self.channels.items() if CHANNELS[n].is_reference}

    @property
    def available(self) -> frozenset[str]:
        """Channels with at least one sample."""
        return frozenset(n for n, v in self.channels.items() if np.isfinite(v).any())

    @property
    def duration(self) -> float:
        """Seconds from first to last sample."""
        return float(self.time[-1] - self.time[0])

    def select(self, names: Iterable[str]) -> Log:
        """The same log with only the channels of ``names`` that it has."""
        wanted = set(names)
        return Log(self.time, {n: v for n, v in self.channels.items() if n in wanted}, self.metadata)

    def between(self, start: float, stop: float) -> Log:
        """The samples with ``start <= time < stop`` (seconds).

        Raises:
            InputError: none lies there.
        """
        keep = (self.time >= start) & (self.time < stop)
        return Log(self.time[keep], {n: v[keep] for n, v in self.channels.items()}, self.metadata)

    def with_channels(self, channels: Mapping[str, Array]) -> Log:
        """The same log with channels added or replaced."""
        return Log(self.time, {**self.channels, **channels}, self.metadata)

    def without_repeats(self) -> Log:
        """The same log with each sample once where a channel holds it for several rows, and NaN after that.

        A table with one row per 10 ms repeats the sample of a 10 Hz receiver ten times. Reading a file leaves
        the repeats out (``held`` in the metadata); a log made in memory keeps them until this is called.
        References stay as they are.
        """
        measured = {n: v for n, v in self.channels.items() if not CHANNELS[n].is_reference}
        return self.with_channels({n: sampled(v)[0] for n, v in measured.items()})

    def to_pandas(self) -> pd.DataFrame:
        """A data frame indexed by ``time [s]`` with columns ``name [unit]``; metadata in ``attrs``."""
        return tabular.to_pandas(self._columns(), self.metadata)

    @classmethod
    def from_pandas(cls, frame: pd.DataFrame) -> Log:
        """Read what :meth:`to_pandas` wrote, or any frame whose columns are canonical ``name [unit]``.

        Raises:
            InputError: no time, an unknown name, or a unit that does not fit.
        """
        columns, metadata = tabular.from_pandas(frame)
        return cls._from_columns(columns, metadata, "data frame")

    def to_parquet(self, path: str | Path) -> Path:
        """Write a Parquet file with the unit of each column in its field metadata."""
        return tabular.to_parquet(path, self._columns(), self.metadata)

    @classmethod
    def from_parquet(cls, path: str | Path) -> Log:
        """Read what :meth:`to_parquet` wrote.

        Raises:
            InputError: not a Parquet file, no time, an unknown name, or a unit that does not fit.
        """
        columns, metadata = tabular.from_parquet(path)
        return cls._from_columns(columns, metadata, str(path))

    def _columns(self) -> dict[str, tabular.Column]:
        columns = {"time": tabular.Column(self.time, "s")}
        columns |= {n: tabular.Column(v, CHANNELS[n].unit) for n, v in self.channels.items()}
        return columns

    @classmethod
    def _from_columns(
        cls, columns: Mapping[str, tabular.Column], metadata: Mapping[str, Any], where: str
    ) -> Log:
        if "time" not in columns:
            raise InputError("no 'time [s]' column", where=where, mend="add one, in seconds")
        try:
            values = {n: tabular.in_unit(n, c, channel(n).unit, where) for n, c in columns.items()}
            return cls(values.pop("time"), values, metadata)
        except InputError as error:
            if error.where:
                raise
            raise InputError(error.what, where=where, mend=error.mend) from error


def _numbers(name: str, values: ArrayLike) -> Array:
    """The values as an array of float64; the same object where they are one."""
    try:
        found = np.asarray(values)
        if found.dtype.kind in "biufO":
            return found.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError):
        pass
    raise InputError(f"{name} holds what is no number", mend="give numbers, NaN where one is missing")
