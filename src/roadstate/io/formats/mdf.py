"""ASAM MDF4: named signals, and raw CAN frames decoded through DBC files.

Signals are read channel by channel, with their conversions applied (texts of a value table stay numbers) and
samples whose invalidation bit is set as NaN; channels of one group share one time array. Channels that hold
no plain numbers (texts, arrays, raw bytes) are left out and listed in ``metadata["skipped"]``. A name that
several groups carry becomes ``group.name``, or ``name#<group number>`` where the groups' names do not tell
them apart.

Frames come from groups of ASAM bus logging (``CAN_DataFrame``), as :mod:`roadstate.io.can_decode` and
:mod:`roadstate.io.obd` read them. Needs asammdf (extra ``mdf``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core import CHANNELS, InputError, Log, Recording, Signal
from roadstate.core.tabular import atomic_path
from roadstate.io.asammdf_access import guarded, open_mdf, require_asammdf
from roadstate.io.can_decode import decode_frames
from roadstate.io.can_frames import Frames
from roadstate.io.dbc import load_dbc
from roadstate.io.formats import Format, ReadOptions

_TIME_SYNC = 1
_FIXED_LENGTH, _VARIABLE_LENGTH = 0, 1  # kinds of channels
_UNSIGNED = 0
_VALUE_TYPES = (_FIXED_LENGTH, 6)  # 6 is a virtual data channel: its value is the record's number
_LAST_NUMERIC_TYPE = 5  # data types 0..5 are integers and floats
_DEFLATE_TRANSPOSED = 2
_UTC_OFFSET_VALID = 2
_FRAME_FIELDS = ("ID", "DataBytes", "DataLength", "DLC", "BusChannel", "IDE")
_LENGTH_OF_DLC = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64], dtype=np.uint8)


def sniff(head: bytes) -> bool:
    """Whether the file starts as MDF files do, finalised or not."""
    return head.startswith((b"MDF ", b"UnFinMF"))


def read(path: Path, options: ReadOptions) -> Recording:
    """Read an MDF4 file.

    Raises:
        InputError: asammdf is missing, the file is damaged or cut short, holds raw frames that no DBC given
            explains, or holds nothing that can be read.
    """
    require_asammdf(str(path))
    database = load_dbc(options.dbc) if options.dbc else None
    with path.open("rb") as stream:
        is_finished = stream.read(3) == b"MDF"
    with guarded(path) as folder:
        mdf = open_mdf(path, folder)
        try:
            parts, groups, skipped = [], [], []
            for index, group in enumerate(mdf.groups):
                if not group.channel_group.cycles_nr or not group.channels:
                    continue
                fields = _frame_fields(group.channels)
                if fields:
                    parts.append(_frames(mdf, index, fields, is_finished))
                else:
                    signals, left_out = _named(mdf, index)
                    groups.append((index, str(group.channel_group.acq_name or ""), signals))
                    skipped += left_out
            start = _start_time(mdf.header)
        finally:
            mdf.close()
    metadata: dict[str, Any] = {"start_time": start} if start else {}
    named = _by_name(groups, path.name)
    if parts:
        # without a DBC a file that also holds named signals is still of use
        if database is None and named:
            skipped.append("CAN frames: no DBC given")
        else:
            decoding = decode_frames(Frames.concatenate(parts), database, str(path))
            named |= decoding.signals
            skipped += decoding.skipped
            metadata["undecoded"] = list(decoding.undecoded)
    if not named:
        raise InputError("holds no samples", where=str(path), mend="was anything recorded?")
    if skipped:
        metadata["skipped"] = skipped
    return Recording(named, metadata)


def write(log: Log, path: Path) -> None:
    """Write MDF 4.10 (compressed) with the channels under their canonical names and the log's start time."""
    asammdf = require_asammdf(str(path))
    mdf = asammdf.MDF(version="4.10")
    try:
        signals = [
            asammdf.Signal(
                values, log.time, name=name, unit=CHANNELS[name].unit, comment=CHANNELS[name].description
            )
            for name, values in log.channels.items()
        ]
        mdf.append(signals, comment="roadstate", common_timebase=True)
        start = log.metadata.get("start_time")
        # asammdf would put the present moment: 0 stands for a log without absolute time
        mdf.header.abs_time = (
            int(np.datetime64(str(start)).astype("datetime64[ns]").astype(np.int64)) if start else 0
        )
        mdf.header.tz_offset = mdf.header.daylight_save_time = 0
        mdf.header.time_flags = _UTC_OFFSET_VALID
        with atomic_path(path) as temporary, temporary.open("wb+") as stream:
            mdf.save(stream, overwrite=True, compression=_DEFLATE_TRANSPOSED)
    finally:
        mdf.close()


def _start_time(header: Any) -> str | None:
    if not header.abs_time:
        return None
    # a local time without its offset cannot be told from UTC
    return str(np.datetime64(int(header.abs_time), "ns"))


def _frame_fields(channels: Sequence[Any]) -> dict[str, int]:
    """Channel index of each field of raw CAN frames; empty where the group holds none."""
    fields: dict[str, int] = {}
    for index, channel in enumerate(channels):
        for field in _FRAME_FIELDS:
            if channel.name.endswith(f"CAN_DataFrame.{field}"):
                fields.setdefault(field, index)
    return fields if {"ID", "DataBytes"} <= fields.keys() else {}


