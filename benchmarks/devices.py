"""How a batch of logs, and a particle filter, fare on the device that JAX finds: a GPU, or this CPU.

Run: python -m benchmarks.devices [--log FILE] [--logs N ...] [--particles N ...] [--estimators NAME ...]
     [--out FILE]
Rows are printed, and added to FILE, as they come. Without --log the drive is simulated first.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
from benchmarks.accuracy.scenarios import logs
from benchmarks.accuracy.speed import DRIVE
from benchmarks.machine import processor

from roadstate.core import Log
from roadstate.estimators import Estimator, build
from roadstate.io import read
from roadstate.io.mapping import DEFAULT_MAPPING
from roadstate.run import CHUNK, batch, scan
from roadstate.vehicles import load_vehicle

VEHICLE = "family-car"
RATE = 100.0  # samples a second
HEAD = (
    "| device | what | at once | first call, s | again, s | µs a step and log | × real time |\n"
    "|---|---|---:|---:|---:|---:|---:|"
)


def device() -> str:
    """Name of what JAX computes on."""
    if jax.default_backend() == "cpu":
        return f"{os.cpu_count()} cores, {processor()}"
    return str(jax.devices()[0].device_kind)


def timed(call: Callable[[], Any]) -> tuple[float, float]:
    """Seconds that a first call takes, with its compilation, and a second one."""
    spent = []
    for _ in range(2):
        begin = time.perf_counter()
        call()
        spent.append(time.perf_counter() - begin)
    return spent[0], spent[1]


def row(what: str, count: int, call: Callable[[], Any], steps: int) -> str:
    """A line of the table.

    Args:
        what: is measured.
        count: of logs or particles.
        call: that is timed.
        steps: of all logs together that it makes.
    """
    first, again = timed(call)
    cells = f"{first:.1f} | {again:.3f} | {1e6 * again / steps:.3g} | {steps / RATE / again:.0f}"
    return f"| {device()} | {what} | {count} | {cells} |"


def a_drive(file: Path | None) -> Log:
    """What is run over: as many samples as a loop takes at once."""
    if file is not None:
        return DEFAULT_MAPPING.apply(read(file)).resample()
    whole = logs(VEHICLE, DRIVE, 1)[0][0]
    return whole.between(whole.time[0], whole.time[CHUNK])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--logs", type=int, nargs="*", default=[64, 256, 1024])
    parser.add_argument("--particles", type=int, nargs="*", default=[500, 5000, 50000])
    parser.add_argument("--estimators", nargs="*", default=["kmbe", "tfobe", "joint"])
    parser.add_argument("--out", type=Path)
    told = parser.parse_args()
    car, log = load_vehicle(VEHICLE), a_drive(told.log)

    def say(line: str) -> None:
        print(line, flush=True)
        if told.out is not None:
            with told.out.open("a") as file:
                file.write(line + "\n")

    def built(name: str, **options: Any) -> Estimator[Any]:
        return build(name, car, log.available, **options)

    say(HEAD)
    for count in told.particles:
        pf = built("friction-pf", filter_options={"particles": count})
        say(row("`friction-pf`, particles of one log", count, partial(scan, pf, log), len(log)))
    for name in told.estimators:
        for count in told.logs:
            call = partial(batch, built(name), [log] * count)
            say(row(f"`{name}`, logs", count, call, count * len(log)))


if __name__ == "__main__":
    main()
