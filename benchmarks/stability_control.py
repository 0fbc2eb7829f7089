"""Stability control that brakes single wheels, and what `joint` makes of it.

``python -m benchmarks.stability_control`` prints the table of ``benchmarks/results/stability_control.md``:
three cars on the multibody plant, automotive sensors, vehicle files that are off by 5 to 10 %.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
from benchmarks.accuracy.measures import interval
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import KMH, VEHICLES, Scenario, named, on_plant
from benchmarks.drawn.__main__ import LACKING
from benchmarks.real_logs import table

from roadstate.core import Estimates, Log, Validity, reference
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build
from roadstate.run import batch

_DRIVES = {
    "lane change, 85 km/h on 0.8": ("double-lane-change", 85 * KMH, 0.8),
    "lane change, 60 km/h on 0.4": ("double-lane-change", 60 * KMH, 0.4),
    "sine, 80 km/h on 0.8": ("sine-with-dwell", 80 * KMH, 0.8),
    "sine, 50 km/h on 0.3": ("sine-with-dwell", 50 * KMH, 0.3),
}
_CHANNELS = {"bus": LACKING["bus"], "no brakes": LACKING["no brakes"], "with a receiver": ()}
_COUNT = 6
_BEGINS = 1.0  # s after which it counts
_HARD = 0.7  # share of the friction
_HEAD = """# Stability control

`python -m benchmarks.stability_control`: single wheels are braked where a car turns otherwise than it is
steered. Six recordings each, `joint`, from 1 s on. Grade: RMSE (%). Peak: median size of the likeliest
friction's error (%) where more than 0.7 of it is used. Inside, holds: share (%) of samples within the 95 %
interval, or on the right side of a bound of the 90 % interval. Called faulty: share (%) of samples in which
a sensor is, all of which are sound.
"""


def judged(said: list[Estimates], logs: list[Log]) -> dict[str, float]:
    """RMSE of grade (%), shares (%) of samples inside intervals and of those in which a sensor is called
    faulty, and median size of the likeliest friction's error (%) where much of it is used."""
    rows = [each(estimates, log) for estimates, log in zip(said, logs, strict=True)]
    together = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
    grade, peak = together.pop("grade"), together.pop("peak")
    shares = {name: 100 * float(np.mean(values)) for name, values in together.items()}
    hard = {"peak": float(np.median(peak))} if len(peak) else {}
    return {"grade": float(np.sqrt(np.mean(grade**2))), **shares, **hard}


def each(estimates: Estimates, log: Log) -> dict[str, np.ndarray]:
    """The samples that :func:`judged` sums up, of one recording."""
    late = log.time - log.time[0] > _BEGINS
    truth, inside = {}, {}
    for name in ("grade", "speed", "friction_used", "friction_peak"):
        true, reach = reference(name, log.channels), interval(estimates, name)
        assert true is not None
        assert reach is not None
        truth[name], inside[name] = true, (reach[0] <= true, true <= reach[1])
    peak = truth["friction_peak"]
    hard = late & (truth["friction_used"] > _HARD * peak)
    return {
        "grade": 100 * (estimates.values["grade"] - truth["grade"])[late],
        "peak": 100 * np.abs(estimates.values["friction_peak"] / peak - 1)[hard],
        **{f"{n} inside": np.all(inside[n], axis=0)[late] for n in ("grade", "speed", "friction_used")},
        "lower holds": inside["friction_peak"][0][late],
        "upper holds": inside["friction_peak"][1][late],
        "called faulty": (estimates.validity == Validity.SENSOR_FAULT)[late],
    }


def study() -> Iterator[tuple[str, str, dict[str, float]]]:
    """Row after row: channels, then drive and car."""
    for vehicle in VEHICLES:
        for title, (name, speed, friction) in _DRIVES.items():
            print(f"{vehicle}, {title}", file=sys.stderr)
            script = named(name, speed=speed, friction=friction)
            made = on_plant(vehicle, Scenario(name, title, script, stability=True), _COUNT)
            for channels, lacking in _CHANNELS.items():
                own = [without(log, lacking) for log, _ in made]
                built = [build("joint", car, log.available) for log, (_, car) in zip(own, made, strict=True)]
                yield channels, f"{title}, {vehicle}", judged(batch(built, own), own)


def main() -> None:
    """Print the tables."""
    use_compilation_cache()
    print(_HEAD)
    rows = list(study())
    for channels in _CHANNELS:
        print(table(channels, {name: row for of, name, row in rows if of == channels}))


if __name__ == "__main__":
    main()
