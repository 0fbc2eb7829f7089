"""Friction by a limited-memory adaptive EKF, with EKF and UKF, and without each of its ideas (paper 004)."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any

from roadstate.estimators import Estimator, build
from roadstate.estimators.lm_aekf import PRINTED
from roadstate.papers.base import Build, Cell, Condition, Figure, Measure, Method, Paper
from roadstate.papers.friction_measures import (
    NEVER,
    Start,
    at,
    chatter,
    convergence_time,
    error_bound,
    final_error,
    flat_car,
    mean_error,
    new_surface,
    steering_begins,
)
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.manoeuvres.base import KMH, Manoeuvre
from roadstate.sim.manoeuvres.script import Script
from roadstate.sim.sensors import sensor_preset
from roadstate.sim.sensors.inertial import InertialUnit
from roadstate.sim.sensors.probe import Probe
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle, load_vehicle

_NOISE = 0.05  # m/s² and rad/s²
_SETTLED = 1.0  # s
_TOLERANCE = 0.05
_LAST = 1.0  # s
_BEGUN = 1.0  # s: the drives on a split road are under way
_THROTTLE = 0.2
_LABORATORY = {"velocity_y", "yaw_accel"}
"""Channels that only a test car or a simulator has."""
_RIGHT_NOISE = {
    "grouping": "left_right",
    "mean": 0.5,
    "shared_std": 0.3,
    "own_std": 0.1,
    "own_walk": 0.0,
    "sensor_std": _NOISE,
    "uses_rate": False,
    "direct": True,
}
"""Best where slips come without noise: the sensors' true noise, a friction for each side, a wide start."""
_IDEAS = {"no-memory": {"memory": None}, "no-fading": {"fading": None}, "no-fuzzy": {"fuzzy": None}}
_MEMORY = {"memory": 100, "least_share": 0.5}


def _sensors() -> Any:
    return replace(
        sensor_preset("ideal"), imu=InertialUnit(Probe(noise=_NOISE)), yaw_accel=Probe(noise=_NOISE)
    )


def _drive(name: str, speed: float) -> Callable[[Vehicle], Manoeuvre]:
    return lambda vehicle: manoeuvre(name).prepare(vehicle, speed=speed * KMH, friction=0.8)


def _pulling_away(vehicle: Vehicle) -> Manoeuvre:
    """The split road with a throttle that both sides can put down."""
    steady = manoeuvre("split-road").prepare(vehicle)
    script = Script.write(SpeedPlan.constant(steady.speed, 8.0), throttle=_THROTTLE, pedals_from=_BEGUN)
    return replace(steady, name="split-road-acceleration", script=script)


def _condition(name: str, what: str, drive: Callable[[Vehicle], Manoeuvre]) -> Condition:
    title = (
        f"{what}; white noise of 0.05 m/s² and 0.05 rad/s² (chosen) on what is measured, none on the slips; "
        "the car's figures are chosen (preset in-wheel-ev)"
    )
    return Condition(name, title, load_vehicle("in-wheel-ev"), drive, flat_car, _sensors())


_CONDITIONS = (
    _condition(
        "joint",
        "§4.1: half throttle from 30 km/h, 25 m of friction 0.2, then 0.8",
        _drive("joint-road-acceleration", 30.0),
    ),
    _condition(
        "lane-change",
        "§4.2: double lane change at 85 km/h on a friction of 0.8, the track of paper ukf-pf",
        _drive("double-lane-change", 85.0),
    ),
    _condition(
        "split", "§4.3: 40 km/h, friction 0.2 on the left and 0.8 on the right", _drive("split-road", 40.0)
    ),
    _condition(
        "split-accelerating",
        "ours: the same road, a fifth of the throttle from 1 s on, so that both sides are asked for a force",
        _pulling_away,
    ),
)


def _printed(name: str, **filter_options: Any) -> Build:
    options = PRINTED._asdict() if name == "friction-ukf" else {"as_printed": True}
    return lambda vehicle, available: build(
        name, vehicle, available, **options, filter_options=filter_options
    )


def _best(name: str, walk: float, **filter_options: Any) -> Build:
    def made(vehicle: Vehicle, available: Collection[str]) -> Estimator[Any]:
        if not set(available) >= _LABORATORY:
            return build(name, vehicle, available, grouping="left_right", filter_options=filter_options)
        options = {**_RIGHT_NOISE, "shared_walk": walk}
        return build(name, vehicle, available, **options, filter_options=filter_options)

    return made


_RIVAL_WALK = 0.05
_METHODS = {
    "lm-aekf": Method(_printed("lm-aekf"), _best("lm-aekf", 0.0, **_MEMORY)),
    "ekf": Method(_printed("friction-ekf"), _best("friction-ekf", _RIVAL_WALK)),
    "ukf": Method(_printed("friction-ukf"), _best("friction-ukf", _RIVAL_WALK)),
    **{
        f"lm-aekf-{name}": Method(
            _printed("lm-aekf", **without), _best("lm-aekf", 0.0, **{**_MEMORY, **without})
        )
        for name, without in _IDEAS.items()
    },
}


def _rows(table: str, condition: str, start: Start, side: str = "", *, bounded: bool = False) -> list[Cell]:
    quantity = f"friction_peak_{side}" if side else "friction_peak"
    label = f"{side} " if side else ""
    columns: tuple[tuple[str, str, Measure], ...] = (
        ("converged", "s", convergence_time(start, _TOLERANCE, quantity)),
        ("error", "%", mean_error(start, _SETTLED, quantity)),
        ("final error", "%", final_error(_LAST, quantity)),
        ("chatter", "1/s", chatter(start, _SETTLED, quantity)),
    )
    bound = error_bound(_best("friction-ekf", 0.0), start, _SETTLED, quantity) if bounded else None
    return [
        Cell(
            table,
            method,
            f"{label}{column}",
            unit,
            None,
            condition,
            method,
            measure,
            bound if column == "error" else None,
            NEVER if column == "converged" else "not finite",
        )
        for method in _METHODS
        for column, unit, measure in columns
    ]


def _cells() -> tuple[Cell, ...]:
    found = _rows("§4.1 joint road", "joint", new_surface)
    found += _rows("§4.2 double lane change", "lane-change", steering_begins, bounded=True)
    for side in ("left", "right"):
        found += _rows("§4.3 split road, constant speed", "split", at(_BEGUN), side, bounded=True)
    for side in ("left", "right"):
        found += _rows("split road, accelerating", "split-accelerating", at(_BEGUN), side, bounded=True)
    return tuple(found)


_DRAWN = ("ekf", "ukf", "lm-aekf")
PAPER = Paper(
    name="lm-aekf",
    title="Friction by a limited-memory adaptive extended Kalman filter (LM-AEKF)",
    conditions=_CONDITIONS,
    methods=_METHODS,
    cells=_cells(),
    figures=(
        Figure("fig-4", "friction, joint road", "joint", "friction_peak", _DRAWN),
        Figure("fig-7", "friction, double lane change", "lane-change", "friction_peak", _DRAWN),
        Figure("fig-9", "friction, left side of a split road", "split", "friction_peak_left", _DRAWN),
        Figure("fig-10", "friction, right side of a split road", "split", "friction_peak_right", _DRAWN),
    ),
    page="docs/papers/lm-aekf.md",
)
