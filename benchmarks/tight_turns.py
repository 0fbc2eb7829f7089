"""Roundabouts, hairpins, a car park's ramp, parking spaces, and brakes in a bend, by `joint`.

``python -m benchmarks.tight_turns`` prints the table of ``benchmarks/results/tight_turns.md``: cars on the
multibody plant, production sensors without satellites, vehicle files that are off by 5 to 10 %, a dry road.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from benchmarks.accuracy.scenarios import Scenario
from benchmarks.by_bus import incline, planned, study
from benchmarks.real_logs import table
from numpy.typing import NDArray

from roadstate.core.numerics import use_compilation_cache
from roadstate.sim.manoeuvres import Manoeuvre, Script
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.roads.centreline import Along, Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle

Array = NDArray[np.floating[Any]]
FRICTION = 0.85
_ROUNDABOUT, _CIRCUITS = 20.0, 2  # m, and how often
_HAIRPIN, _HAIRPINS = 12.0, 6  # likewise
_RAMP = 9.0  # m
# s, and share of the lock, to the left
_STEERED = (
    np.array([0.0, 6, 9, 12, 15, 22, 25, 30, 33, 40]),
    np.array([0.0, 0, 1, 1, -1, -1, 0.8, 0.8, -1, 0]),
)
_QUANTITIES = {
    "grade, %": "grade",
    "v_y, m/s": "velocity_y",
    "F_y front, N": "force_y_front",
    "rear": "force_y_rear",
}


def roundabouts(vehicle: Vehicle) -> Manoeuvre:
    """To the right, around to the left, and out to the right: each within 6 m, .9 s."""
    inward, around = -1 / (1.2 * _ROUNDABOUT), 1 / _ROUNDABOUT
    bends = [Bend(80.0)]
    for _ in range(_CIRCUITS):
        turns = [Bend(6, 0, inward), Bend(10, inward), Bend(6, inward, around)]
        back = [Bend(6, around, inward), Bend(10, inward), Bend(6, inward, 0)]
        bends += [*turns, Bend(60, around), *back, Bend(80.0)]
    road = make_road([*bends, Bend(200.0)], friction=uniform(FRICTION))
    return planned("roundabouts", road, SpeedPlan.constant(7.0, 48.0))


def hairpins(vehicle: Vehicle, *, slope: float) -> Manoeuvre:
    """By turns to the right and to the left, 12 m from the middle, on a road that climbs or falls."""
    bends = [Bend(60.0)]
    for i in range(_HAIRPINS):
        sharp = (1 if i % 2 else -1) / _HAIRPIN
        bends += [Bend(8.0, 0.0, sharp), Bend(30.0, sharp), Bend(8.0, sharp, 0.0), Bend(30.0)]
    road = make_road([*bends, Bend(200.0)], friction=uniform(FRICTION), height=_climb(slope))
    return planned("hairpins", road, SpeedPlan.constant(6.0, 80.0))


def ramp(vehicle: Vehicle) -> Manoeuvre:
    """Up the ramp of a car park: twice around to the left, 9 m from the middle, 11 % steep."""
    bends = [Bend(60.0), Bend(10, 0, 1 / _RAMP), Bend(130, 1 / _RAMP)]
    road = make_road(bends, friction=uniform(FRICTION), height=_climb(0.11))
    return planned("ramp", road, SpeedPlan.constant(3.5, 50.0))


def trail_braking(vehicle: Vehicle) -> Manoeuvre:
    """Braked for four seconds in a bend of .7 g."""
    road = make_road([Bend(120.0), Bend(40, 0, 1 / 80), Bend(900, 1 / 80)], friction=uniform(FRICTION))
    plan = SpeedPlan((0, 20), (23.0, 23.0))

    def brake(time: Array) -> Array:
        return np.interp(time, [12, 12.5, 16, 17], [0, 0.35, 0.35, 0])

    script = Script.write(plan, pedals_from=12.0, brake=brake)
    return Manoeuvre("trail", "trail braking", road, 23.0, script, straight())


def parking(vehicle: Vehicle, *, slope: float) -> Manoeuvre:
    """Out of a space backward, lock to lock, at 1 to 3 m/s; steered at rest, and away forward.

    On a plane: where it is tilted, the slope along the car turns under it.
    """
    wheel = 15.0 * 0.4 if vehicle.steering is None else 0.4 * vehicle.steering.ratio

    def steering_wheel(time: Array) -> Array:
        return wheel * np.interp(time, _STEERED[0], _STEERED[1])

    def throttle(time: Array) -> Array:
        begins = ((time > 4) & (time < 8)) | ((time > 26) & (time < 30))
        goes_on = ((time > 8) & (time < 16)) | ((time > 30) & (time < 40))
        return np.where(begins, 0.14, np.where(goes_on, 0.05, 0.0))

    def brake(time: Array) -> Array:
        return np.where(time < 3, 0.3, np.where(((time > 17) & (time < 25)) | (time > 42), 0.12, 0.0))

    script = Script.write(
        SpeedPlan((0.0, 50.0), (0.0, 0.0)),
        steering_wheel=steering_wheel,
        throttle=throttle,
        brake=brake,
        gear=lambda time: np.where(time < 20, -1.0, 1.0),
        pedals_from=0.0,
    )
    road = make_road([Bend(3000.0)], friction=uniform(FRICTION), height=incline(slope))
    return Manoeuvre("parking", "parking", road, 0.0, script, straight())


DRIVES = {
    "roundabouts": Scenario("roundabouts", "roundabouts of 20 m", roundabouts),
    "hairpins, 8 % up": Scenario("hairpins", "hairpins of 12 m, uphill", partial(hairpins, slope=0.08)),
    "10 % down": Scenario("hairpins-down", "hairpins of 12 m, downhill", partial(hairpins, slope=-0.1)),
    "ramp": Scenario("ramp", "a car park's ramp", ramp),
    "parking": Scenario("parking", "out of a parking space", partial(parking, slope=0.0)),
    "6 % up": Scenario("parking-tilted", "out of one that is tilted", partial(parking, slope=0.06)),
    "trail braking": Scenario("trail", "braked in a bend of .7 g", trail_braking),
}


def _climb(slope: float) -> Along:
    """Level for 30 m, then within 20 m the slope that stays."""

    def height(s: Array) -> tuple[Array, Array]:
        rise = slope * np.clip((s - 30) / 20, 0, 1)
        return np.where(s < 50, rise * (s - 30) / 2, slope * (s - 40)), rise

    return height


def main() -> None:
    """Print the table."""
    use_compilation_cache()
    rows = dict(study(DRIVES, _QUANTITIES, FRICTION, count=8))
    print(
        "# Tight turns\n\n`python -m benchmarks.tight_turns`: roundabouts of 20 m, hairpins of 12 m on a"
        " slope, a ramp of 9 m (11 %), a\nparking space left lock to lock, level and tilted by 6 %, and"
        f" brakes in a bend of .7 g, on a road of {FRICTION}; eight\nrecordings each. RMSE, and shares (per"
        " cent) of samples within the 95 % interval, and with the friction above its\nlower and below its"
        " upper 5 % bound.\n"
    )
    print(table("joint, bus alone", rows))


if __name__ == "__main__":
    main()
