"""Parquet: any file of numeric columns and one time column; units from the field's ``unit`` or its name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError, Log, Recording, Signal, tabular
from roadstate.io.formats import Format, ReadOptions
from roadstate.io.time_column import find_time, seconds, time_unit

_OF_A_READING = ("skipped", "undecoded", "dropped")


def sniff(head: bytes) -> bool:
    """Whether the file starts as Parquet files do."""
    return head.startswith(b"PAR1")


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a Parquet file; every signal has the file's one time base.

    Raises:
        InputError: not a whole Parquet file, no rows, no or several time columns, or no numbers.
    """
    where = str(path)
    columns, metadata = tabular.from_parquet(path)
    names = list(columns)
    index = find_time(names, names, options.time_column, where)
    time_column = columns.pop(names[index])
    if not len(time_column.values):
        raise InputError("has no rows", where=where, mend="is the file complete?")
    base = time_column.values if time_column.values.dtype.kind == "M" else _numbers(time_column.values)
    if base is None:
        raise InputError("not numeric", where=f"{where}: {names[index]}", mend="name another time column")
    unit = time_unit(names[index], time_column.unit or options.time_unit)
    time, start = seconds(base, unit, f"{where}: {names[index]}")
    signals: dict[str, Signal] = {}
    skipped: list[str] = []
    for name, column in columns.items():
        values = _numbers(column.values)
        if values is None:
            skipped.append(name)
        else:
            values = values.astype(np.float64, copy=False)
            signals[name] = Signal(time, values, column.unit, source=f"{path.name}:{name}")
    if not signals:
        raise InputError(f"no column of numbers beside '{names[index]}'", where=where)
    # not what was left out of another file, which this one was made from
    known: dict[str, Any] = {k: v for k, v in metadata.items() if k not in _OF_A_READING}
    if start:
        known["start_time"] = start
    if skipped:
        known["skipped"] = skipped
    return Recording(signals, known)


def write(log: Log, path: Path) -> None:
    """Write every channel as float64 with its unit, and the log's metadata."""
    log.to_parquet(path)


def _numbers(values: NDArray[Any]) -> NDArray[Any] | None:
    if values.dtype.kind in "iuf":
        return values
    if values.dtype.kind in "Mm" or not len(values):
        return None
    if values.dtype.kind == "O" and isinstance(next((v for v in values if v is not None), ""), str | bytes):
        return None
    try:
        return values.astype(np.float64)
    except (TypeError, ValueError):
        return None


FORMAT = Format(
    "Parquet", "columns with their units in the fields' metadata", (".parquet",), sniff, read, write
)
