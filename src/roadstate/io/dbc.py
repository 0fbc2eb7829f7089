"""Reading DBC files: which bits of which frames mean what.

cantools parses; here its messages become plain layouts that :mod:`roadstate.io.can_decode` works through
column by column, and frames find their message.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from roadstate.core import InputError
from roadstate.io.can_frames import identifier_text
from roadstate.io.paths import check_file

_NULL_ADDRESS = 0xFE  # J1939's address of nobody: what a DBC writes where any sender may send
_MAX_BITS = 64


@dataclass(frozen=True)
class SignalLayout:
    """Where a signal's bits lie and what they mean: ``value = raw * scale + offset``.

    Attributes:
        name: as in the DBC.
        unit: as in the DBC; ``None`` where it gives none.
        first_bit: position of the least significant bit, counted from bit 0 of byte 0 (little-endian) or from
            the end of the covering bytes (big-endian).
        byte_indices: the bytes covered, least significant first.
        bits: length, 1..64.
        is_signed: two's complement.
        is_float: IEEE 754 of ``bits`` 16, 32 or 64.
        scale: factor.
        offset: added after scaling.
        switches: (multiplexer signal, values of it under which this signal is present), outermost last.
    """

    name: str
    unit: str | None
    first_bit: int
    byte_indices: tuple[int, ...]
    bits: int
    is_signed: bool
    is_float: bool
    scale: float
    offset: float
    switches: tuple[tuple[str, tuple[int, ...]], ...] = ()


@dataclass(frozen=True)
class MessageLayout:
    """One DBC message.

    Attributes:
        name: as in the DBC.
        identifier: arbitration id.
        is_extended: 29-bit id.
        length: bytes the DBC says it has.
        is_j1939: declared as a J1939 parameter group.
        signals: by name.
        unreadable: ``message.signal`` of more than 64 bits, which are left out.
    """

    name: str
    identifier: int
    is_extended: bool
    length: int
    is_j1939: bool
    signals: dict[str, SignalLayout]
    unreadable: tuple[str, ...] = ()


@dataclass(frozen=True)
class Database:
    """The messages of one or more DBC files.

    Attributes:
        files: names of the files.
        exact: (id, is_extended) → message.
        groups: J1939 parameter group number → message, for messages that any sender may send.
    """

    files: tuple[str, ...]
    exact: dict[tuple[int, bool], MessageLayout] = field(default_factory=dict)
    groups: dict[int, MessageLayout] = field(default_factory=dict)

    def find(self, identifier: int, is_extended: bool) -> tuple[MessageLayout, bool] | None:
        """The message sent under an id, and whether it was found by its parameter group.

        The exact id comes first. A 29-bit id that has none is compared by its J1939 parameter group number,
        so whatever its priority, source address and (for PDU1) destination, with messages that declare
        themselves J1939 (``VFrameFormat`` J1939PG, or the file's ``ProtocolType`` J1939) or that have J1939's
        null address 0xFE for a source.
        """
        message = self.exact.get((identifier, is_extended))
        if message is not None:
            return message, message.is_j1939
        if is_extended:
            message = self.groups.get(parameter_group(identifier))
            if message is not None:
                return message, True
        return None


def parameter_group(identifier: int) -> int:
    """J1939's parameter group number of a 29-bit id (SAE J1939-21, 5.2: PDU1 leaves the destination out)."""
    group = identifier >> 8 & 0x3FFFF
    return group if group >> 8 & 0xFF >= 240 else group & 0x3FF00


def load_dbc(paths: Sequence[str | Path]) -> Database:
    """Read DBC files together.

    Raises:
        InputError: a file is missing or broken (with the line), or two define one id or one name.
    """
    database = Database(tuple(Path(p).name for p in paths))
    origin: dict[tuple[int, bool], str] = {}
    names: dict[str, str] = {}
    sharing: dict[int, list[MessageLayout]] = {}
    for path in paths:
        check_file(Path(path))
        stamp = Path(path).stat()
        for message in _messages(str(path), stamp.st_mtime_ns, stamp.st_size):
            key = (message.identifier, message.is_extended)
            if key in origin:
                raise InputError(
                    f"message {message.name} has id {identifier_text(*key)}, as "
                    f"{database.exact[key].name} of {origin[key]}",
                    where=str(path),
                    mend="give only the DBC files of this car's bus",
                )
            if message.name in names:
                raise InputError(
                    f"a message {message.name} is also in {names[message.name]}",
                    where=str(path),
                    mend="rename one of them",
                )
            origin[key] = names[message.name] = str(path)
            database.exact[key] = message
            if message.is_extended and (message.is_j1939 or message.identifier & 0xFF == _NULL_ADDRESS):
                sharing.setdefault(parameter_group(message.identifier), []).append(message)
    for group, messages in sharing.items():
        anybody = [m for m in messages if m.identifier & 0xFF == _NULL_ADDRESS]
        # several layouts under one group, each for its own sender: only exact ids tell them apart
        if len(messages) == 1 or len(anybody) == 1:
            database.groups[group] = (anybody or messages)[0]
    return database


@lru_cache(maxsize=16)
def _messages(path: str, modified: int, size: int) -> tuple[MessageLayout, ...]:
    try:
        import cantools.database
    except ImportError as error:
        raise InputError(
            "reading a DBC needs cantools", where=path, mend="install 'roadstate[mdf]'"
        ) from error
    problem = ""
    try:
        parsed: Any = cantools.database.load_file(path, database_format="dbc", strict=False)
        messages = tuple(_message(m, _is_j1939(m, parsed)) for m in parsed.messages)
    except RecursionError:
        problem = "nested too deeply"
    except Exception as error:  # cantools raises whatever its parser trips over
        problem = _first_sentence(error)
    if problem:
        raise InputError(f"not a readable DBC file: {problem}", where=path, mend="is it complete?")
    if not messages:
        raise InputError("the DBC defines no message", where=path, mend="is it the right file?")
    return messages


def _first_sentence(error: Exception) -> str:
    found = re.search(r"(?:Invalid|Expected)[^\n]*? at line \d+, column \d+", str(error))
    if found:
        return found[0][0].lower() + found[0][1:]
    text = " ".join(str(error).split()).removeprefix("DBC: ").strip('"')
    return text[:200] or type(error).__name__


def _is_j1939(message: Any, database: Any) -> bool:
    if message.protocol == "j1939":
        return True
    own = message.dbc.attributes if message.dbc else {}
    shared = database.dbc.attributes if database.dbc else {}
    protocol = shared.get("ProtocolType")
    named = protocol is not None and str(protocol.value).upper().startswith("J1939")
    return bool(named and message.is_extended_frame and "VFrameFormat" not in own)


def _message(message: Any, is_j1939: bool) -> MessageLayout:
    by_name = {s.name: s for s in message.signals}
    layouts = [_signal(s, by_name) for s in message.signals]
    wide = {s.name for s in layouts if s.bits > _MAX_BITS}
    # what a multiplexer of that width selects cannot be told apart either
    readable = [s for s in layouts if not wide & {s.name, *(name for name, _ in s.switches)}]
    return MessageLayout(
        message.name,
        int(message.frame_id),
        bool(message.is_extended_frame),
        int(message.length),
        is_j1939,
        {s.name: s for s in readable},
        tuple(f"{message.name}.{s.name}" for s in layouts if s not in readable),
    )


def _signal(signal: Any, by_name: dict[str, Any]) -> SignalLayout:
    start, bits = int(signal.start), int(signal.length)
    if signal.byte_order == "big_endian":
        # a DBC numbers bits 7..0 within each byte; counted along the wire the most significant comes first
        most = 8 * (start // 8) + 7 - start % 8
        last = most + bits - 1
        indices = tuple(range(last // 8, most // 8 - 1, -1))
        first_bit = 7 - last % 8
    else:
        indices = tuple(range(start // 8, (start + bits - 1) // 8 + 1))
        first_bit = start % 8
    switches = []
    parent, seen = signal, {signal.name}
    while parent.multiplexer_ids is not None and parent.multiplexer_signal in by_name:
        switches.append((parent.multiplexer_signal, tuple(sorted(parent.multiplexer_ids))))
        parent = by_name[parent.multiplexer_signal]
        if parent.name in seen:
            raise ValueError(f"multiplexer {parent.name} selects itself")
        seen.add(parent.name)
    return SignalLayout(
        signal.name,
        signal.unit or None,
        first_bit,
        indices,
        bits,
        bool(signal.is_signed),
        bool(signal.is_float) and bits in (16, 32, 64),
        float(signal.scale),
        float(signal.offset),
        tuple(switches),
    )
