"""Li et al.: friction by a UKF and by a particle filter, on a double lane change (paper 003)."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any

from roadstate.estimators import Estimator, build
from roadstate.papers.base import Build, Cell, Condition, Figure, Method, Paper
from roadstate.papers.friction_measures import (
    NEVER,
    convergence_time,
    error_bound,
    flat_car,
    mean_error,
    steering_begins,
)
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.manoeuvres.base import KMH, Manoeuvre
from roadstate.sim.sensors import sensor_preset
from roadstate.sim.sensors.inertial import InertialUnit
from roadstate.sim.sensors.probe import Probe
from roadstate.sim.sensors.suite import SensorSuite
from roadstate.vehicles import Vehicle, load_vehicle

_NOISE = 0.02  # m/s² and rad/s²
_SETTLED = 1.0  # s after the steering begins: the paper's claim of convergence
_TOLERANCE = 0.05
_STEADY = {
    "grouping": "one",
    "mean": 1.0,
    "shared_std": 1.0,
    "own_std": 0.0,
    "shared_walk": 1e-4,
    "own_walk": 0.0,
    "sensor_std": _NOISE,
    "uses_rate": False,
    "direct": True,
}
"""Best where slips come without noise: the sensors' true noise, one friction for all wheels, and one that
hardly changes along the road; the start is the paper's."""
_LABORATORY = {"velocity_y", "yaw_accel"}
"""Channels that only a test car or a simulator has."""


def _quiet_slips() -> SensorSuite:
    """Noise on what the filter measures; what it is told (slips, slip angles, steering) has none."""
    return replace(
        sensor_preset("ideal"), imu=InertialUnit(Probe(noise=_NOISE)), yaw_accel=Probe(noise=_NOISE)
    )


def _double_lane_change(speed: float, friction: float) -> Callable[[Vehicle], Manoeuvre]:
    kind = manoeuvre("double-lane-change")
    return lambda vehicle: kind.prepare(vehicle, speed=speed * KMH, friction=friction)


def _condition(name: str, speed: float, friction: float, sensors: SensorSuite, heard: str) -> Condition:
    return Condition(
        name,
        f"double lane change at {speed:g} km/h on a friction of {friction:g}, D = 3.5 m and l₁…l₅ as in "
        f"§5.2; {heard}; the car's figures are chosen (preset in-wheel-ev)",
        load_vehicle("in-wheel-ev"),
        _double_lane_change(speed, friction),
        flat_car,
        sensors,
    )


_QUIET = "white noise of 0.02 m/s² and 0.02 rad/s² (chosen) on what is measured, none on the slips"
_NOISY = "white noise on every signal, slips included (preset paper; chosen)"
_CONDITIONS = (
    _condition("high", 48.0, 0.8, _quiet_slips(), _QUIET),
    _condition("low", 48.0, 0.4, _quiet_slips(), _QUIET),
    _condition("road-test", 40.0, 0.8, _quiet_slips(), _QUIET + "; the paper's is a real drive"),
    _condition("high-noisy", 48.0, 0.8, sensor_preset("paper"), _NOISY),
    _condition("low-noisy", 48.0, 0.4, sensor_preset("paper"), _NOISY),
)


def _printed(name: str) -> Build:
    return lambda vehicle, available: build(name, vehicle, available, as_printed=True)


def _steady(name: str, **options: Any) -> Build:
    def made(vehicle: Vehicle, available: Collection[str]) -> Estimator[Any]:
        if set(available) >= _LABORATORY:
            return build(name, vehicle, available, **_STEADY, **options)
        return build(name, vehicle, available)

    return made


def _usual(name: str) -> Build:
    return lambda vehicle, available: build(name, vehicle, available)


_METHODS = {
    "ukf": Method(_printed("friction-ukf"), _steady("friction-ukf")),
    "pf": Method(_printed("friction-pf"), _steady("friction-pf", filter_options={"particles": 1000})),
    "ukf-usual": Method(_printed("friction-ukf"), _usual("friction-ukf")),
    "pf-usual": Method(_printed("friction-pf"), _usual("friction-pf")),
}


def _cells() -> tuple[Cell, ...]:
    found: list[Cell] = []
    error, fast = mean_error(steering_begins, _SETTLED), convergence_time(steering_begins, _TOLERANCE)
    at_least = error_bound(_steady("friction-ukf"), steering_begins, _SETTLED)
    claims = {"ukf": 7.0, "pf": 0.1}
    for row, condition in (("μ 0.8", "high"), ("μ 0.4", "low")):
        for method, claim in claims.items():
            label = method.upper()
            found += [
                Cell("§5.1", row, f"{label} error", "%", claim, condition, method, error, at_least),
                Cell("§5.1", row, f"{label} convergence", "s", 1.0, condition, method, fast, lost=NEVER),
            ]
    table = "§5.2, simulated"
    found += [
        Cell(table, "μ 0.8, 40 km/h", "PF error", "%", 1.0, "road-test", "pf", error, at_least),
        Cell(table, "μ 0.8, 40 km/h", "PF convergence", "s", 1.0, "road-test", "pf", fast, lost=NEVER),
    ]
    for row, condition in (("μ 0.8", "high-noisy"), ("μ 0.4", "low-noisy")):
        for method in claims:
            found.append(
                Cell(
                    "every signal noisy", row, f"{method.upper()} error", "%", None, condition,
                    f"{method}-usual", error,
                )
            )  # fmt: skip
    return tuple(found)


_FIGURES = tuple(
    Figure(f"fig-{number}", f"friction, {what}", condition, "friction_peak", methods)
    for number, what, condition, methods in (
        ("5-7", "μ 0.8, 48 km/h", "high", ("ukf", "pf")),
        ("6-8", "μ 0.4, 48 km/h", "low", ("ukf", "pf")),
        ("15", "μ 0.8, 40 km/h", "road-test", ("pf",)),
    )
)

PAPER = Paper(
    name="ukf-pf",
    title="Li, A comparative study of the unscented Kalman filter and particle filter estimation methods for "
    "the measurement of the road adhesion coefficient",
    conditions=_CONDITIONS,
    methods=_METHODS,
    cells=_cells(),
    figures=_FIGURES,
    page="docs/papers/ukf-pf.md",
)
