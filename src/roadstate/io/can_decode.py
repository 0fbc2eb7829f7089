"""Raw CAN frames to signals through a DBC, a whole message at a time.

Frames are grouped by (bus, id); a signal's bits are then gathered from the columns of data bytes with a few
array operations, instead of one call per frame. Read are little- and big-endian, signed and float (16, 32, 64
bits) signals up to 64 bits, and multiplexed ones, nested too (``SG_MUL_VAL_``): such a signal has samples
only where its multiplexer selects it. Values out of the DBC's [min|max] stay as they are; a value table
(``VAL_``) leaves the number.

NaN stands where a frame is shorter than the signal needs, and in J1939 messages where the raw value says *not
available* or *error* (SAE J1939-71, 5.1.4: all bits set; the highest byte 0xFE or 0xFF).

Messages sent in several frames (ISO-TP, as UDS replies; J1939 transport protocol) are not put together: a
message of more than 8 bytes of which only frames of up to 8 were seen is left out, and named as such.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError, Signal
from roadstate.io.can_frames import Decoded, Frames, identifier_text, name_apart
from roadstate.io.dbc import Database, MessageLayout, SignalLayout
from roadstate.io.obd import decode_replies

_CLASSIC_LENGTH = 8
_SHOWN = 12


@dataclass(frozen=True)
class Decoding:
    """What came out of a set of frames.

    Attributes:
        signals: by name (see :func:`roadstate.io.can_frames.name_apart`).
        undecoded: ids seen that neither a DBC nor OBD-II explains, as text.
        skipped: ``message`` or ``message.signal`` that could not be read, with the reason.
    """

    signals: dict[str, Signal] = field(default_factory=dict)
    undecoded: tuple[str, ...] = ()
    skipped: tuple[str, ...] = ()


def decode_frames(frames: Frames, database: Database | None, file: str) -> Decoding:
    """Signals of a DBC and OBD-II replies out of raw frames.

    Args:
        frames: (N,) in the order received.
        database: the DBC files; ``None`` reads OBD-II replies only.
        file: path of the log, for messages; its last part goes into the sources.

    Raises:
        InputError: there are no frames, no id seen is in the DBC, or nothing could be decoded at all.
    """
    if not len(frames):
        raise InputError("holds no CAN frames", where=file, mend="was the bus silent or not connected?")
    decoded: list[Decoded] = []
    undecoded: list[str] = []
    skipped: list[str] = []
    seen: list[str] = []
    matched: dict[tuple[int, str, str], tuple[MessageLayout, list[Frames]]] = {}
    for group in frames.by_identifier():
        identifier, is_extended = int(group.identifier[0]), bool(group.is_extended[0])
        text = identifier_text(identifier, is_extended)
        seen.append(text)
        replies = decode_replies(group)
        decoded += replies
        found = database.find(identifier, is_extended) if database else None
        if found is None:
            if not replies:
                undecoded.append(text)
            continue
        message, by_group = found
        if message.length > _CLASSIC_LENGTH and int(group.length.max()) <= _CLASSIC_LENGTH:
            skipped.append(
                f"{message.name}: {message.length} bytes sent in several frames (transport protocol)"
            )
            continue
        sender = f"0x{identifier & 0xFF:02X}" if by_group else text
        # one J1939 sender may send a parameter group under several priorities: one signal all the same
        matched.setdefault((int(group.bus[0]), message.name, sender), (message, []))[1].append(group)
    for (_, _, sender), (message, groups) in matched.items():
        decoded += decode_message(Frames.concatenate(groups), message, sender)
        skipped += [f"{name}: more than 64 bits" for name in message.unreadable]
    skipped = list(dict.fromkeys(skipped))
    if database and not matched and not skipped:
        known = [identifier_text(*key) for key in sorted(database.exact)]
        raise InputError(
            f"no id of the log is in {', '.join(database.files)}: the log has {_some(seen)}; "
            f"the DBC has {_some(known)}",
            where=file,
            mend="give the DBC of this car's bus",
        )
    if not decoded and database is None:
        raise InputError(
            f"raw CAN frames without a DBC (ids {_some(seen)})", where=file, mend="name one with --dbc"
        )
    if not decoded:
        reason = _some(skipped) or "no frame selects any of its multiplexed signals"
        raise InputError(f"nothing could be decoded: {reason}", where=file, mend="use a DBC of single frames")
    return Decoding(name_apart(decoded, Path(file).name), tuple(dict.fromkeys(undecoded)), tuple(skipped))


def decode_message(frames: Frames, message: MessageLayout, sender: str = "") -> list[Decoded]:
    """All signals of one message.

    Args:
        frames: (N,) frames that all carry the message.
        message: its layout.
        sender: tells senders of the message apart in names.

    Returns:
        One entry per signal that is present at least once; signals that are always present share one time
        array.
    """
    raws = {name: extract(frames.data, layout) for name, layout in message.signals.items()}
    rows_of: dict[tuple[tuple[str, tuple[int, ...]], ...], NDArray[np.intp] | None] = {(): None}
    times: dict[tuple[tuple[str, tuple[int, ...]], ...], NDArray[np.float64]] = {(): frames.time}
    out = []
    for name, layout in message.signals.items():
        if layout.switches not in rows_of:
            rows = _selected(frames, message, raws, layout.switches)
            rows_of[layout.switches], times[layout.switches] = rows, frames.time[rows]
        time = times[layout.switches]
        if not len(time):
            continue
        rows_or_all = rows_of[layout.switches]
        raw, length = raws[name], frames.length
        if rows_or_all is not None:
            raw, length = raw[rows_or_all], length[rows_or_all]
        values = _physical(raw, layout)
        missing = _too_short(length, layout)
        if message.is_j1939 and not layout.is_float and not layout.is_signed:
            missing |= _not_available(raw, layout.bits)
        if missing.any():
            values[missing] = np.nan
        signal = Signal(time, values, layout.unit, message=message.name, bus=int(frames.bus[0]))
        out.append(Decoded(f"{message.name}.{name}", sender, signal))
    return out


def extract(data: NDArray[np.uint8], layout: SignalLayout) -> NDArray[np.uint64]:
    """The raw bits of one signal in every frame.

    Args:
        data: (N, W) data bytes.
        layout: where the bits lie; bytes past W read as 0.

    Returns:
        (N,) unsigned, before sign, scale and offset.
    """
    raw = np.zeros(len(data), np.uint64)
    for i, index in enumerate(layout.byte_indices):
        if index >= data.shape[1]:
            continue
        shift = 8 * i - layout.first_bit
        byte = data[:, index].astype(np.uint64)
        # a 64-bit signal that starts inside a byte covers nine; the bits beyond 64 fall off
        raw |= byte << np.uint64(shift) if shift >= 0 else byte >> np.uint64(-shift)
    if layout.bits < 64:
        raw &= np.uint64((1 << layout.bits) - 1)
    return raw


def _physical(raw: NDArray[np.uint64], layout: SignalLayout) -> NDArray[np.float64]:
    values: NDArray[np.float64]
    with np.errstate(invalid="ignore", over="ignore"):  # frames may hold any float, signalling NaN too
        if layout.is_float:
            unsigned = raw.astype(f"u{layout.bits // 8}")
            values = unsigned.view(f"f{layout.bits // 8}").astype(np.float64)
        elif layout.is_signed:
            spare = np.uint64(64 - layout.bits)
            values = ((raw << spare).view(np.int64) >> spare.astype(np.int64)).astype(np.float64)
        else:
            values = raw.astype(np.float64)
        if layout.scale != 1.0:
            values *= layout.scale
        if layout.offset:
            values += layout.offset
    return values


def _too_short(length: NDArray[np.uint8], layout: SignalLayout) -> NDArray[np.bool_]:
    too_short: NDArray[np.bool_] = length <= max(layout.byte_indices)
    return too_short


def _not_available(raw: NDArray[np.uint64], bits: int) -> NDArray[np.bool_]:
    if bits >= 8 and bits % 8 == 0:
        highest: NDArray[np.uint64] = raw >> np.uint64(bits - 8)
        return highest >= np.uint64(0xFE)
    if bits >= 2:
        all_set: NDArray[np.bool_] = raw == np.uint64((1 << bits) - 1)
        return all_set
    return np.zeros(len(raw), bool)


def _selected(
    frames: Frames,
    message: MessageLayout,
    raws: dict[str, NDArray[np.uint64]],
    switches: Iterable[tuple[str, tuple[int, ...]]],
) -> NDArray[np.intp]:
    chosen = np.ones(len(frames), bool)
    for multiplexer, ids in switches:
        layout = message.signals[multiplexer]
        wanted = np.array([i for i in ids if 0 <= i < 1 << 64], dtype=np.uint64)
        chosen &= np.isin(raws[multiplexer], wanted) & ~_too_short(frames.length, layout)
    return np.flatnonzero(chosen)


def _some(texts: list[str]) -> str:
    unique = list(dict.fromkeys(texts))
    more = f" and {len(unique) - _SHOWN} more" if len(unique) > _SHOWN else ""
    return ", ".join(unique[:_SHOWN]) + more
