"""Logs from and to files, whatever their format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from roadstate.core import InputError, Log, Recording, join
from roadstate.io.formats import ReadOptions, format_of, writer_of
from roadstate.io.paths import check_file


def read(
    path: str | Path,
    *,
    dbc: Sequence[str | Path] = (),
    time_column: str | None = None,
    time_unit: str | None = None,
) -> Recording:
    """Read a log file of any known format, as it is: the file's names, units and time bases.

    Args:
        path: the file; its content tells the format.
        dbc: DBC files, for logs of raw CAN frames; others do without.
        time_column: name of the column that holds the time, for a table in which the name does not tell.
        time_unit: its unit, where its header gives none; default s.

    Returns:
        Signals in the file's units, time in s. ``metadata`` holds ``files``, ``format``, ``start_time`` (UTC,
        ISO text, only where the file has an absolute time), ``skipped``, the columns or messages that hold no
        numbers or could not be read (``name`` or ``name: reason``), and ``undecoded``, the ids of CAN frames
        that no DBC explains.

    Raises:
        InputError: the file is missing, empty, cut short, of no known format or not readable in it.
    """
    path = Path(path)
    check_file(path)
    databases = [dbc] if isinstance(dbc, str | Path) else dbc
    chosen = format_of(path)
    try:
        recording = chosen.read(path, ReadOptions(tuple(Path(d) for d in databases), time_column, time_unit))
    except InputError as error:
        if chosen.has_suffix(path):
            raise
        raise InputError(
            f"{error.what} (its content looks like {chosen.name})", where=error.where, mend=error.mend
        ) from error
    metadata = {**recording.metadata, "files": [str(path)], "format": chosen.name}
    return replace(recording, metadata=metadata)


def read_all(
    paths: Sequence[str | Path],
    *,
    dbc: Sequence[str | Path] = (),
    time_column: str | None = None,
    time_unit: str | None = None,
) -> Recording:
    """Read the files of one drive and join them in time order; their formats may differ.

    Args:
        paths: the files, in any order.
        dbc: as for :func:`read`.
        time_column: as for :func:`read`.
        time_unit: as for :func:`read`.

    Raises:
        InputError: no file is given, one cannot be read, or they overlap in time or differ in units.
    """
    if not paths:
        raise InputError("no log file given", mend="name at least one")
    return join([read(p, dbc=dbc, time_column=time_column, time_unit=time_unit) for p in paths])


def write(log: Log, path: str | Path) -> Path:
    """Write a log in the format its suffix names; the file appears whole or not at all.

    Args:
        log: canonical channels in SI units.
        path: ends in ``.csv``, ``.csv.gz``, ``.parquet`` or ``.mf4``.

    Returns:
        The path written.

    Raises:
        InputError: another suffix, or a folder that cannot be written.
    """
    path = Path(path)
    writer_of(path)(log, path)
    return path
