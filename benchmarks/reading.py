"""How long reading and writing take: ``python -m benchmarks.reading`` prints the table.

Two hours at 100 Hz with 20 channels as CSV (plain, gzip, ``;`` with decimal comma), Parquet and MF4, and a
raw CAN log of 3.6 million frames in 20 messages with 6 signals each, decoded through a DBC by array
operations and, on a part of it, frame by frame with cantools for comparison.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from roadstate.core import CHANNELS, Log

_MESSAGES = 20
_FRAMES_PER_SECOND = 500
_RATE = 100
_CHANNELS = 20


def make_log(hours: float) -> Log:
    """A log of random walks, as many digits as a measurement has."""
    rng = np.random.default_rng(0)
    n = int(hours * 3600 * _RATE)
    names = [n for n in CHANNELS if n != "time" and not n.startswith("ref_")][:_CHANNELS]
    walks = {name: np.round(np.cumsum(rng.normal(scale=0.01, size=n)), 4) for name in names}
    return Log(np.round(np.arange(n) / _RATE, 6), walks)


def make_dbc(path: Path) -> Path:
    """20 messages of six signals, little- and big-endian, signed and not."""
    text = 'VERSION ""\n\nBS_:\n\nBU_: ECU\n\n'
    for m in range(_MESSAGES):
        text += f"BO_ {256 + m} message_{m}: 8 ECU\n"
        for s, (start, bits) in enumerate(((0, 12), (12, 12), (24, 8))):
            text += f' SG_ little_{s} : {start}|{bits}@1{"+-"[s % 2]} (0.1,-5) [0|0] "m/s" ECU\n'
        for s, (start, bits) in enumerate(((39, 12), (43, 12), (63, 8))):
            text += f' SG_ big_{s} : {start}|{bits}@0{"+-"[s % 2]} (0.25,0) [0|0] "deg/s" ECU\n'
        text += "\n"
    path.write_text(text)
    return path


def make_raw_can(path: Path, hours: float) -> int:
    """A bus log in ASAM form; the number of frames in it."""
    from asammdf import MDF, Signal, Source

    rng = np.random.default_rng(1)
    n = int(hours * 3600 * _FRAMES_PER_SECOND)
    fields = np.dtype(
        [
            ("CAN_DataFrame.BusChannel", "<u1"),
            ("CAN_DataFrame.ID", "<u4"),
            ("CAN_DataFrame.IDE", "<u1"),
            ("CAN_DataFrame.DLC", "<u1"),
            ("CAN_DataFrame.DataLength", "<u1"),
            ("CAN_DataFrame.DataBytes", "<u1", (8,)),
        ]
    )
    frames = np.zeros(n, fields)
    frames["CAN_DataFrame.BusChannel"] = 1
    frames["CAN_DataFrame.ID"] = 256 + np.arange(n) % _MESSAGES
    frames["CAN_DataFrame.DLC"] = frames["CAN_DataFrame.DataLength"] = 8
    frames["CAN_DataFrame.DataBytes"] = rng.integers(0, 256, (n, 8), dtype=np.uint8)
    bus = Source("CAN", "CAN", "", source_type=Source.SOURCE_BUS, bus_type=Source.BUS_TYPE_CAN)
    signal = Signal(frames, np.arange(n) / _FRAMES_PER_SECOND, name="CAN_DataFrame", source=bus)
    with MDF(version="4.10") as mdf:
        mdf.append([signal], comment="raw CAN")
        mdf.save(path, overwrite=True, compression=1)
    return n


def decode_with_cantools(dbc: Path, frames: int) -> float:
    """Seconds that cantools takes for as many frames, one call each."""
    import cantools.database

    database = cantools.database.load_file(dbc)
    data = np.random.default_rng(1).integers(0, 256, (frames, 8), dtype=np.uint8)
    rows = [row.tobytes() for row in data]
    begin = time.perf_counter()
    for i, row in enumerate(rows):
        database.decode_message(256 + i % _MESSAGES, row)  # type: ignore[union-attr]
    return time.perf_counter() - begin


def timed(action: Callable[[], object]) -> float:
    """Seconds of one call."""
    begin = time.perf_counter()
    action()
    return time.perf_counter() - begin


def read_alone(path: Path, dbc: Path | None) -> None:
    """Read in this process and print seconds and peak memory: a fresh process per file keeps them apart."""
    from roadstate.io import read

    seconds = timed(lambda: read(path, dbc=[dbc] if dbc else []))
    print(seconds, peak_memory())


def peak_memory() -> float:
    """MiB this process has held at most (the resource module would count its parent's too)."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def measure_reading(path: Path, dbc: Path | None = None) -> tuple[float, float]:
    """Seconds and peak MiB of reading a file in a process of its own (format libraries' imports included)."""
    command = [sys.executable, "-m", "benchmarks.reading", "--read", str(path)]
    command += ["--dbc", str(dbc)] if dbc else []
    seconds, peak = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    return float(seconds), float(peak)


def decimal_comma(source: Path, target: Path) -> Path:
    """The same table as a German spreadsheet writes it."""
    target.write_text(source.read_text().replace(",", ";").replace(".", ","))
    return target


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=2.0)
    parser.add_argument("--read", type=Path, help="read this file only, and print seconds and MiB")
    parser.add_argument("--dbc", type=Path)
    options = parser.parse_args()
    if options.read:
        read_alone(options.read, options.dbc)
        return
    from roadstate.io import write

    log = make_log(options.hours)
    print(f"{len(log)} rows, {len(log.channels)} channels\n")
    print(f"{'file':<24}{'MB':>8}{'write s':>10}{'read s':>10}{'peak MiB':>10}")
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        rows: list[tuple[str, Path, float | None]] = []
        for name in ("drive.csv", "drive.csv.gz", "drive.parquet", "drive.mf4"):
            path = folder / name
            rows.append((name, path, timed(lambda path=path: write(log, path))))  # type: ignore[misc]
        rows.insert(2, ("drive.csv (; and ,)", decimal_comma(folder / "drive.csv", folder / "de.csv"), None))
        for label, path, writing in rows:
            reading, peak = measure_reading(path)
            wrote = f"{writing:>10.2f}" if writing is not None else " " * 10
            print(f"{label:<24}{path.stat().st_size / 1e6:>8.1f}{wrote}{reading:>10.2f}{peak:>10.0f}")
        dbc, raw = make_dbc(folder / "bus.dbc"), folder / "bus.mf4"
        frames = make_raw_can(raw, options.hours)
        reading, peak = measure_reading(raw, dbc)
        print(f"{'raw CAN and DBC':<24}{raw.stat().st_size / 1e6:>8.1f}{'':>10}{reading:>10.2f}{peak:>10.0f}")
        sample = min(frames, 100_000)
        theirs = decode_with_cantools(dbc, sample) * frames / sample
        print(
            f"\n{frames} frames of 6 signals: {reading / frames * 1e6:.2f} µs a frame, file included; "
            f"cantools, decoding alone, {theirs / frames * 1e6:.2f} µs (from {sample} frames)"
        )


if __name__ == "__main__":
    main()