def _frames(mdf: Any, group: int, fields: dict[str, int], is_finished: bool) -> Frames:
    names = [f for f in fields if f != "DataBytes"]
    selected = mdf.select([(None, group, fields[f]) for f in names], raw=True, copy_master=False)
    column = {name: signal.samples for name, signal in zip(names, selected, strict=True)}
    data = _data_bytes(mdf, group, fields["DataBytes"])
    time = np.asarray(selected[0].timestamps, dtype=np.float64)
    n = min(len(data), len(time), *(len(c) for c in column.values()))
    if is_finished and n < mdf.groups[group].channel_group.cycles_nr:
        raise ValueError(f"{n} whole frames")
    # in a file that was cut off while being written the last frame may lack its bytes
    if "DataLength" in column:
        length = column["DataLength"]
    elif "DLC" in column:
        length = _LENGTH_OF_DLC[np.minimum(column["DLC"], 15)]
    else:
        length = np.full(len(time), data.shape[1])
    return Frames.from_columns(
        time[:n],
        column["ID"][:n],
        data[:n],
        length=length[:n],
        bus=column["BusChannel"][:n] if "BusChannel" in column else None,
        is_extended=column["IDE"][:n] if "IDE" in column else None,
    )


def _data_bytes(mdf: Any, group_index: int, index: int) -> NDArray[np.uint8]:
    """(N, W) data bytes of CAN frames, whether each record holds them or points to them."""
    group = mdf.groups[group_index]
    channel = group.channels[index]
    is_pointer = channel.channel_type == _VARIABLE_LENGTH
    if is_pointer:
        # read as what the record holds, a number; asammdf follows it without looking where it points
        channel.channel_type, channel.data_type = _FIXED_LENGTH, _UNSIGNED
    samples = np.asarray(mdf.get(None, group_index, index, raw=True, samples_only=True)[0])
    if is_pointer:
        return _gather(np.frombuffer(mdf._mdf._load_signal_data(group=group, index=index), np.uint8), samples)
    if samples.ndim == 1:
        samples = np.ascontiguousarray(samples).view(np.uint8).reshape(len(samples), -1)
    return samples.astype(np.uint8, copy=False)


def _gather(stored: NDArray[np.uint8], pointers: NDArray[Any]) -> NDArray[np.uint8]:
    """(n, W) data bytes out of [length, bytes] entries, up to the first that a frame cannot have."""
    entry = pointers.astype(np.int64)
    entry = entry[: _leading((entry >= 0) & (entry <= len(stored) - 4))]
    size = np.zeros(len(entry), np.int64)
    for i in range(4):
        size |= stored[entry + i].astype(np.int64) << 8 * i
    size = size[: _leading((size <= _LENGTH_OF_DLC[-1]) & (entry + 4 + size <= len(stored)))]
    data = np.zeros((len(size), int(size.max(initial=0))), np.uint8)
    for i in range(data.shape[1]):
        rows = np.flatnonzero(size > i)
        data[rows, i] = stored[entry[rows] + 4 + i]
    return data


def _leading(good: NDArray[np.bool_]) -> int:
    return len(good) if good.all() else int(np.argmin(good))


def _named(mdf: Any, index: int) -> tuple[dict[str, Signal], list[str]]:
    """Numeric signals of one group, and the names of its other channels."""
    group = mdf.groups[index]
    master = mdf.masters_db.get(index)
    others = [(i, c) for i, c in enumerate(group.channels) if i != master]
    if master is None or group.channels[master].sync_type not in (0, _TIME_SYNC):
        return {}, [f"{c.name}: no time" for _, c in others]
    plain = [
        (i, c)
        for i, c in others
        if c.channel_type in _VALUE_TYPES
        and c.data_type <= _LAST_NUMERIC_TYPE
        and not group.channel_dependencies[i]
    ]
    skipped = [c.name for pair in others if pair not in plain for c in pair[1:]]
    if not plain:
        return {}, skipped
    selected = mdf.select(
        [(None, index, i) for i, _ in plain], copy_master=False, ignore_value2text_conversions=True
    )
    time = np.asarray(selected[0].timestamps, dtype=np.float64)
    signals: dict[str, Signal] = {}
    for (_, channel), read_signal in zip(plain, selected, strict=True):
        samples = read_signal.samples
        if samples.ndim != 1 or samples.dtype.kind not in "biuf":
            skipped.append(channel.name)
            continue
        if channel.name in signals:
            skipped.append(f"{channel.name}: a second one of that name in its group")
            continue
        values = samples.astype(np.float64)
        if read_signal.invalidation_bits is not None:
            values[np.asarray(read_signal.invalidation_bits, dtype=bool)] = np.nan
        signals[channel.name] = Signal(time, values, read_signal.unit or None)
    return signals, skipped


def _by_name(groups: Sequence[tuple[int, str, dict[str, Signal]]], file: str) -> dict[str, Signal]:
    times_seen = Counter(name for _, _, signals in groups for name in signals)
    qualified = Counter((group, name) for _, group, signals in groups for name in signals)
    out: dict[str, Signal] = {}
    for index, group, signals in groups:
        for name, signal in signals.items():
            key = name
            if times_seen[name] > 1:
                key = f"{group}.{name}" if group and qualified[group, name] == 1 else f"{name}#{index}"
            out[key] = replace(signal, source=f"{file}:{key}")
    return out


FORMAT = Format(
    "MF4", "ASAM MDF4: named signals, or raw CAN frames with a DBC", (".mf4", ".mdf"), sniff, read, write
)
