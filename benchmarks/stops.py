"""Stops under anti-lock brakes: what `joint` knows of speed and slope while hardly a wheel rolls.

``python -m benchmarks.stops`` prints the tables of ``benchmarks/results/stops.md``: three cars on the
multibody plant, automotive sensors, vehicle files that are off by 5 to 10 %.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
from benchmarks.accuracy.measures import interval
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE, VEHICLES, Scenario, on_plant, straight_ahead
from benchmarks.real_logs import table

from roadstate.core import Estimates, Log, reference
from roadstate.core.constants import GRAVITY
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build
from roadstate.run import batch
from roadstate.sim.speed_plan import SpeedPlan

_SPEED = 28.0  # m/s
_BRAKE = 0.9  # of the pedal: more than any of the roads bears
_FRICTION = (0.2, 0.5, 0.9)
_STEADY = (1.0, 20.0)  # s of steady speed before, in which accelerometer and wheels are compared
_FILES = 4
_SLOW = 5.0  # m/s, below which a speed is told for itself
_KINDS = {"bus": SATELLITE, "receiver": ()}


def stop(friction: float, steady: float) -> Scenario:
    """From 28 m/s to a walk on a level road.

    Args:
        friction: of the road.
        steady: s before the brakes act.
    """
    lasts = steady + 1.25 * _SPEED / (friction * GRAVITY)
    plan = SpeedPlan.constant(_SPEED, lasts)
    drive = straight_ahead("stop", friction, plan, brake=_BRAKE, pedals_from=steady)
    return Scenario(f"stop-{friction:g}-{steady:g}", f"from 28 m/s on {friction:g}", drive)


def judged(said: list[Estimates], logs: list[Log], steady: float) -> dict[str, float]:
    """Of speed and slope while the brakes act: RMSE, and shares within the 95 % interval."""
    found: dict[str, list[np.ndarray]] = {"speed": [], "grade": [], "slow": []}
    inside: dict[str, list[np.ndarray]] = {"speed": [], "grade": []}
    for estimates, log in zip(said, logs, strict=True):
        brakes = log.time - log.time[0] >= steady
        for quantity in inside:
            truth, ends = reference(quantity, log.channels), interval(estimates, quantity)
            assert truth is not None
            assert ends is not None
            found[quantity].append((estimates.values[quantity] - truth)[brakes])
            inside[quantity].append(((ends[0] <= truth) & (truth <= ends[1]))[brakes])
        found["slow"].append(found["speed"][-1][log["ref_velocity_x"][brakes] < _SLOW])
    errors = {name: np.concatenate(parts) for name, parts in found.items()}
    shares = {name: 100 * float(np.mean(np.concatenate(parts))) for name, parts in inside.items()}
    return {
        "speed": float(np.sqrt(np.mean(errors["speed"] ** 2))),
        "below 5 m/s": float(np.sqrt(np.mean(errors["slow"] ** 2))),
        "inside": shares["speed"],
        "slope": 100 * float(np.sqrt(np.mean(errors["grade"] ** 2))),
        "slope inside": shares["grade"],
    }


def study(steady: float) -> Iterator[tuple[str, str, dict[str, float]]]:
    """Row after row: channels, then friction and car."""
    for friction in _FRICTION:
        for vehicle in VEHICLES:
            print(f"{steady:g} s, {friction:g}, {vehicle}", file=sys.stderr)
            logs = on_plant(vehicle, stop(friction, steady), _FILES)
            for kind, lacking in _KINDS.items():
                own = [without(log, lacking) for log, _ in logs]
                built = [build("joint", car, own[0].available) for _, car in logs]
                yield kind, f"{friction:g}, {vehicle}", judged(batch(built, own), own, steady)


def main() -> None:
    """Print the tables."""
    use_compilation_cache()
    print(
        "# Stops under anti-lock brakes\n\n`python -m benchmarks.stops`: from 28 m/s to a walk on level roads"
        " of three frictions, four vehicle files each,\nafter one second of steady speed, or twenty. `joint`,"
        " with the bus alone and with a receiver. RMSE while the brakes\nact of the speed (m/s; and where it"
        " is below 5 m/s) and of the slope (per cent), and shares (per cent) of samples\nwithin the 95 %"
        " interval.\n"
    )
    for steady in _STEADY:
        rows = list(study(steady))
        for kind in _KINDS:
            own = {name: row for told, name, row in rows if told == kind}
            print(table(f"{kind}, after {steady:g} s", own))


if __name__ == "__main__":
    main()
