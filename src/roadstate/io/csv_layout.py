"""How a CSV file is laid out: separators, headers, units and where its data begin."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass

from roadstate.core import InputError
from roadstate.core.tabular import split_header
from roadstate.core.units import is_same_dimension
from roadstate.io.time_column import find_time, time_unit

MISSING = frozenset(
    ["", "NaN", "nan", "NAN", "-nan", "-NaN", "NA", "N/A", "n/a", "#N/A", "null", "NULL", "None", "-", "--"]
)
"""Cells that mean that there is no value."""
NUMBER = r"[+-]?(?:\d+(?:[.]\d*)?|[.]\d+)(?:[eE][+-]?\d+)?|[+-]?[iI][nN][fF](?:inity)?"
"""Pattern of a number with a decimal point."""
_NUMBER = re.compile(NUMBER)
_LINE_END = re.compile(rb"\r\n|\n|\r")
# a cell that is a number with a decimal comma, in two parts: a search for what starts with a comma is fast
_FRACTION = re.compile(rb",\d+(?:[eE][+-]?\d+)?[ ]*(?=[;\t\r\n\"]|$)")
_WHOLE = re.compile(rb"(?:^|[;\t\r\n\"])[ ]*[+-]?\d*$")
_BOM = b"\xef\xbb\xbf"
_MAX_HEADER = 1_000_000  # bytes


@dataclass(frozen=True)
class Layout:
    """What the head of a CSV file says.

    Attributes:
        delimiter: ``,``, ``;`` or tab.
        decimal: ``.`` or ``,``.
        headers: columns as written; empty for one without a name.
        names: without their units.
        units: from the header or the line of units below it; ``None`` where neither gives one.
        time: position of the time column.
        time_unit: its unit.
        body: byte at which the data begin.
        first_line: number of the first data line in the file, from 1.
    """

    delimiter: str
    decimal: str
    headers: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    time: int
    time_unit: str | None
    body: int
    first_line: int


def lines(data: bytes, start: int = 0) -> Iterator[tuple[int, int, int]]:
    """(begin, end, begin of the next) of each line of ``data`` from byte ``start`` on."""
    while start < len(data):
        match = _LINE_END.search(data, start)
        end, following = (match.start(), match.end()) if match else (len(data), len(data))
        yield start, end, following
        start = following


def read_layout(
    data: bytes, where: str, time_column: str | None = None, fallback_unit: str | None = None
) -> Layout:
    """Read the head of a CSV file.

    Comment lines (``#``) and empty ones may stand before the header. A second line whose time cell is a unit
    of time (or empty) and that holds no number is a line of units.

    Args:
        data: the whole file.
        where: its name, for messages.
        time_column: the time column named by the user, or ``None``.
        fallback_unit: the time's unit, where the file gives none.

    Raises:
        InputError: no header, a name that is given twice, no time column or more than one.
    """
    number = 0
    header = None
    following = 0
    for begin, end, after in lines(data, len(_BOM) if data.startswith(_BOM) else 0):
        number += 1
        line = data[begin:end].strip(b" ")
        if line and not line.startswith(b"#"):
            header, following = line, after
            break
    if header is None:
        raise InputError("there is no header line", where=where, mend="name the columns in the first line")
    text = _text(header, number, where)
    delimiter = _delimiter(text)
    headers = _cells(text, delimiter, number, where)
    if all(_is_value(h, delimiter) for h in headers):
        raise InputError(
            f"line {number} holds numbers where the header should be",
            where=where,
            mend="name the columns in the first line, like 'time [s],speed [km/h]'",
        )
    split = [split_header(h) for h in headers]
    names = tuple(n for n, _ in split)
    doubled = next((n for i, n in enumerate(names) if n and n in names[:i]), None)
    if doubled is not None:
        raise InputError(f"two columns are named '{doubled}'", where=where, mend="rename one of them")
    time = find_time(headers, names, time_column, where)
    units = [u for _, u in split]
    below = next(lines(data, following), None)
    if below is not None and below[1] - below[0] < _MAX_HEADER:
        second = _cells(_text(data[below[0] : below[1]], number + 1, where), delimiter, number + 1, where)
        if len(second) == len(headers) and _are_units(second, time, delimiter):
            units = [u if u is not None else _bare(s) for u, s in zip(units, second, strict=True)]
            following, number = below[2], number + 1
    if not data[following:].strip():
        raise InputError("there are no data below the header", where=where, mend="is the file complete?")
    has_comma = delimiter != "," and _has_decimal_comma(data, following)
    return Layout(
        delimiter,
        "," if has_comma else ".",
        tuple(headers),
        names,
        tuple(units),
        time,
        time_unit(names[time], units[time] or fallback_unit),
        following,
        number + 1,
    )


def decode_text(raw: bytes) -> str:
    """Text in UTF-8 or, where it is not that, Latin-1 (which Windows tools write)."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _has_decimal_comma(data: bytes, start: int) -> bool:
    return any(
        _WHOLE.search(data[max(start, m.start() - 40) : m.start()]) for m in _FRACTION.finditer(data, start)
    )


def _text(line: bytes, number: int, where: str) -> str:
    if len(line) > _MAX_HEADER:
        raise InputError(f"line {number} is over a megabyte long", where=where, mend="is this a CSV file?")
    return decode_text(line)


def _delimiter(header: str) -> str:
    bare = re.sub(r'"[^"]*"|\[[^\]]*\]', "", header)
    return max(";\t,", key=bare.count)


def _cells(text: str, delimiter: str, number: int, where: str) -> list[str]:
    try:
        row = next(csv.reader([text], delimiter=delimiter), [])
    except csv.Error as error:
        raise InputError(f"line {number} cannot be split into cells ({error})", where=where) from error
    return [cell.strip() for cell in row]


def _is_value(cell: str, delimiter: str) -> bool:
    if delimiter != ",":
        cell = cell.replace(",", ".")
    return cell in MISSING or _NUMBER.fullmatch(cell) is not None


def _bare(cell: str) -> str | None:
    return cell.strip("[]() ") or None


def _are_units(cells: list[str], time: int, delimiter: str) -> bool:
    texts = [c for c in cells if c not in MISSING]
    if not texts or any(_is_value(c, delimiter) for c in texts):
        return False
    unit = _bare(cells[time])
    if unit is None:
        return True
    if any(c.isdigit() for c in unit):  # a calendar time
        return False
    try:
        return is_same_dimension(unit, "s")
    except InputError:
        return False
