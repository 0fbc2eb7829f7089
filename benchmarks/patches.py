"""Friction on roads that change every few metres: bounds may say that they do not know, but nothing else.

``python -m benchmarks.patches`` prints the table of ``benchmarks/results/patches.md``: cars on the multibody
plant, production sensors without satellites, vehicle files that are off by 5 to 10 %, on asphalt of a
friction of 0.85 with patches of ice.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import cache, partial

import numpy as np
from benchmarks.accuracy.measures import averaged, interval
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE, VEHICLES, Scenario, on_plant
from benchmarks.real_logs import table

from roadstate.core import Estimates, InputError, Log, Validity, reference
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build
from roadstate.run import batch
from roadstate.sim.manoeuvres import Manoeuvre, Script
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.manoeuvres.roads import plain
from roadstate.sim.roads.friction import FrictionMap, patches
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle

NAMES = ("joint", "friction-ukf", "lm-aekf", "two-stage")
_DRY, _ICE = 0.85, (0.15, 0.35)
_LENGTH, _FIRST = 900.0, 40.0  # m of patches, and m before them
_PATCH, _APART = (3.0, 8.0), (8.0, 25.0)  # m: how long a patch is, and how far it is to the next
_SLOW, _FAST, _GAINS, _LOSES, _TIMES = 8.0, 18.0, 1.8, 3.5, 5  # m/s, m/s²
_SETTLE = 2.0  # s


def across(seed: int) -> FrictionMap:
    """Patches as wide as the road, at random."""
    return _drawn(seed, lambda random: (-np.inf, np.inf))


def one_side(seed: int) -> FrictionMap:
    """Patches under the wheels of the left or of the right side, at random."""
    return _drawn(seed, lambda random: (0.0, np.inf) if random.integers(2) else (-np.inf, 0.0))


ROADS = {"across the road": across, "under one side": one_side}


def _drawn(seed: int, wide: Callable[[np.random.Generator], tuple[float, float]]) -> FrictionMap:
    random, place, found = np.random.default_rng(seed), _FIRST, []
    while place < _LENGTH:
        end = place + random.uniform(*_PATCH)
        found.append((place, end, *wide(random), random.uniform(*_ICE)))
        place = end + random.uniform(*_APART)
    return patches(_DRY, found)


def _prepared(vehicle: Vehicle, *, friction: FrictionMap) -> Manoeuvre:
    """Speeding up and braking, again and again."""
    time, speed = [0.0, 2.0], [_SLOW, _SLOW]
    for _ in range(_TIMES):
        for target, rate in ((_FAST, _GAINS), (_SLOW, _LOSES)):
            time += [time[-1] + (_FAST - _SLOW) / rate, time[-1] + (_FAST - _SLOW) / rate + 1.0]
            speed += [target, target]
    plan = SpeedPlan(tuple(time), tuple(speed))
    return Manoeuvre("patches", "patches of ice", plain(friction), _SLOW, Script.write(plan), straight())


@cache
def recorded(vehicle: str, road: str, seed: int, count: int) -> list[tuple[Log, Vehicle]]:
    """Recordings on one road of :data:`ROADS`, each with the vehicle file that an estimator is told."""
    scenario = Scenario("patches", "patches of ice", partial(_prepared, friction=ROADS[road](seed)))
    return [(without(log, SATELLITE), car) for log, car in on_plant(vehicle, scenario, count)]


def judged(logs: list[tuple[Log, Vehicle]], name: str) -> dict[str, float]:
    """Shares of the samples, %, in which the bounds hold the friction, and that are called excited."""
    said = batch([build(name, car, log.available) for log, car in logs], [log for log, _ in logs])
    return averaged([_of(estimates, log) for estimates, (log, _) in zip(said, logs, strict=True)])


def _of(estimates: Estimates, log: Log) -> dict[str, float]:
    counts = log.time - log.time[0] >= _SETTLE
    truth, bounds = reference("friction_peak", log.channels), interval(estimates, "friction_peak")
    if truth is None or bounds is None:
        raise InputError("no bounds of friction, or nothing to hold them against")
    parts = {
        "above lower bound": truth >= bounds[0],
        "below upper bound": truth <= bounds[1],
        "excited": estimates.validity == int(Validity.EXCITED),
    }
    return {key: 100 * float(np.mean(part[counts])) for key, part in parts.items()}


def study(seeds: int, count: int) -> Iterator[tuple[str, dict[str, float]]]:
    """Row after row: estimator, road and car, the mean over its recordings."""
    for name in NAMES:
        for road in ROADS:
            print(f"{name}, {road}", file=sys.stderr)
            for vehicle in VEHICLES:
                logs = [pair for seed in range(seeds) for pair in recorded(vehicle, road, seed, count)]
                yield f"{name}, {road}, {vehicle}", judged(logs, name)


def main() -> None:
    """Print the table."""
    use_compilation_cache()
    rows = dict(study(seeds=3, count=4))
    (near, far), (short, long), (least, most) = _APART, _PATCH, _ICE
    print(
        "# Patches of ice\n\n`python -m benchmarks.patches`: three roads of either kind, four recordings of"
        f" each; patches of {short:g} to {long:g} m every {near:g} to {far:g} m, of\na friction of {least} to"
        f" {most} on {_DRY}; speeding up by {_GAINS} and braking by {_LOSES} m/s² between {_SLOW:g} and"
        f" {_FAST:g} m/s. Shares of\nthe samples in per cent.\n"
    )
    print(table("mean friction of the four wheels", rows))


if __name__ == "__main__":
    main()
