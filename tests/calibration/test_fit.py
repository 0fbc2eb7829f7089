"""What is learned from logs whose truth is known, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from calibration_case import SPEED_NOISE, with_mass

from roadstate.calibration import Calibration, Learned, calibrate, fit
from roadstate.core import InputError, Log
from roadstate.vehicles import Vehicle

pytestmark = pytest.mark.usefixtures("optimised")


def noise_of(found: Calibration) -> Learned:
    return next(one for one in found.learned if one.parameter.name == "sensors.speed.noise")


def test_mass_is_learned_and_what_hardly_shows_is_not(car: Vehicle, hilly: Log) -> None:
    told = with_mass(car, 1.07)
    found = calibrate(told, {"drive": hilly}, ["mass", "aero"])
    (mass,) = found.learned
    assert found.converged
    assert mass.parameter.name == "mass"
    assert abs(mass.value - car.mass) < 0.6 * abs(told.mass - car.mass)
    assert abs(mass.value - car.mass) < 2.5 * mass.std
    assert mass.std < 0.7 * car.prior.mass_relative * car.mass
    assert found.refused == {"aerodynamics.drag_coefficient": "hardly shows in these data"}
    assert found.vehicle.mass == mass.value
    assert found.vehicle.aerodynamics == told.aerodynamics


def test_a_mass_owes_its_uncertainty_to_the_wheels_radius_as_well(
    car: Vehicle, hilly: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    def learned(told: Vehicle) -> Learned:
        (mass,) = calibrate(told, {"drive": hilly}, ["mass"], estimator="debe").learned
        return mass

    whole = learned(car)
    monkeypatch.setattr(fit, "_BESIDE", {})
    larger = car.wheels.radius * np.exp(car.sensors.wheel_speed.scale)
    alone = learned(car)
    moved = learned(car.model_copy(update={"wheels": car.wheels.model_copy(update={"radius": larger})}))
    shift = np.log(moved.value / alone.value)
    assert whole.value == alone.value
    assert shift < -0.5 * car.sensors.wheel_speed.scale
    added = np.sqrt(whole.relative**2 - alone.relative**2)
    assert added == pytest.approx(abs(shift), rel=0.3)


def test_without_the_prior_less_is_left_of_the_error(car: Vehicle, level: Log) -> None:
    short = level.between(0.0, 31.0)
    held, free = (
        calibrate(car, {"level": short}, tune=True, estimator="kmbe", use_prior=use) for use in (True, False)
    )
    assert (held.uses_prior, free.uses_prior) == (True, False)
    start = car.sensors.speed.noise
    assert noise_of(free).value > noise_of(held).value > start
    assert noise_of(free).std / noise_of(free).value > noise_of(held).std / noise_of(held).value


def test_tuning_finds_the_noise_that_was_added(car: Vehicle, level: Log) -> None:
    found = calibrate(car, {"level": level}, tune=True, estimator="kmbe")
    noise = noise_of(found)
    assert noise.value == pytest.approx(SPEED_NOISE, rel=0.1)
    assert abs(noise.value - SPEED_NOISE) < 4 * noise.std


def test_two_logs_tell_more_than_one(car: Vehicle, level: Log) -> None:
    halves = {"a": level.between(0.0, 59.9), "b": level.between(60.0, 120.0)}
    half = calibrate(car, {"a": halves["a"]}, tune=True, estimator="kmbe")
    both = calibrate(car, halves, tune=True, estimator="kmbe")
    assert noise_of(both).std == pytest.approx(noise_of(half).std / np.sqrt(2), rel=0.35)


def test_refusals(car: Vehicle, level: Log) -> None:
    with pytest.raises(InputError, match=r"short: 9\.95 s are too short to learn from; give logs of 30 s"):
        calibrate(car, {"short": level.between(0.0, 10.0)}, ["mass"])
    with pytest.raises(InputError, match="no estimator is called 'kmb'"):
        calibrate(car, {"level": level}, ["mass"], estimator="kmb")
    with pytest.raises(InputError, match=r"nothing can be learned .tires\.friction 'kmbe' does not use it"):
        calibrate(car, {"level": level}, ["friction"], estimator="kmbe")


def test_constant_speed_on_a_level_road_tells_nothing(car: Vehicle) -> None:
    time = np.arange(0.0, 40.0, 0.05)
    steady = Log(
        time,
        {
            "accel_x": np.zeros(len(time)),
            "speed": np.full(len(time), 25.0),
            "engine_torque": np.full(len(time), 60.0),
            "gear_ratio": np.full(len(time), 3.0),
        },
    )
    with pytest.raises(InputError, match=r"nothing can be learned .aerodynamics\.drag_coefficient hardly"):
        calibrate(car, {"steady": steady}, ["aero", "rolling"])
