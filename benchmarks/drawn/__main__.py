"""Whether stated uncertainties hold on drives that nobody chose: roads, driving and cars drawn at random.

Run from the project's root: python -m benchmarks.drawn [--drives 30] [--save]

The drives of the accuracy benchmark are smooth and level across, and each stands for one difficulty. Here
each has a road of its own (grade, bank, bends, unevenness of ISO 8608 class A to C, pieces of friction from
.1 to 1.05), speeds and pedals of its own, a wind, sensors (`automotive`) and a vehicle file of its own,
off by 5 to 10 %, on the multibody plant: about what the estimators' priors speak of.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np
from benchmarks.accuracy.measures import interval
from benchmarks.accuracy.progress import shown
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE, VEHICLES
from benchmarks.drawn.drives import MIXED, SECONDS, WINDING, Roads, drawn
from benchmarks.real_logs import moving_mean
from numpy.typing import NDArray

from roadstate.core import WHEELS, Estimates, Log, is_bound, reference
from roadstate.core.numerics import use_compilation_cache
from roadstate.core.tabular import atomic_path
from roadstate.estimators import build
from roadstate.metrics import presented
from roadstate.run import batch
from roadstate.vehicles import Vehicle, load_vehicle

Array = NDArray[np.float64]
_RESULTS = Path(__file__).parent.parent / "results" / "drawn.md"
ESTIMATORS = ("joint", "tfobe", "two-stage", "friction-ukf", "lm-aekf")
_BRAKES = tuple(f"brake_{kind}_{w}" for kind in ("torque", "pressure") for w in WHEELS)
_AT_WHEELS = (*(f"drive_torque_{w}" for w in WHEELS), *_BRAKES)
_ENGINE = ("engine_torque", "engine_speed", "gear_ratio", "brake")
_BUS = "bus"
LACKING = {
    _BUS: SATELLITE,
    "receiver": (),
    "engine": (*SATELLITE, *_AT_WHEELS),
    "no brakes": (*SATELLITE, *_BRAKES, "brake"),
    "no torques": (*SATELLITE, *_AT_WHEELS, *_ENGINE),
}
"""Which channels each kind of log lacks; those but the first are read by ``joint`` only."""
_OF_ROAD = ("grade", "bank")  # the mean over a second counts: what is shorter is unevenness
_OF_WHEELS = tuple(f"_{w}" for w in WHEELS)
_APART = 1000  # between the seeds of two vehicles
_HOW = (
    "`python -m benchmarks.drawn --save`: {count} drives of {seconds:.0f} s each of {vehicles}; the "
    "multibody plant with anti-lock and traction control, sensors `automotive`, files off by 5 to 10 %. What "
    "is drawn: `benchmarks/drawn/drives.py`. Channels: `bus`, all that a car has; `receiver`, a satellite "
    "receiver's besides; `engine`, an engine's torque, speed and gear and a brake switch instead of torques "
    "at the wheels; `no brakes`, the drive's torque and nothing of brakes; `no torques`, none at all. "
    "Inside: samples whose 95 % interval (of a peak friction: 5 % to 95 % bounds) holds the truth; then the "
    "share that nine in ten drives exceed. Of grade and bank the mean over a second counts. Grade in per "
    "cent of slope; angles in rad, else SI units."
)
_BENDS = (
    "As many drives on winding roads: each of one friction, with bends that ask for up to nine tenths of it, "
    "and a driver who hardly brakes for them. `joint`, `bus`."
)
_SOUND = "No sensor is at fault in any of these drives, so each fault that is told is a false alarm."
_COLUMNS = ("RMSE", "stated 1 σ", "inside", "of 9 in 10 drives", "lower bound holds")


class Row(NamedTuple):
    """One quantity in one drive.

    Attributes:
        squared: mean squared error, in the unit shown.
        variance: mean σ², likewise.
        inside: share of samples whose interval (95 %; of a friction 90 %) holds the truth.
        above: share whose lower bound lies below the truth.
    """

    squared: float
    variance: float
    inside: float
    above: float


class Study(NamedTuple):
    """What came out.

    Attributes:
        rows: (quantity, channels, estimator) → a row for each drive.
        alarms: (channels, estimator) → what was said of sensors in each drive, all of which are sound.
    """

    rows: dict[tuple[str, str, str], list[Row]]
    alarms: dict[tuple[str, str], list[list[str]]]


def rows(said: Estimates, log: Log) -> dict[str, Row]:
    """Of every quantity that the log has the truth of; of what each wheel has, the mean."""
    found = {}
    of_wheels = defaultdict(list)
    for quantity in (q for q in said.values if not is_bound(q)):
        truth = reference(quantity, log.channels)
        ends = interval(said, quantity)
        if truth is None or ends is None:
            continue
        if quantity in _OF_ROAD:
            truth = moving_mean(truth, log.time, 1.0)
        values, std = said.values[quantity], said.std[quantity]
        used = np.isfinite(truth)
        told = presented(quantity, values)
        squared = (told - presented(quantity, truth)) ** 2
        variance = (presented(quantity, values + std) - told) ** 2
        inside, above = (ends[0] <= truth) & (truth <= ends[1]), ends[0] <= truth
        row = Row(*(float(np.mean(part[used])) for part in (squared, variance, inside, above)))
        if quantity.endswith(_OF_WHEELS):
            of_wheels[f"{quantity[:-3]} of a wheel"].append(row)
        else:
            found[quantity] = row
    return found | {name: Row(*np.mean(of, axis=0).tolist()) for name, of in of_wheels.items()}


def cells(of_drives: list[Row]) -> list[str]:
    """Of the columns of a quantity's table."""
    squared, variance, inside, above = np.array(of_drives).T
    numbers = np.sqrt(squared.mean()), np.sqrt(variance.mean())
    shares = 100 * inside.mean(), 100 * np.percentile(inside, 10), 100 * above.mean()
    return [f"{n:.3g}" for n in numbers] + [f"{s:.1f} %" for s in shares]


