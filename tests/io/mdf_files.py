"""MF4 files made for tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from asammdf import MDF, Signal, Source

CAN = Source("CAN", "CAN", "", source_type=Source.SOURCE_BUS, bus_type=Source.BUS_TYPE_CAN)
DBC = (
    'VERSION ""\n\nBS_:\n\nBU_: ECU\n\n'
    'BO_ 256 imu: 8 ECU\n SG_ x : 0|16@1- (0.01,0) [0|0] "m/s^2" ECU\n'
    ' SG_ y : 23|16@0- (0.01,0) [0|0] "m/s^2" ECU\n'
)


def save(path: Path, *groups: list[Signal], names: list[str] | None = None) -> Path:
    with MDF(version="4.10") as mdf:
        for i, group in enumerate(groups):
            index = mdf.append(group, common_timebase=True)
            if names:
                mdf.groups[index].channel_group.acq_name = names[i]
        mdf.save(path, overwrite=True)
    return path


def raw_group(
    identifiers: list[int], data: np.ndarray, *, bus: int = 1, start: float = 0.0, fields: str = "full"
) -> list[Signal]:
    n, width = data.shape
    columns: list[tuple[str, np.ndarray]] = [
        ("CAN_DataFrame.BusChannel", np.full(n, bus, np.uint8)),
        ("CAN_DataFrame.ID", np.asarray(identifiers, np.uint32)),
        ("CAN_DataFrame.DLC", np.full(n, width if width <= 8 else 15, np.uint8)),
        ("CAN_DataFrame.DataBytes", data.astype(np.uint8)),
    ]
    if fields == "full":
        columns.insert(2, ("CAN_DataFrame.IDE", np.asarray(identifiers) > 0x7FF))
        columns.insert(3, ("CAN_DataFrame.DataLength", np.full(n, width, np.uint8)))
    if fields == "least":
        columns = [c for c in columns if c[0].endswith(("ID", "DataBytes"))]
    record = np.zeros(n, [(name, c.dtype, c.shape[1:]) for name, c in columns])
    for name, c in columns:
        record[name] = c
    time = start + np.arange(n) * 0.01
    return [Signal(record, time, name="CAN_DataFrame", source=CAN)]
