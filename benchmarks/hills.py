"""Roads that rise and fall, which make a car heavier and lighter by turns, and steep streets, by `joint`.

``python -m benchmarks.hills`` prints the table of ``benchmarks/results/hills.md``: cars on the multibody
plant, production sensors without satellites, vehicle files that are off by 5 to 10 %, a dry road.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from benchmarks.accuracy.scenarios import Scenario
from benchmarks.by_bus import incline, planned, rounds, study
from benchmarks.real_logs import table
from numpy.typing import NDArray

from roadstate.core.numerics import use_compilation_cache
from roadstate.sim.manoeuvres import Manoeuvre
from roadstate.sim.roads.centreline import Along, Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle

Array = NDArray[np.floating[Any]]
FRICTION = 0.8
HILLS, HUMPS = (0.6, 150.0), (1.2, 120.0)
"""m: how far waves of the road rise above and fall below their middle, and their length."""
_LEVEL = 80.0  # m of the road's start
_RADIUS, _TURNS = 110.0, 9  # m, and how many bends of 90 m a winding road has
_STEEP, _CORNER, _BLOCK, _CROSSING = 0.2, 15.0, 60.0, 25.0  # slope, and m, of a street that climbs and falls
_QUANTITIES = {
    "grade, %": "grade",
    "used friction": "friction_used",
    "load of a front wheel, N": "load_fl",
    "F_y front, N": "force_y_front",
    "v_y, m/s": "velocity_y",
}


def waves(height: float, length: float) -> Along:
    """Height and slope along a road that rises and falls by a sine."""

    def along(s: Array) -> tuple[Array, Array]:
        turn = 2 * np.pi / length
        x = turn * np.clip(s - _LEVEL, 0, None)
        return height * (1 - np.cos(x)), height * turn * np.sin(x)

    return along


def braked(vehicle: Vehicle, *, wave: tuple[float, float]) -> Manoeuvre:
    """Straight on: four times up to 24 m/s and, at 5 m/s², down to 12 again."""
    plan = rounds(2.0, ((6.0, 24.0), (1.0, 24.0), (2.4, 12.0), (1.0, 12.0)), 4)
    road = make_road([Bend(3000.0)], friction=uniform(FRICTION), height=waves(*wave))
    return planned("braked", road, plan)


def bend(vehicle: Vehicle) -> Manoeuvre:
    """A long one, driven at up to .45 g."""
    bends = [Bend(60.0), Bend(30.0, 0.0, 1 / _RADIUS), Bend(3000.0, 1 / _RADIUS)]
    road = make_road(bends, friction=uniform(FRICTION), height=waves(*HILLS))
    plan = SpeedPlan((0.0, 4.0, 12.0, 30.0, 34.0, 40.0), (14.0, 14.0, 21.5, 21.5, 15.0, 21.0))
    return planned("bend", road, plan)


def winding(vehicle: Vehicle) -> Manoeuvre:
    """Bends to the right and to the left by turns, at 17 m/s."""
    bends = [Bend(60.0)]
    for i in range(_TURNS):
        sharp = (1 if i % 2 else -1) / 90.0
        bends += [Bend(25.0, 0.0, sharp), Bend(40.0, sharp), Bend(25.0, sharp, 0.0)]
    road = make_road([*bends, Bend(400.0)], friction=uniform(FRICTION), height=waves(0.5, 140.0))
    return planned("winding", road, SpeedPlan.constant(17.0, 45.0))


def streets(vehicle: Vehicle) -> Manoeuvre:
    """Up and down by turns, with level crossings between, at 5 to 9 m/s, as in San Francisco."""
    at, slope, rise = [_LEVEL], [0.0], _STEEP
    for _ in range(8):
        for length, becomes in ((_CORNER, rise), (_BLOCK, rise), (_CORNER, 0.0), (_CROSSING, 0.0)):
            at.append(at[-1] + length)
            slope.append(becomes)
        rise = -rise
    plan = rounds(4.0, ((4.0, 9.0), (2.0, 9.0), (4.0, 5.0), (3.0, 5.0)), 10)
    fine = np.arange(0.0, 3000.0, 0.1)
    inclines = np.interp(fine, at, slope)
    heights = np.concatenate([[0.0], np.cumsum(0.05 * (inclines[1:] + inclines[:-1]))])
    road = make_road(
        [Bend(3000.0)],
        friction=uniform(FRICTION),
        height=lambda s: (np.interp(s, fine, heights), np.interp(s, fine, inclines)),
    )
    return planned("streets", road, plan)


def start(vehicle: Vehicle) -> Manoeuvre:
    """From rest on a slope of 22 %, down to a walking pace, and on."""
    road = make_road([Bend(3000.0)], friction=uniform(FRICTION), height=incline(0.22))
    plan = SpeedPlan((0, 4, 12, 22, 26, 34, 40, 50), (0, 0, 9, 9, 2, 2, 8, 8))
    return planned("start", road, plan)


DRIVES = {
    "hills, braked": Scenario("hills-braked", "hills of 150 m, braked", partial(braked, wave=HILLS)),
    "hills, in a bend": Scenario("hills-bend", "hills of 150 m, in a bend", bend),
    "hills, winding": Scenario("hills-winding", "hills of 140 m, on a winding road", winding),
    "humps, braked": Scenario("humps-braked", "humps of 120 m, braked", partial(braked, wave=HUMPS)),
    "streets": Scenario("streets", "streets of 20 %, up and down", streets),
    "start": Scenario("start", "from rest on 22 %", start),
}


def main() -> None:
    """Print the table."""
    use_compilation_cache()
    rows = dict(study(DRIVES, _QUANTITIES, FRICTION, count=8))
    print(
        "# Hills\n\n`python -m benchmarks.hills`: roads that rise and fall by .6 m about their middle every"
        " 150 m (4 % of weight come\nand go at 20 m/s), or by 1.2 m every 120 m (13 %); streets that climb"
        " and fall by 20 %, turning up and down within\n15 m, at 5 to 9 m/s; a start on 22 %. On a road of"
        f" {FRICTION}; eight recordings each. RMSE, and shares (per cent)\nof samples within the 95 %"
        " interval, and with the friction above its lower and below its upper 5 % bound.\n"
    )
    print(table("joint, bus alone", rows))


if __name__ == "__main__":
    main()
