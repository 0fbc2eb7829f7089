"""Log file formats: one module of this package is one format.

To add a format, write a module here that defines ``FORMAT``, a :class:`Format`; discovery makes it appear in
:func:`roadstate.io.read`, :func:`roadstate.io.write` and the command line.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from roadstate.core import InputError, Log, Recording


@dataclass(frozen=True)
class ReadOptions:
    """What a reader may be told beside the path; each format takes what concerns it.

    Attributes:
        dbc: DBC files for raw CAN frames.
        time_column: name of the column that holds the time, for tables in which it cannot be told by its
            name.
        time_unit: unit of that column where its header gives none.
    """

    dbc: tuple[Path, ...] = ()
    time_column: str | None = None
    time_unit: str | None = None


@dataclass(frozen=True)
class Format:
    """One log file format.

    Attributes:
        name: short, as shown in messages and in a recording's metadata.
        description: one line.
        suffixes: lower case, with their dots; the first is the usual one.
        sniff: whether a file that starts with these bytes (up to 4096) is of this format.
        read: path and options → recording, with the names, units and time bases of the file. The path is a
            regular file that is not empty. Raises ``InputError``.
        write: log and path → nothing; the path is to be replaced as a whole. ``None`` where there is no
            writer.
    """

    name: str
    description: str
    suffixes: tuple[str, ...]
    sniff: Callable[[bytes], bool]
    read: Callable[[Path, ReadOptions], Recording]
    write: Callable[[Log, Path], None] | None = None

    def has_suffix(self, path: Path) -> bool:
        """Whether the path's name ends as this format's files do."""
        return path.name.lower().endswith(self.suffixes)


@cache
def all_formats() -> tuple[Format, ...]:
    """Every format in this package, by name.

    Raises:
        TypeError: a module of the package defines no ``FORMAT``.
    """
    found = []
    for module in pkgutil.iter_modules(__path__):
        candidate = getattr(importlib.import_module(f"{__name__}.{module.name}"), "FORMAT", None)
        if not isinstance(candidate, Format):
            raise TypeError(f"{__name__}.{module.name} must define FORMAT = Format(...)")
        found.append(candidate)
    return tuple(sorted(found, key=lambda f: f.name))


def format_of(path: Path) -> Format:
    """The format that reads a file: told by its content, and only where that says nothing by its name.

    Raises:
        InputError: neither content nor name belongs to a known format.
    """
    with path.open("rb") as stream:
        head = stream.read(4096)
    named = [f for f in all_formats() if f.has_suffix(path)]
    sniffed = [f for f in all_formats() if f.sniff(head)]
    both = [f for f in sniffed if f in named]
    for choice in (both, sniffed, named):
        if choice:
            return choice[0]
    known = ", ".join(f"{f.name} ({f.suffixes[0]})" for f in all_formats())
    raise InputError(
        "the content is of no known log format", where=str(path), mend=f"convert it to one of {known}"
    )


def writer_of(path: Path) -> Callable[[Log, Path], None]:
    """The writer for a path, by its suffix.

    Raises:
        InputError: the suffix belongs to no format that can be written.
    """
    writers = [f for f in all_formats() if f.write is not None]
    for candidate in writers:
        if candidate.write is not None and candidate.has_suffix(path):
            return candidate.write
    suffixes = ", ".join(s for f in writers for s in f.suffixes)
    raise InputError(f"cannot tell the format from '{path.suffix}'", where=str(path), mend=f"use {suffixes}")
