"""Road grade by two stacked UKFs on tire forces, with its rivals KMBE and DEBE (paper 002)."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from roadstate.core import Estimates, Log
from roadstate.estimators import Estimator, build
from roadstate.metrics import evaluate
from roadstate.papers.base import Build, Cell, Condition, Figure, Measure, Method, Paper
from roadstate.papers.grade_bound import SIGNALS, least_rmse
from roadstate.papers.tfobe_printed import PrintedSlope, PrintedTFOBE
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.manoeuvres.base import Manoeuvre
from roadstate.sim.plant.planar import PlanarPlant
from roadstate.sim.sensors import sensor_preset
from roadstate.vehicles import Vehicle, load_vehicle

SETTLED = 5.0
"""s: the paper leaves out "the first several seconds"."""
_LABORATORY = {
    "kinematic_accel_x",
    "kinematic_accel_y",
    "speed",
    "velocity_y",
    "yaw_accel",
    "altitude",
    "vertical_speed",
}
"""Channels that the best forms leave alone: a simulator's, or a satellite receiver's."""


def as_fitted(vehicle: Vehicle) -> Vehicle:
    """The vehicle file of a car with the sensors of the preset ``paper``, whose figures are known to 1 %.

    The noises are the preset's; a torque's 10 N·m a sample at 100 Hz is white, and the file's figure is of
    a noise that lasts 0.1 s.
    """
    sensors, prior = vehicle.sensors, vehicle.prior
    fitted = {
        "accel": sensors.accel.model_copy(update={"noise_density": 0.005, "bias": 0.01}),
        "wheel_speed": sensors.wheel_speed.model_copy(update={"noise": 0.05, "scale": 0.002}),
        "yaw_rate": sensors.yaw_rate.model_copy(update={"noise": 0.0035, "bias": 1e-4}),
        "wheel_torque": sensors.wheel_torque.model_copy(
            update={"noise": 3.2, "bias": 0.0, "relative": 0.002}
        ),
    }
    known = {"mass_relative": 0.01, "drag_relative": 0.02, "wind_std": 0.0, "rolling_resistance_std": 0.0005}
    return vehicle.model_copy(
        update={
            "sensors": sensors.model_copy(update=fitted),
            "prior": prior.model_copy(update=known),
        }
    )


def _best(name: str) -> Build:
    def compose(vehicle: Vehicle, available: Collection[str]) -> Estimator[Any]:
        # only the simulator's sensors come with accelerations free of gravity
        told = as_fitted(vehicle) if "kinematic_accel_x" in available else vehicle
        return build(name, told, [c for c in available if c not in _LABORATORY])

    return compose


def _printed(name: str) -> Build:
    def compose(vehicle: Vehicle, available: Collection[str]) -> Estimator[Any]:
        if name == "tfobe":
            return PrintedTFOBE.build(vehicle, available)
        return PrintedSlope.build(vehicle, [c for c in available if c != "speed"], method=name)

    return compose


def _drive(name: str) -> Callable[[Vehicle], Manoeuvre]:
    return lambda vehicle: manoeuvre(name).prepare(vehicle)


def _condition(name: str, what: str) -> Condition:
    title = (
        f"{what} on the interchange ramp; white noise of the preset 'paper', speeds but the first and "
        "the plan of the curve chosen, as is the car (preset family-car): the paper prints none of it"
    )
    return Condition(
        name, title, load_vehicle("family-car"), _drive(name), PlanarPlant.seven_dof, sensor_preset("paper")
    )


_DRIVES = {
    "straight-constant-speed": (
        "table 1",
        "straight at 9.7 m/s",
        "3 and 4",
        ((0.437, 0.496), (0.240, 0.291), (0.133, 0.232)),
    ),
    "straight-variable-speed": (
        "table 2",
        "straight at changing speed",
        "5 and 6",
        ((0.450, 0.612), (0.352, 0.462), (0.183, 0.250)),
    ),
    "curve-variable-speed": (
        "table 3",
        "bends at changing speed",
        "7 and 8",
        ((1.09, 1.62), (0.374, 0.488), (0.271, 0.428)),
    ),
}
_METHODS = ("kmbe", "debe", "tfobe")


def _error(column: str) -> Measure:
    def measure(estimates: Estimates, log: Log) -> float:
        grade = evaluate(estimates, log, settle=SETTLED)["grade"]
        return grade.mae if column == "MAE" else grade.rmse

    return measure


def _bound(signals: Collection[str]) -> Callable[[Log, Vehicle], float]:
    return lambda log, vehicle: least_rmse(log, as_fitted(vehicle), settle=SETTLED, signals=signals)


_BOUNDS = {
    "kmbe": _bound(("speed", "accel")),
    "debe": _bound(("speed", "torque")),
    "tfobe": _bound(SIGNALS),
}
"""For the signals that each method takes. That of a mean square: none for the mean error."""


def _cells() -> tuple[Cell, ...]:
    return tuple(
        Cell(table, method, column, "%", figures[i][j], drive, method, _error(column), bound)
        for drive, (table, _, _, figures) in _DRIVES.items()
        for i, method in enumerate(_METHODS)
        for j, (column, bound) in enumerate((("MAE", None), ("RMSE", _BOUNDS[method])))
    )


def _figures() -> tuple[Figure, ...]:
    figures = []
    for drive, (_, what, numbers, _) in _DRIVES.items():
        forces, grade = numbers.split(" and ")
        for quantity in ("force_x_fl", "force_x_rl", "force_y_fl", "force_y_rl"):
            name = f"fig-{forces}-{quantity.replace('_', '-')}"
            figures.append(Figure(name, f"{quantity}, {what}", drive, quantity, ("tfobe",), "best"))
        figures.append(Figure(f"fig-{grade}", f"road grade, {what}", drive, "grade", _METHODS, "best"))
        figures.append(Figure(f"fig-{grade}-as-printed", f"road grade, {what}", drive, "grade", _METHODS))
    return tuple(figures)


PAPER = Paper(
    name="tfobe",
    title="Luo, Huang, Chen & Yang, J. Vibroengineering 2024: road grade from tire forces",
    conditions=tuple(_condition(drive, what) for drive, (_, what, _, _) in _DRIVES.items()),
    methods={name: Method(_printed(name), _best(name)) for name in _METHODS},
    cells=_cells(),
    figures=_figures(),
    page="docs/papers/tfobe.md",
)
