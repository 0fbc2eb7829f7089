"""The plants a condition is driven on, what is recorded there, and the car that estimators are told of."""

from __future__ import annotations

from collections.abc import Iterator
from zlib import crc32

import numpy as np

from roadstate.core import Log
from roadstate.papers.base import MISMATCHED, Condition
from roadstate.sim.plant import multibody_plant
from roadstate.sim.plant.mismatch import mismatched
from roadstate.sim.run import Drive, drive, truth_table
from roadstate.sim.sensors import measure, sensor_preset, to_log
from roadstate.vehicles import Vehicle

_RATE = 200.0  # of the truth that the sensors sample, Hz
# per cent by which a figure in the estimator's vehicle file is off, either way
OFF = {
    "mass": (5.0, 10.0),
    "yaw_inertia": (5.0, 10.0),
    "cg_height": (5.0, 10.0),
    "cornering_stiffness": (5.0, 10.0),
    "slip_stiffness": (5.0, 10.0),
    "cg_forward": (1.0, 2.0),
    "radius": (0.3, 1.0),
}
# and by sections of the file, likewise
_SECTIONS_OFF = {
    "body": {"pitch_gradient": (5.0, 10.0), "roll_gradient": (5.0, 10.0)},
    "aerodynamics": {"drag_coefficient": (5.0, 10.0)},
    "rolling_resistance": {"coefficient": (5.0, 10.0)},
    "tires": {"friction": (5.0, 10.0)},
}


def drive_on(condition: Condition, *, matched: bool) -> Drive:
    """Drive a condition on its matched plant, or on the reference plant.

    Raises:
        InputError: the drive breaks down.
    """
    vehicle = condition.vehicle
    plant = condition.matched(vehicle) if matched else multibody_plant(vehicle)
    return drive(plant, condition.manoeuvre(vehicle), vehicle, rate=_RATE)


def recordings(driven: Drive, condition: Condition, plant: str, seeds: int) -> Iterator[Log]:
    """One log after another, at 100 Hz with the truth in ``ref_*``; seeds count from 0.

    Args:
        driven: on the plant.
        condition: that was driven; its sensors, unless the plant is the mismatched one, which has those of
            the preset ``automotive``.
        plant: one of :data:`roadstate.papers.base.PLANTS`.
        seeds: how many.
    """
    suite = sensor_preset("automotive") if plant == MISMATCHED else condition.sensors
    table, about = truth_table(driven), {"vehicle": driven.vehicle.name, "manoeuvre": driven.manoeuvre.name}
    truth: Log | None = None
    for seed in range(seeds):
        log = to_log(measure(table, suite, seed=seed, metadata=about))
        truth = log if truth is None else truth
        if np.array_equal(truth.time, log.time):  # the truth is the same each time: keep one
            log = log.with_channels(truth.references)
        if condition.disturb is not None:
            log = condition.disturb(log, _random(seed, "disturb"))
        yield log


def told(vehicle: Vehicle, plant: str, seed: int) -> Vehicle:
    """The car as an estimator knows it: itself, or on the mismatched plant one whose figures are off.

    Mass, yaw inertia, CG height, the tires' stiffnesses and friction, drag, rolling resistance and how the
    body leans are then off by 5 to 10 %, the CG's place by 1 to 2 % of the wheelbase, the rolling radius by
    0.3 to 1 %, each up or down by chance. Where a file states how exact such a figure is, it states the root
    mean square of this; but of stiffnesses and friction what a file says by default, since the plant's tires
    are not the file's even before that, nor its roads the file's dry asphalt.

    Args:
        vehicle: that is driven.
        plant: one of :data:`roadstate.papers.base.PLANTS`.
        seed: same seed, same car.
    """
    if plant != MISMATCHED:
        return vehicle
    random = _random(seed, "mismatch")

    def drawn(figures: dict[str, tuple[float, float]]) -> dict[str, float]:
        return {
            name: random.uniform(*limits) * random.choice((-1.0, 1.0)) for name, limits in figures.items()
        }

    car = mismatched(vehicle, **drawn(OFF))
    sections = {}
    for section, figures in _SECTIONS_OFF.items():
        told_of = getattr(car, section)
        off = {name: getattr(told_of, name) * (1 + percent / 100) for name, percent in drawn(figures).items()}
        sections[section] = told_of.model_copy(update=off)
    car = car.model_copy(update=sections)
    spread = rms(OFF["mass"])
    prior = {
        "mass_relative": spread,
        "drag_relative": spread,
        "rolling_resistance_std": spread * vehicle.rolling_resistance.coefficient,
        "pitch_gradient_std": spread * max(vehicle.body.pitch_gradient, vehicle.body.roll_gradient),
    }
    wheel_speed = car.sensors.wheel_speed.model_copy(update={"scale": rms(OFF["radius"])})
    return car.model_copy(
        update={
            "prior": car.prior.model_copy(update=prior),
            "sensors": car.sensors.model_copy(update={"wheel_speed": wheel_speed}),
        }
    )


def rms(percent: tuple[float, float]) -> float:
    """Root mean square of what lies anywhere between two percentages, as a share."""
    least, most = percent
    return float(np.sqrt((most**2 + most * least + least**2) / 3)) / 100


def _random(seed: int, what: str) -> np.random.Generator:
    return np.random.default_rng([seed, crc32(what.encode())])
