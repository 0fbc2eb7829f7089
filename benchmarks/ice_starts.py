"""Logs that begin in the midst of wheel slip: what `joint` says of speed and slope from its first sample on.

Run from the project's root: python -m benchmarks.ice_starts [--drives 30]

Drives drawn at random, as `benchmarks.drawn` has them, cut where at least one tire slips by more than an
eighth: under traction control or anti-lock brakes, on ice mostly. Nothing is known of the speed then but
what wheels tell that do not roll.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterator

import numpy as np
from benchmarks.accuracy.progress import shown
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import VEHICLES
from benchmarks.drawn.__main__ import LACKING, recorded
from numpy.typing import NDArray

from roadstate.core import WHEELS, Estimates, Log, reference
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build
from roadstate.run import batch
from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]
_SLIP, _MOVING = 0.125, 3.0  # of a tire, and m/s, from which a log may begin
_CUTS, _SECONDS = 4, 10.0  # logs of each drive, and how long they are
_CHANNELS = ("bus", "receiver", "no torques")
_TIMES = ((0.0, 0.5), (0.5, 2.0), (2.0, 5.0), (5.0, _SECONDS))  # s since the first sample
_COLUMNS = (
    "| channels | s | speed: RMSE | of 9 in 10 logs | inside | slope: RMSE | of 9 in 10 logs | inside |"
)


def cuts(log: Log, rng: np.random.Generator) -> Iterator[Log]:
    """Parts of a drive that begin while a wheel slips."""
    slip = np.max([np.abs(log[f"ref_slip_{w}"]) for w in WHEELS], axis=0)
    fast = log["ref_velocity_x"] > _MOVING
    begins = np.flatnonzero((slip > _SLIP) & fast & (log.time < log.time[-1] - _SECONDS))
    for i in np.unique(rng.choice(begins, _CUTS)) if len(begins) else ():
        part = slice(i, i + int(np.searchsorted(log.time[i:], log.time[i] + _SECONDS)))
        yield Log(log.time[part], {c: log[c][part] for c in log.channels})


def rows(said: Estimates, log: Log) -> Array:
    """(times, 4) of speed and slope (m/s, per cent): mean squared error and share inside ±1.96 σ."""
    since = log.time - log.time[0]
    found = []
    for begin, end in _TIMES:
        part = (since >= begin) & (since < end)
        row: list[float] = []
        for quantity, unit in (("speed", 1.0), ("grade", 100.0)):
            truth = reference(quantity, log.channels)
            assert truth is not None
            error = (said.values[quantity] - truth)[part]
            inside = np.abs(error) < 1.96 * said.std[quantity][part]
            row += [float(np.mean((unit * error) ** 2)), float(np.mean(inside))]
        found.append(row)
    return np.array(found)


def study(count: int) -> dict[str, Array]:
    """Channels → (logs, times, 4)."""
    rng = np.random.default_rng(0)
    found: dict[str, list[Array]] = defaultdict(list)
    with shown() as tell:
        for i, vehicle in enumerate(VEHICLES):
            parts: list[tuple[Log, Vehicle]] = []
            for k, (log, car) in enumerate(recorded(vehicle, count)):
                tell(f"{vehicle}: drive {k + 1}", i * count + k, count * len(VEHICLES))
                parts += [(part, car) for part in cuts(log, rng)]
            for channels in _CHANNELS if parts else ():
                own = [without(part, LACKING[channels]) for part, _ in parts]
                built = [build("joint", car, own[0].available) for _, car in parts]
                found[channels] += [rows(*pair) for pair in zip(batch(built, own), own, strict=True)]
    return {channels: np.array(each) for channels, each in found.items()}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ice_starts", description=__doc__)
    parser.add_argument("--drives", type=int, default=30, help="of each vehicle")
    given = parser.parse_args()
    if given.drives < 1:
        parser.error("--drives: give 1 or more")
    use_compilation_cache()
    found = study(given.drives)
    print(f"\n{len(next(iter(found.values())))} logs. Speed in m/s, slope in per cent.\n")
    print(_COLUMNS + "\n|" + "---|" * 8)
    for channels, logs in found.items():
        for (begin, end), part in zip(_TIMES, np.moveaxis(logs, 1, 0), strict=True):
            cells = [f"{begin:g}–{end:g}"]
            for squared, inside in (part[:, :2].T, part[:, 2:].T):
                rms, nine = np.sqrt(squared.mean()), np.sqrt(np.percentile(squared, 90))
                cells += [f"{rms:.2f}", f"{nine:.2f}", f"{100 * inside.mean():.0f} %"]
            print("| " + " | ".join([channels, *cells]) + " |")


if __name__ == "__main__":
    main()
