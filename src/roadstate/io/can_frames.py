"""Raw CAN frames as arrays, whatever file they come from, and the naming of what is decoded from them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from roadstate.core import Signal

_STANDARD_ID_LIMIT = 0x7FF
_ID_MASK = 0x1FFFFFFF


@dataclass(frozen=True)
class Frames:
    """N received data frames.

    Attributes:
        time: (N,) in s since the recording's start.
        bus: (N,) number of the bus channel, as the logger counts it.
        identifier: (N,) arbitration id, 11 or 29 bits.
        is_extended: (N,) whether the id has 29 bits.
        length: (N,) number of data bytes received.
        data: (N, W) data bytes; those past ``length`` mean nothing.
    """

    time: NDArray[np.float64]
    bus: NDArray[np.uint8]
    identifier: NDArray[np.uint32]
    is_extended: NDArray[np.bool_]
    length: NDArray[np.uint8]
    data: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, rows: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Frames:
        return Frames(
            self.time[rows],
            self.bus[rows],
            self.identifier[rows],
            self.is_extended[rows],
            self.length[rows],
            self.data[rows],
        )

    @classmethod
    def from_columns(
        cls,
        time: NDArray[np.float64],
        identifier: NDArray[np.uint32],
        data: NDArray[np.uint8],
        *,
        length: NDArray[np.uint8] | None = None,
        bus: NDArray[np.uint8] | None = None,
        is_extended: NDArray[np.bool_] | None = None,
    ) -> Frames:
        """Frames from columns as loggers write them.

        An id above 0x7FF is extended whatever its flag says (some loggers leave the flag unset), and bit 31
        of the id counts as that flag where there is none of its own.

        Args:
            time: (N,) in s.
            identifier: (N,) arbitration id.
            data: (N, W) data bytes.
            length: (N,) bytes received; default W.
            bus: (N,) bus channel; default 0.
            is_extended: (N,) flag of a 29-bit id.
        """
        n, width = data.shape
        identifier = identifier.astype(np.uint32, copy=False)
        flag = (identifier >> np.uint32(31)).astype(bool) if is_extended is None else is_extended.astype(bool)
        identifier = identifier & np.uint32(_ID_MASK)
        return cls(
            time,
            np.zeros(n, np.uint8) if bus is None else bus.astype(np.uint8, copy=False),
            identifier,
            flag | (identifier > _STANDARD_ID_LIMIT),
            np.full(n, width, np.uint8) if length is None else np.minimum(length, width).astype(np.uint8),
            data,
        )

    @classmethod
    def concatenate(cls, parts: Sequence[Frames]) -> Frames:
        """Several groups of frames as one, in time order (stable for equal times)."""
        if len(parts) == 1:
            return parts[0]
        width = max(p.data.shape[1] for p in parts)
        padded = [np.pad(p.data, ((0, 0), (0, width - p.data.shape[1]))) for p in parts]
        together = cls(
            np.concatenate([p.time for p in parts]),
            np.concatenate([p.bus for p in parts]),
            np.concatenate([p.identifier for p in parts]),
            np.concatenate([p.is_extended for p in parts]),
            np.concatenate([p.length for p in parts]),
            np.concatenate(padded),
        )
        return together[np.argsort(together.time, kind="stable")]

    def by_identifier(self) -> Iterator[Frames]:
        """The frames of each (bus, extended, id), in the order they came."""
        if not len(self):
            return
        key = (
            (self.bus.astype(np.uint64) << np.uint64(32))
            | (self.is_extended.astype(np.uint64) << np.uint64(31))
            | self.identifier.astype(np.uint64)
        )
        order = np.argsort(key, kind="stable")
        edges = np.flatnonzero(np.diff(key[order])) + 1
        for rows in np.split(order, edges):
            yield self[rows]


def identifier_text(identifier: int, is_extended: bool) -> str:
    """``0x7E8`` or ``0x18DAF110``: padded to the width of its kind."""
    return f"0x{identifier:08X}" if is_extended else f"0x{identifier:03X}"


@dataclass(frozen=True)
class Decoded:
    """One decoded signal before it has its final name.

    Attributes:
        name: ``message.signal``.
        sender: text that tells senders of one message apart (a source address, an ECU's id).
        signal: the samples.
    """

    name: str
    sender: str
    signal: Signal


def name_apart(decoded: Sequence[Decoded], file: str) -> dict[str, Signal]:
    """Signals by name: ``message.signal``, and only where several carry it also ``@bus``, ``@sender``.

    ``gnss_imu.AccelerationX``; seen on two buses ``gnss_imu.AccelerationX@1`` and ``…@2``; from two senders
    of one bus ``obd.engine_speed@0x7E8`` and ``…@0x7E9``.

    Args:
        decoded: what was decoded, any order.
        file: name of the file, for :attr:`Signal.source`.
    """
    buses: dict[str, set[int | None]] = {}
    senders: dict[tuple[str, int | None], int] = {}
    for d in decoded:
        buses.setdefault(d.name, set()).add(d.signal.bus)
        key = (d.name, d.signal.bus)
        senders[key] = senders.get(key, 0) + 1
    signals: dict[str, Signal] = {}
    for d in decoded:
        name = d.name
        if len(buses[d.name]) > 1:
            name += f"@{d.signal.bus}"
        if senders[d.name, d.signal.bus] > 1:
            name += f"@{d.sender}"
        signals[name] = replace(d.signal, source=f"{file}:{name}")
    return signals
