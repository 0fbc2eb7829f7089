"""Driving on ice and packed snow by the bus alone: wheels that spin and lock all the time.

``python -m benchmarks.ice`` prints the table of ``benchmarks/results/ice.md``: three cars on the multibody
plant with anti-lock and traction control, production sensors, vehicle files that are off by 5 to 10 %.
"""

from __future__ import annotations

from functools import partial

from benchmarks.accuracy.scenarios import Scenario
from benchmarks.by_bus import planned, rounds, study
from benchmarks.real_logs import table

from roadstate.core.constants import GRAVITY
from roadstate.core.numerics import use_compilation_cache
from roadstate.sim.manoeuvres import Manoeuvre
from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle

_ROUNDS = 3
_USED = (0.6, 0.75)  # of the friction, to speed up and to slow down
_BENDS = 0.8  # and in a bend
_QUANTITIES = {
    "speed, m/s": "speed",
    "grade, %": "grade",
    "used friction": "friction_used",
    "v_y, m/s": "velocity_y",
}


def town(vehicle: Vehicle, *, friction: float, slow: float, fast: float) -> Manoeuvre:
    """Speeding up and slowing down again, straight on.

    Args:
        vehicle: any.
        friction: of the road.
        slow, fast: between which speeds, m/s.
    """
    gains, slows = ((fast - slow) / (used * GRAVITY * friction) for used in _USED)
    plan = rounds(2.0, ((gains, fast), (1.0, fast), (slows, slow), (1.0, slow)), _ROUNDS)
    return planned("town", make_road([Bend(3000.0)], friction=uniform(friction)), plan)


def bend(vehicle: Vehicle, *, friction: float, radius: float) -> Manoeuvre:
    """A long one to the left, taken ever faster, until it takes four fifths of the friction."""
    bends = [Bend(60.0), Bend(25.0, 0.0, 1 / radius), Bend(3000.0, 1 / radius)]
    fast = (_BENDS * GRAVITY * friction * radius) ** 0.5
    plan = SpeedPlan((0.0, 10.0, 20.0, 40.0), (0.7 * fast, 0.7 * fast, fast, fast))
    return planned("bend", make_road(bends, friction=uniform(friction)), plan)


def _on(friction: float, slow: float, fast: float) -> tuple[Scenario, float]:
    drive = partial(town, friction=friction, slow=slow, fast=fast)
    return Scenario(f"ice-{friction:g}", f"on {friction:g}", drive), friction


DRIVES = {
    "wet ice, 0.07": _on(0.07, 3.0, 7.0),
    "ice, 0.1": _on(0.1, 3.0, 8.0),
    "ice, 0.15": _on(0.15, 4.0, 10.0),
    "packed snow, 0.25": _on(0.25, 4.0, 14.0),
    "bend of 60 m, 0.15": (Scenario("ice-bend", "a bend", partial(bend, friction=0.15, radius=60.0)), 0.15),
}
"""What is driven, and the friction of the road, by what is said of it."""


def main() -> None:
    """Print the table."""
    use_compilation_cache()
    print(
        "# Ice\n\n`python -m benchmarks.ice`: level roads of ice and packed snow, on which cars speed up by"
        f" {100 * _USED[0]:g} and slow down by {100 * _USED[1]:g} %\nof the friction, {_ROUNDS} times: a car"
        " that is driven at one axle spins its wheels then, and brakes that act at the front\nmostly lock"
        f" them; and a bend that takes {100 * _BENDS:g} %. Eight recordings each. RMSE, and shares (per cent)"
        " of samples within\nthe 95 % interval, and with the friction above its lower and below its upper"
        " 5 % bound. Where no wheel slips, the\nlower bound is what a road of any kind holds that holds what"
        " has been used: of roads as slippery as these it says\ntoo much.\n"
    )
    rows: dict[str, dict[str, float]] = {}
    for title, (drive, friction) in DRIVES.items():
        rows |= study({title: drive}, _QUANTITIES, friction, count=8)
    print(table("joint, bus alone", rows))


if __name__ == "__main__":
    main()