def recorded(vehicle: str, count: int, roads: Roads = MIXED) -> Iterator[tuple[Log, Vehicle]]:
    """Drives of one vehicle, each with the file told."""
    car, first = load_vehicle(vehicle), _APART * (1 + VEHICLES.index(vehicle))
    return (drawn(car, first + i, roads) for i in range(count))


def study(count: int, roads: Roads, reads: Mapping[str, Collection[str]]) -> Study:
    """Estimators, each with the channels that ``reads`` says, on ``count`` drives of each vehicle."""
    found: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    alarms: dict[tuple[str, str], list[list[str]]] = defaultdict(list)
    with shown() as tell:
        for i, vehicle in enumerate(VEHICLES):
            logs = []
            for k, drive in enumerate(recorded(vehicle, count, roads)):
                tell(f"{vehicle}: drive {k + 1}", 2 * i * count + k, 2 * count * len(VEHICLES))
                logs.append(drive)
            for name, kinds in reads.items():
                tell(f"{vehicle}: {name}", (2 * i + 1) * count, 2 * count * len(VEHICLES))
                for channels in kinds:
                    own = [without(log, LACKING[channels]) for log, _ in logs]
                    built = [build(name, car, own[0].available) for _, car in logs]
                    for said, log in zip(batch(built, own), own, strict=True):
                        for quantity, row in rows(said, log).items():
                            found[quantity, channels, name].append(row)
                        faults = [fault["fault"] for fault in said.metadata.get("faults", [])]
                        alarms[channels, name].append([fault.split(":")[0] for fault in faults])
    return Study(found, alarms)


def alarmed(of_drives: list[list[str]]) -> list[str]:
    """Of the columns of the second table: in how many drives a fault was told, and of which sensors."""
    counts = Counter(name for told in of_drives for name in set(told))
    said = ", ".join(f"`{name}` {times}" for name, times in counts.most_common())
    return [f"{sum(bool(told) for told in of_drives)} of {len(of_drives)}", said]


def page(found: Study, winding: Study, count: int) -> str:
    """The tables in Markdown."""
    lines = [
        "# Drives drawn at random",
        "",
        *fill(_HOW.format(count=count, seconds=SECONDS, vehicles=", ".join(VEHICLES)), 118).splitlines(),
        "",
        "| quantity | channels | estimator | " + " | ".join(_COLUMNS) + " |",
        "|---|---|---|" + "---|" * len(_COLUMNS),
    ]
    kinds = list(LACKING)
    order = sorted(found.rows, key=lambda key: (key[0], ESTIMATORS.index(key[2]), kinds.index(key[1])))
    lines += ["| " + " | ".join([*key, *cells(found.rows[key])]) + " |" for key in order]
    lines += [
        "",
        _SOUND,
        "",
        "| channels | estimator | drives with a false alarm | of |",
        "|---|---|---|---|",
    ]
    alarms = [
        *found.alarms.items(),
        *((("bus, winding roads", n), a) for (_, n), a in winding.alarms.items()),
    ]
    lines += ["| " + " | ".join([*key, *alarmed(told)]) + " |" for key, told in alarms]
    lines += ["", *fill(_BENDS, 118).splitlines(), ""]
    lines += ["| quantity | " + " | ".join(_COLUMNS) + " |", "|---|" + "---|" * len(_COLUMNS)]
    lines += [f"| {key[0]} | " + " | ".join(cells(winding.rows[key])) + " |" for key in sorted(winding.rows)]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, and print or save."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.drawn", description=__doc__)
    parser.add_argument("--drives", type=int, default=30, help="of each vehicle")
    parser.add_argument("--save", action="store_true", help=f"write {_RESULTS.name}")
    given = parser.parse_args()
    if given.drives < 1:
        parser.error("--drives: give 1 or more")
    use_compilation_cache()
    every = dict.fromkeys(ESTIMATORS, (_BUS,))
    found = study(given.drives, MIXED, {**every, ESTIMATORS[0]: tuple(LACKING)})
    winding = study(given.drives, WINDING, {ESTIMATORS[0]: (_BUS,)})
    made = page(found, winding, given.drives)
    if given.save:
        with atomic_path(_RESULTS) as temporary:
            temporary.write_text(made)
    print(made)


if __name__ == "__main__":
    main()
