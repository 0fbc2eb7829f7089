"""Which column of a table is the time, and its seconds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError
from roadstate.core.units import convert

_NAME = re.compile(
    r"(?:t|time|times|timestamp|timestamps|time_stamp|datetime|date_time|zeit|zeitstempel"
    r"|t_unix|unix|unix_time|time_unix|epoch|t_rel|rel_time|elapsed_time|time_elapsed)"
    r"(?:_(?P<unit>s|sec|secs|seconds|ms|us|ns|min|h|utc))?"
)
_UNIT_OF_SUFFIX = {"sec": "s", "secs": "s", "seconds": "s", "utc": "s"}
_IN_MAPPING = "name it in the mapping ('time: {column: NAME}')"
_UNIT_PLACES = "the header ('time [ms]') or the mapping ('time: {unit: ms}')"
_FEW = 3  # samples, whose steps say nothing
_LONGEST_STEP = 5.0  # s from one sample to the next, in a log of a drive
_ABSOLUTE = 1e8  # s; a log that runs for three years is none, so a larger time counts from 1970
_FAR = 9.2e9  # s from 1970, the year 2261, where times in ns end; a larger number is in another unit
_MANY = 100  # rows of whole numbers, from which on they may well be ms
_EARLIEST = 9e8  # s after 1970; no log is from before 1998, but a clock of ms may show less


def find_time(headers: Sequence[str], names: Sequence[str], wanted: str | None, where: str) -> int:
    """The position of the time column.

    Args:
        headers: columns as written (``Time [s]``).
        names: the same without units (``Time``).
        wanted: the column named by the user, as header or name; ``None`` searches for a usual name.
        where: the file, for messages.

    Raises:
        InputError: none or several qualify.
    """
    if wanted is not None:
        found = [i for i, (h, n) in enumerate(zip(headers, names, strict=True)) if wanted.strip() in (h, n)]
        mend = "name one of these in the mapping"
        problem = f"no column '{wanted}'"
    else:
        found = [i for i, n in enumerate(names) if _NAME.fullmatch(_plain(n))]
        mend = f"call it 'time [s]', or {_IN_MAPPING}"
        problem = "no time column"
    if len(found) == 1:
        return found[0]
    if found:
        several = " and ".join(f"'{headers[i]}'" for i in found)
        raise InputError(f"more than one time column: {several}", where=where, mend=_IN_MAPPING)
    raise InputError(f"{problem}; there are {_listed(headers)}", where=where, mend=mend)


def time_unit(name: str, unit: str | None) -> str | None:
    """The unit of a time column: as given, else its name's suffix (``t_ms``), if it has one."""
    if unit:
        return unit
    match = _NAME.fullmatch(_plain(name))
    suffix = match["unit"] if match else None
    return _UNIT_OF_SUFFIX.get(suffix, suffix) if suffix else None


def seconds(values: NDArray[Any], unit: str | None, where: str) -> tuple[NDArray[np.float64], str | None]:
    """Seconds since the start, and the start itself where the column holds absolute time.

    Calendar times (taken as UTC where they name no zone) and times since 1970 become times since the first
    sample; integers lose nothing by it. Other times stay as they are.

    Args:
        values: (T,) ``datetime64``, integers or floats; NaN or NaT where missing.
        unit: of the numbers; ``None`` where nothing says, which is taken for seconds.
        where: file and column, for messages.

    Returns:
        (T,) in s, and the first sample's ISO text in UTC or ``None``.

    Raises:
        InputError: the unit is none of time, nothing is there, dates or numbers lie beyond 1678 to 2261, or
            steps may be no seconds, which nothing says that they are.
    """
    is_guessed, unit = unit is None, unit or "s"
    if values.dtype.kind == "M":
        is_guessed, missing = False, np.isnat(values)
        _check_dates(values, missing, where)
        values, unit = values.astype("datetime64[ns]").astype(np.int64), "ns"
    else:
        missing = np.isnan(values) if values.dtype.kind == "f" else np.zeros(len(values), bool)
    if missing.all():
        raise InputError(
            "the time column is empty", where=where, mend="fill it, or name another one in the mapping"
        )
    if values.dtype.kind == "u":
        values = values.astype(np.int64)
    first = values[int(np.argmin(missing))]
    mend = f"give the time's unit in {_UNIT_PLACES}"
    try:
        start = float(convert(float(first), unit, "s"))
    except InputError as error:
        raise InputError(error.what, where=where, mend=mend) from error
    is_absolute = abs(start) > _ABSOLUTE
    if is_absolute and not abs(start) < _FAR:
        raise InputError(
            f"the time starts at {start:.6g} s", where=where, mend=f"{mend}, or count from 1970 or the start"
        )
    elapsed = values - first if is_absolute else values
    time = convert(np.asarray(elapsed, dtype=np.float64), unit, "s")
    if is_guessed:
        _check_pace(time[~missing], start, where)
    if missing.any():
        time = np.where(missing, np.nan, time)
    if not is_absolute:
        return time, None
    if np.issubdtype(values.dtype, np.integer):
        whole = int(first) * round(float(convert(1.0, unit, "ns")))
        return time, str(np.datetime64(whole, "ns"))
    return time, str(np.datetime64(round(start * 1e6), "us"))


def _check_dates(dates: NDArray[Any], missing: NDArray[np.bool_], where: str) -> None:
    """Refuse dates that are none in ns: a cast would wrap them around."""
    far = ~missing & (np.abs(dates.astype("datetime64[s]").astype(np.int64)) > _FAR)
    if far.any():
        row = int(np.argmax(far))
        raise InputError(
            f"the date {dates[row].astype('datetime64[s]')} lies outside 1678 to 2261 (row {row})",
            where=where,
            mend="leave it empty where the clock was not set, or give seconds from the start",
        )


def _check_pace(time: NDArray[np.float64], start: float, where: str) -> None:
    """Refuse what may well be ms where nothing says that it is seconds: most loggers count ms.

    That are steps of several seconds, and many whole numbers, unless they are seconds since 1970.
    """
    step = float(np.median(np.diff(time))) if len(time) > _FEW else 0.0
    is_counted = len(time) > _MANY and step >= 1.0 and start < _EARLIEST
    if step >= _LONGEST_STEP or (is_counted and bool((time == np.rint(time)).all())):
        raise InputError(
            f"steps of {step:.4g} s, if its numbers are seconds",
            where=where,
            mend=f"is the unit ms? Give it in {_UNIT_PLACES}, also if it is s",
        )


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def _listed(headers: Sequence[str]) -> str:
    shown = ", ".join(f"'{h[:40]}'" for h in headers[:20])
    return shown + (f" and {len(headers) - 20} more" if len(headers) > 20 else "")
