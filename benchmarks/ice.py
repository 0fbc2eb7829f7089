"""Driving on ice and packed snow by the bus alone: wheels that spin and lock all the time.

``python -m benchmarks.ice`` prints the table of ``benchmarks/results/ice.md``: three cars on the multibody
plant with anti-lock and traction control, production sensors, vehicle files that are off by 5 to 10 %.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from benchmarks.accuracy.scenarios import Scenario
from benchmarks.by_bus import planned, rounds, study
from benchmarks.real_logs import table

from roadstate.core.constants import GRAVITY
from roadstate.core.numerics import use_compilation_cache
from roadstate.sim.manoeuvres import Manoeuvre
from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.vehicles import Vehicle

_ROUNDS = 3
_USED = 0.6  # of the friction, to speed up and to slow down
_QUANTITIES = {
    "speed, m/s": "speed",
    "grade, %": "grade",
    "used friction": "friction_used",
    "F_x front, N": "force_x_front",
}


class Town(NamedTuple):
    """Speeding up and slowing down again.

    Attributes:
        friction: of the road.
        slow, fast: between which speeds, m/s.
    """

    friction: float
    slow: float
    fast: float

    def scenario(self) -> Scenario:
        """For the plant."""
        return Scenario(f"ice-{self.friction:g}", f"on {self.friction:g}", partial(_prepared, town=self))


DRIVES = {
    "wet ice, 0.07": Town(0.07, 3.0, 7.0),
    "ice, 0.1": Town(0.1, 3.0, 8.0),
    "ice, 0.15": Town(0.15, 4.0, 10.0),
    "packed snow, 0.25": Town(0.25, 4.0, 14.0),
}
"""What is driven, by what is said of it."""


def _prepared(vehicle: Vehicle, *, town: Town) -> Manoeuvre:
    lasts = (town.fast - town.slow) / (_USED * GRAVITY * town.friction)
    plan = rounds(2.0, ((lasts, town.fast), (1.0, town.fast), (lasts, town.slow), (1.0, town.slow)), _ROUNDS)
    return planned("ice", make_road([Bend(3000.0)], friction=uniform(town.friction)), plan)


def main() -> None:
    """Print the table."""
    use_compilation_cache()
    print(
        "# Ice\n\n`python -m benchmarks.ice`: level roads of ice and packed snow, on which cars speed up and"
        f" slow down again with\n{100 * _USED:g} % of the friction, {_ROUNDS} times: a car that is driven at"
        " one axle spins its wheels then, and brakes that act\nat the front mostly lock them. Eight drives"
        " each. RMSE, and shares (per cent) of samples within the 95 %\ninterval, and with the friction above"
        " its lower and below its upper 5 % bound.\n"
    )
    rows: dict[str, dict[str, float]] = {}
    for title, town in DRIVES.items():
        rows |= study({title: town.scenario()}, _QUANTITIES, town.friction, count=8)
    print(table("joint, bus alone", rows))


if __name__ == "__main__":
    main()
