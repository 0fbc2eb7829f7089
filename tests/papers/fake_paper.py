"""A small paper: a few seconds on the ramp by a planar plant, with estimators that are there anyway."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from roadstate.core import Estimates, InputError, Log
from roadstate.estimators import Estimator, build
from roadstate.metrics import evaluate
from roadstate.papers.base import Build, Cell, Condition, Figure, Method, Paper
from roadstate.sim.manoeuvres import Manoeuvre, manoeuvre
from roadstate.sim.manoeuvres.script import Script
from roadstate.sim.plant.planar import PlanarPlant
from roadstate.sim.sensors import sensor_preset
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle, load_vehicle

DURATION = 4.0  # s
LOST = 1
"""The seed whose value in the row 'lost' is not finite."""


def drive(vehicle: Vehicle) -> Manoeuvre:
    """A few seconds of the straight ramp."""
    plan = SpeedPlan((0.0, DURATION), (9.7, 10.5))
    whole = manoeuvre("straight-constant-speed").prepare(vehicle)
    return replace(whole, script=Script.write(plan))


def estimator(name: str) -> Build:
    """A build of the estimator called so."""
    return lambda vehicle, available: build(name, vehicle, available)


def wants_steer(vehicle: Vehicle, available: Collection[str]) -> Estimator[Any]:
    """KMBE for cars that measure the angle of their road wheels."""
    if "steer" not in available:
        raise InputError("no angle of the road wheels", mend="measure it")
    return build("kmbe", vehicle, available)


def mae(estimates: Estimates, log: Log) -> float:
    """Of grade in %."""
    return evaluate(estimates, log)["grade"].mae


def lost(estimates: Estimates, log: Log) -> float:
    """The same, not finite for one seed."""
    return float("nan") if log.metadata["seed"] == LOST else mae(estimates, log)


def louder(log: Log, random: np.random.Generator) -> Log:
    """More noise on the accelerometer."""
    return log.with_channels({"accel_x": log["accel_x"] + 0.2 * random.standard_normal(len(log))})


def cell(row: str, paper: float | None, method: str, **more: Any) -> Cell:
    """A cell of the table 'tab. 1'."""
    return Cell("tab. 1", row, "MAE", "%", paper, "ramp", method, **{"measure": mae, **more})


PAPER = Paper(
    name="fake",
    title="Nobody, Fake <journal> | 2024",
    conditions=(
        Condition(
            "ramp",
            "a few seconds of the ramp; friction chosen",
            load_vehicle("family-car"),
            drive,
            PlanarPlant.seven_dof,
            sensor_preset("paper"),
            louder,
        ),
    ),
    methods={
        "grade": Method(as_printed=estimator("debe"), best=estimator("kmbe")),
        "steered": Method(as_printed=wants_steer, best=wants_steer),
    },
    cells=(
        cell("easy", 1000.0, "grade"),
        cell("hard", 1e-9, "grade", bound=lambda log, vehicle: 1e-3 * vehicle.mass),
        cell("no figure", None, "grade"),
        cell("lost", 1000.0, "grade", measure=lost),
        cell("steered", 1000.0, "steered"),
    ),
    figures=(Figure("fig-1", "grade over time", "ramp", "grade", ("grade", "steered")),),
)
