"""CSV: ``name [unit]`` headers, one time column, numbers.

Comma, semicolon or tab between cells, decimal point or (not between commas) decimal comma, gzip, UTF-8 with
or without byte order mark or Latin-1, comment lines above the header, a line of units below it. Empty cells,
``NaN`` and ``NA`` are missing values. Rows keep the order of the file. A column without numbers is left out
and listed in ``metadata["skipped"]``; one of mostly numbers with text between them is refused.
"""

from __future__ import annotations

import csv
import gzip
import zlib
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core import CHANNELS, InputError, Log, Recording, Signal
from roadstate.core.tabular import atomic_path, from_arrow
from roadstate.io.csv_layout import MISSING, NUMBER, Layout, decode_text, lines, read_layout
from roadstate.io.formats import Format, ReadOptions
from roadstate.io.time_column import seconds

_GZIP = b"\x1f\x8b"
_MAX_TEXT = 4 << 30  # bytes; four days of 20 channels at 100 Hz, or a gzip bomb


def sniff(head: bytes) -> bool:
    """Whether the bytes are text, or gzip of text."""
    if head.startswith(_GZIP):
        try:
            head = zlib.decompressobj(wbits=31).decompress(head, 4096)
        except zlib.error:
            return False
    return b"\0" not in head


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a CSV file; every signal has the file's one time base.

    Raises:
        InputError: no text, cut short, no header, no or several time columns, a name given twice, rows of
            unequal length, or text among numbers.
    """
    where = str(path)
    data = _load(path)
    zero = data.find(b"\0")
    if zero >= 0:
        number = data.count(b"\n", 0, zero) + 1
        raise InputError(
            f"holds zero bytes (line {number})",
            where=where,
            mend="save it as UTF-8 text; after a loss of power cut the file there",
        )
    layout = read_layout(data, where, options.time_column, options.time_unit)
    table = _parse(data, layout, where)
    columns = _Columns(data, layout, where)
    header = layout.headers[layout.time]
    base = columns.numbers(layout.time, table.column(layout.time), is_time=True)
    if base is None:
        example = str(table.column(layout.time).drop_null()[0].as_py())[:40]
        raise InputError(
            f"the time column holds text ('{example}')",
            where=f"{where}: {header}",
            mend="write seconds, or dates as 2024-05-31T12:00:00.125",
        )
    time, start = seconds(base, layout.time_unit, f"{where}: {header}")
    signals: dict[str, Signal] = {}
    skipped: list[str] = []
    for i, name in enumerate(layout.names):
        if i == layout.time:
            continue
        values = columns.numbers(i, table.column(i)) if name else None
        if values is None:
            skipped.append(name or f"column {i + 1}: no name")
            continue
        signals[name] = Signal(
            time, values.astype(np.float64, copy=False), layout.units[i], source=f"{path.name}:{name}"
        )
    if not signals:
        raise InputError(
            f"no column of numbers beside '{header}'", where=where, mend="is the separator right?"
        )
    metadata: dict[str, Any] = {"start_time": start} if start else {}
    if skipped:
        metadata["skipped"] = skipped
    return Recording(signals, metadata)


def write(log: Log, path: Path) -> None:
    """Write ``time [s]`` and every channel with the digits to read the same values back; gzip for ``.gz``."""
    import pyarrow as pa
    import pyarrow.csv as pacsv

    units = {"time": "s"} | {n: CHANNELS[n].unit for n in log.channels}
    arrays = [pa.array(log[n], from_pandas=True) for n in units]
    header = ",".join(f"{n} [{u}]" for n, u in units.items()) + "\n"
    table = pa.Table.from_arrays(arrays, names=list(units))
    with atomic_path(path) as temporary, ExitStack() as closing:
        stream: Any = closing.enter_context(temporary.open("wb"))
        if path.name.lower().endswith(".gz"):
            # level 4 is three times as fast as level 6 and a tenth larger; undated: same log, same bytes
            stream = closing.enter_context(gzip.GzipFile("", "wb", 4, stream, mtime=0))
        stream.write(header.encode())
        pacsv.write_csv(table, stream, pacsv.WriteOptions(include_header=False))


def _load(path: Path) -> bytes:
    too_long = InputError(
        f"over {_MAX_TEXT >> 30} GiB of text", where=str(path), mend="split it, or use Parquet or MF4"
    )
    try:
        with path.open("rb") as stream:
            if stream.read(2) != _GZIP:
                if path.stat().st_size > _MAX_TEXT:
                    raise too_long
                return path.read_bytes()
        with gzip.open(path, "rb") as stream:
            data = stream.read(_MAX_TEXT + 1)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise InputError(
            "the gzip file is cut short or damaged", where=str(path), mend="copy it again from its source"
        ) from error
    if len(data) > _MAX_TEXT:
        raise too_long
    return data


def _parse(data: bytes, layout: Layout, where: str) -> Any:
    import pyarrow as pa
    import pyarrow.csv as pacsv

    names = [str(i) for i in range(len(layout.headers))]
    try:
        return pacsv.read_csv(
            pa.BufferReader(pa.py_buffer(memoryview(data)[layout.body :])),
            pacsv.ReadOptions(column_names=names),
            pacsv.ParseOptions(delimiter=layout.delimiter),
            pacsv.ConvertOptions(
                null_values=sorted(MISSING),
                strings_can_be_null=True,
                decimal_point=layout.decimal,
            ),
        )
    except pa.ArrowException as error:
        problem = _uneven_row(data, layout) or f"not readable as CSV: {str(error).splitlines()[0][:200]}"
    raise InputError(problem, where=where, mend="repair the line, or cut the file there")


def _uneven_row(data: bytes, layout: Layout) -> str | None:
    expected = len(layout.headers)
    for number, (begin, end, _) in enumerate(lines(data, layout.body), layout.first_line):
        try:
            cells = next(csv.reader([decode_text(data[begin:end])], delimiter=layout.delimiter), [])
        except csv.Error as error:
            return f"line {number} cannot be split into cells ({error})"
        if begin < end and len(cells) != expected:
            return f"line {number} has {len(cells)} cells, the header has {expected}"
    return None


class _Columns:
    """Turns parsed columns into numbers, and finds the line to blame where one cannot be."""

    def __init__(self, data: bytes, layout: Layout, where: str) -> None:
        self._data, self._layout, self._where = data, layout, where

    def numbers(self, index: int, column: Any, is_time: bool = False) -> NDArray[Any] | None:
        """(T,) numbers of a column (times as ``datetime64``), or ``None`` where it holds none."""
        import pyarrow as pa

        kind = column.type
        if pa.types.is_null(kind):
            return np.full(len(column), np.nan)
        if pa.types.is_integer(kind) or pa.types.is_floating(kind):
            return from_arrow(column)
        if pa.types.is_boolean(kind):
            return from_arrow(column.cast(pa.int8()))
        if pa.types.is_timestamp(kind):
            return from_arrow(column) if is_time else None
        if pa.types.is_string(kind) or pa.types.is_binary(kind):
            return self._from_text(index, column)
        return None

    def _from_text(self, index: int, column: Any) -> NDArray[np.float64] | None:
        import pyarrow as pa
        import pyarrow.compute as pc

        if pa.types.is_binary(column.type):
            column = pa.chunked_array([[c if c is None else decode_text(c) for c in column.to_pylist()]])
        text = pc.utf8_trim_whitespace(column)
        missing = pc.or_(pc.is_null(text), pc.is_in(text, pa.array(sorted(MISSING)))).to_numpy()
        if self._layout.decimal == ",":
            # a decimal point beside decimal commas could as well group thousands: such a cell stays text
            text = pc.replace_substring(pc.replace_substring(text, ".", "?"), ",", ".")
        is_number = pc.match_substring_regex(text, f"^(?:{NUMBER})$").fill_null(False).to_numpy()
        is_text = ~(is_number | missing)
        if is_text.sum() > is_number.sum():
            return None
        if is_text.any():
            row = int(np.argmax(is_text))
            raise InputError(
                f"'{str(column[row].as_py())[:40]}' is no number (line {self._line(row)})",
                where=f"{self._where}: {self._layout.headers[index]}",
                mend="leave the cell empty where the value is missing",
            )
        plain = pc.replace_substring_regex(text, r"^\+", "")
        cells = pc.if_else(pa.array(is_number), plain, pa.scalar(None, plain.type))
        return np.asarray(pc.cast(cells, pa.float64()).to_numpy(), dtype=np.float64)

    def _line(self, row: int) -> int:
        """The number in the file of a data row (the parser leaves empty lines out)."""
        for number, (begin, end, _) in enumerate(
            lines(self._data, self._layout.body), self._layout.first_line
        ):
            if begin < end:
                row -= 1
            if row < 0:
                return number
        return number


FORMAT = Format("CSV", "table of text with 'name [unit]' headers", (".csv", ".csv.gz"), sniff, read, write)
