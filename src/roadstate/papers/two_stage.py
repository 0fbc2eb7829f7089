"""Paper 000: friction of a heavy truck in two stages, by an extended H∞ filter and an adaptive UKF."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from math import pi
from typing import Any

import numpy as np

from roadstate.core import Estimates, Log, reference
from roadstate.estimators import Estimator, build
from roadstate.estimators.friction import normalized_tire
from roadstate.papers.base import Build, Cell, Condition, Figure, Measure, Method, Paper
from roadstate.run import scan
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.manoeuvres.base import Manoeuvre
from roadstate.sim.plant.base import Plant
from roadstate.sim.plant.planar import PlanarPlant
from roadstate.sim.sensors import InertialUnit, Probe, SensorSuite, sensor_preset
from roadstate.vehicles import Vehicle, load_vehicle

_DEG = pi / 180
# 1σ of each sample, chosen such that on asphalt the tire model's forces are about as wrong as in table 2
_ACCEL = 0.05  # m/s²
_YAW_RATE = 0.026  # rad/s
_YAW_ACCEL = 0.05  # rad/s²
_VELOCITY = 0.003  # m/s, v_x and v_y
_WHEEL = 0.006  # rad/s
_STEER = 0.06 * _DEG
_STD = {
    "accel_x": _ACCEL,
    "accel_y": _ACCEL,
    "yaw_rate": _YAW_RATE,
    "yaw_accel": _YAW_ACCEL,
    "speed": _VELOCITY,
    "velocity_y": _VELOCITY,
    **{f"wheel_speed_{w}": _WHEEL for w in ("fl", "fr", "rl", "rr")},
    "steer": _STEER,
}
_LOUDER = 9.0
"""How much the noise variances grow in the second half of a drive, where they do."""
_ROADS = {"asphalt": 0.85, "ice": 0.2}
_EXCITED = {"asphalt": 3.0, "ice": 5.0}
"""Seconds after which both axles have felt a lane change (the paper's figures 6 and 9: 1.63 s, over 5 s)."""
_AXLES = {
    "F_xf": "force_x_front",
    "F_xr": "force_x_rear",
    "F_yf": "force_y_front",
    "F_yr": "force_y_rear",
}
# rows as _AXLES: Dugoff, EHKF in N (tables 2 and 3)
_PRINTED = {
    "asphalt": ((29.61, 18.41), (388.52, 338.70), (800.92, 602.76), (1080.20, 306.06)),
    "ice": ((88.90, 45.58), (318.80, 171.54), (2797.50, 2420.70), (1745.30, 845.08)),
}
_BEST: dict[str, Any] = {
    "direct": True,
    "shared_walk": 1e-3,
    "own_walk": 3e-4,
    "steer_std": (_STEER, _STEER),
    "relaxes": False,
}
"""Of test-car sensors: the steering angle has no offset, the road stays nearly what it is, and forces follow
slip angles at once, as the paper's do."""
_LABORATORY = {"velocity_y", "yaw_accel"}
"""Channels that only a test car or a simulator has."""


def _suite() -> SensorSuite:
    accel, rate = Probe(noise=_ACCEL), Probe(noise=_YAW_RATE)
    return replace(
        sensor_preset("paper"),
        imu=InertialUnit(accel, rate),
        wheel_speed=Probe(noise=_WHEEL),
        road_wheel=Probe(noise=_STEER),
        kinematic=accel,
        velocity=Probe(noise=_VELOCITY),
        yaw_accel=Probe(noise=_YAW_ACCEL),
    )


def _truck() -> Vehicle:
    """The truck; its file tells the noise of the sensors before it grows, and that nothing else is wrong."""
    truck = load_vehicle("truck")
    noises = {
        "accel": {"noise_density": _ACCEL / 10, "bias": 0.0},
        "yaw_rate": {"noise": _YAW_RATE, "bias": 0.0},
        "yaw_accel": {"noise": _YAW_ACCEL},
        "speed": {"noise": _VELOCITY},
        "velocity_y": {"noise": _VELOCITY},
        "wheel_speed": {"noise": _WHEEL, "scale": 0.0},
    }
    sensors = {name: getattr(truck.sensors, name).model_copy(update=new) for name, new in noises.items()}
    return truck.model_copy(update={"sensors": truck.sensors.model_copy(update=sensors)})


def _matched(vehicle: Vehicle) -> Plant:
    """Seven degrees of freedom on the paper's tire; a body that neither pitches nor rolls."""
    still = vehicle.body.model_copy(update={"pitch_gradient": 0.0, "roll_gradient": 0.0})
    level = vehicle.model_copy(update={"body": still})
    return PlanarPlant.seven_dof(level, tire=normalized_tire(level))


def _simulators_accelerations(log: Log, random: np.random.Generator) -> Log:
    """Accelerations without gravity, as the paper's simulator prints them, where they are recorded."""
    printed = {a: log[f"kinematic_{a}"] for a in ("accel_x", "accel_y") if f"kinematic_{a}" in log.channels}
    return log.with_channels(printed)


def _louder(log: Log, random: np.random.Generator) -> Log:
    """The same, with more noise on everything in the second half."""
    log = _simulators_accelerations(log, random)
    late = np.arange(len(log)) >= len(log) // 2
    more = {
        name: log[name] + late * std * np.sqrt(_LOUDER - 1) * random.standard_normal(len(log))
        for name, std in _STD.items()
        if name in log.channels
    }
    return log.with_channels(more)


def _drive(name: str, friction: float) -> Callable[[Vehicle], Manoeuvre]:
    return lambda vehicle: manoeuvre(name).prepare(vehicle, friction=friction)


def _condition(road: str, *, louder: bool) -> Condition:
    what = {
        "asphalt": ("acceleration-lane-changes", "20 to 70 km/h with lane changes, asphalt; path chosen"),
        "ice": ("ice-lane-change", "irregular lane changes at 30 km/h, ice; path and friction 0.2 chosen"),
    }[road]
    return Condition(
        name=f"{road}-noisy" if louder else road,
        title=what[1] + (f"; noise variance ×{_LOUDER:g} from half of the drive on" if louder else ""),
        vehicle=_truck(),
        manoeuvre=_drive(what[0], _ROADS[road]),
        matched=_matched,
        sensors=_suite(),
        disturb=_louder if louder else _simulators_accelerations,
    )


def _build(**options: Any) -> Build:
    return lambda vehicle, available: build("two-stage", vehicle, available, **options)


def _best(**options: Any) -> Build:
    """Our best settings; with production sensors the usual ones, and a file that speaks of such sensors."""

    def made(vehicle: Vehicle, available: Collection[str]) -> Estimator[Any]:
        if set(available) >= _LABORATORY:
            return build("two-stage", vehicle, available, **_BEST, **options)
        usual = vehicle.model_copy(update={"sensors": load_vehicle("truck").sensors})
        return build("two-stage", usual, available, **options)

    return made


def _method(*, printed: dict[str, Any], best: dict[str, Any]) -> Method:
    return Method(_build(as_printed=True, **printed), _best(**best))


def _direct_options(road: str) -> dict[str, Any]:
    return {"smooths": False, "known_friction": _ROADS[road]}


def _rmse(quantity: str) -> Measure:
    def measure(estimates: Estimates, log: Log) -> float:
        truth = reference(quantity, log.channels)
        assert truth is not None
        return float(np.sqrt(np.mean((estimates.values[quantity] - truth) ** 2)))

    return measure


def _ratio(road: str, quantity: str) -> Measure:
    """RMSE over that of the tire model by itself, for the file's vehicle and the true friction."""
    rmse = _rmse(quantity)

    def measure(estimates: Estimates, log: Log) -> float:
        rival = _best(**_direct_options(road))(_truck(), log.available)
        return rmse(estimates, log) / rmse(scan(rival, log), log)

    return measure


def _relative(road: str, quantity: str) -> Measure:
    """Mean relative error in per cent, from when both axles are excited."""

    def measure(estimates: Estimates, log: Log) -> float:
        truth = reference(quantity, log.channels)
        assert truth is not None
        late = log.time - log.time[0] >= _EXCITED[road]
        return float(100 * np.mean(np.abs(estimates.values[quantity] / truth - 1)[late]))

    return measure


def _cells() -> tuple[Cell, ...]:
    cells = []
    for table, road in (("table 2", "asphalt"), ("table 3", "ice")):
        for (row, quantity), (dugoff, ehkf) in zip(_AXLES.items(), _PRINTED[road], strict=True):
            for column, unit, paper, method, measure in (
                ("Dugoff model", "N", dugoff, f"direct-{road}", _rmse(quantity)),
                ("EHKF", "N", ehkf, f"ehkf-{road}", _rmse(quantity)),
                ("ratio", "-", round(ehkf / dugoff, 3), f"ehkf-{road}", _ratio(road, quantity)),
                ("EHKF, estimated μ", "N", None, "aukf", _rmse(quantity)),
            ):
                cells.append(Cell(table, row, column, unit, paper, road, method, measure))
    for road in _ROADS:
        for condition in (road, f"{road}-noisy"):
            for axle in ("front", "rear"):
                measure = _relative(road, f"friction_peak_{axle}")
                for column in ("UKF", "AUKF"):
                    row = f"{condition}, {axle}"
                    cells.append(Cell("friction", row, column, "%", None, condition, column.lower(), measure))
    return tuple(cells)


def _figures() -> tuple[Figure, ...]:
    figures = []
    for forces, friction, road in ((5, 6, "asphalt"), (8, 9, "ice")):
        for letter, (name, quantity) in zip("abcd", _AXLES.items(), strict=True):
            shown = (f"direct-{road}", f"ehkf-{road}")
            figures.append(Figure(f"fig-{forces}{letter}", f"{name} on {road}", road, quantity, shown))
        for letter, axle in zip("ab", ("front", "rear"), strict=True):
            title = f"friction of the {axle} wheels on {road}"
            quantity = f"friction_peak_{axle}"
            figures.append(Figure(f"fig-{friction}{letter}", title, road, quantity, ("ukf", "aukf")))
    return tuple(figures)


PAPER = Paper(
    name="two-stage",
    title=(
        "Zhang, Zhang, Zhang, Meng & Wang, A two-stage adaptive identification framework of tire road "
        "friction coefficient considering the effect of multiple unknown measurement noises"
    ),
    conditions=tuple(_condition(road, louder=louder) for louder in (False, True) for road in _ROADS),
    methods={
        **{f"direct-{r}": _method(printed=_direct_options(r), best=_direct_options(r)) for r in _ROADS},
        **{
            f"ehkf-{r}": _method(printed={"known_friction": mu}, best={"known_friction": mu})
            for r, mu in _ROADS.items()
        },
        "ukf": _method(printed={"adapts": False}, best={"adapts": False}),
        "aukf": _method(printed={}, best={}),
    },
    cells=_cells(),
    figures=_figures(),
    page="docs/papers/two-stage.md",
)
