"""DEBE: the driving equation against drives whose grade is known, and what it admits not to know."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from roadstate.core import WHEELS, Estimates, InputError, Log
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.sim.drive import SpeedPlan
from roadstate.sim.scenario import simulate
from roadstate.sim.sensors import SensorNoise
from roadstate.vehicles import Vehicle, load_vehicle

GRADE = np.arctan(0.03)
WHEEL_TORQUES = {f"{kind}_{w}" for kind in ("drive_torque", "brake_torque") for w in WHEELS}


def run(log: Log, vehicle: Vehicle) -> Estimates:
    return scan(build("debe", vehicle, log.available), log)


def error_percent(estimates: Estimates, log: Log) -> np.ndarray:
    return 100 * (np.tan(estimates.values["grade"]) - np.tan(log["ref_grade"]))


def without(log: Log, *prefixes: str) -> Log:
    return log.select(c for c in log.channels if not c.startswith(prefixes))


def test_wheel_torques_give_the_grade_at_any_speed(drive: Callable[..., Log], vehicle: Vehicle) -> None:
    time = np.arange(3000) / 100
    log = without(drive(15 + 1.5 * np.sin(0.3 * time), np.full(3000, GRADE)), "accel_x")
    estimates = run(log, vehicle)
    assert np.abs(error_percent(estimates, log)[1500:]).max() < 0.05 * 3  # % of grade: what the prior pulls


def test_engine_torque_ratio_and_efficiency_give_the_same(
    drive: Callable[..., Log], vehicle: Vehicle
) -> None:
    """The same force, told by engine torque and gear, or by engine torque and engine speed."""
    log = drive(np.full(3000, 15.0), np.full(3000, GRADE))
    ratio = vehicle.driveline.gear_ratios[2]
    total = ratio * vehicle.driveline.final_drive
    torque = 2 * log["drive_torque_fl"] / (total * vehicle.driveline.efficiency)
    engine = {"engine_torque": torque, "gear_ratio": np.full(3000, ratio)}
    by_gear = without(log, "accel_x", "drive_torque").with_channels(engine)
    speeds = {"engine_torque": torque, "engine_speed": 15.0 / vehicle.wheels.radius * total * np.ones(3000)}
    by_speed = without(log, "accel_x", "drive_torque").with_channels(speeds)
    for case in (by_gear, by_speed):
        assert np.abs(error_percent(run(case, vehicle), case)[1500:]).max() < 0.05 * 3


def test_overrun_losses_slow_the_car(drive: Callable[..., Log], vehicle: Vehicle) -> None:
    """A negative engine torque reaches the wheels enlarged by the losses, not lessened."""
    log = drive(np.full(3000, 20.0), np.full(3000, -np.arctan(0.06)))
    ratio = vehicle.driveline.gear_ratios[1]
    wheel = sum(-log[f"brake_torque_{w}"] for w in WHEELS)
    torque = wheel / (ratio * vehicle.driveline.final_drive) * vehicle.driveline.efficiency
    engine = {"engine_torque": torque, "gear_ratio": np.full(3000, ratio), "brake": np.zeros(3000)}
    case = without(log, "accel_x", "drive_torque", "brake_torque").with_channels(engine)
    assert np.abs(error_percent(run(case, vehicle), case)[1500:]).max() < 0.05 * 6


def test_brake_pedal_holds_the_grade_and_says_so(drive: Callable[..., Log], vehicle: Vehicle) -> None:
    """Brakes with an unknown force: not a hill."""
    speed = np.concatenate([np.full(2000, 20.0), 20 - 0.03 * np.arange(400), np.full(600, 8.03)])
    log = without(drive(speed, np.full(3000, GRADE)), "accel_x", "brake_torque")
    pedal = ((np.arange(3000) >= 2000) & (np.arange(3000) < 2400)).astype(float)
    estimates = run(log.with_channels({"brake": pedal}), vehicle)
    assert set(estimates.labels()[2010:2390]) == {"braking"}
    assert np.abs(error_percent(estimates, log)[2000:2400]).max() < 1.0
    assert np.abs(error_percent(estimates, log)[-100:]).max() < 0.3
    assert estimates.std["grade"][2390] > estimates.std["grade"][1990]


def test_specific_force_betrays_a_brake_nobody_told_of(drive: Callable[..., Log], vehicle: Vehicle) -> None:
    speed = np.concatenate([np.full(2000, 20.0), 20 - 0.03 * np.arange(400), np.full(600, 8.03)])
    log = without(drive(speed, np.full(3000, GRADE)), "brake_torque")
    estimates = run(log, vehicle)
    assert set(estimates.labels()[2050:2390]) == {"braking"}
    assert np.abs(error_percent(estimates, log)[2000:2400]).max() < 2.0


def test_gear_shift_is_named_and_bridged(drive: Callable[..., Log], vehicle: Vehicle) -> None:
    log = drive(np.full(4000, 15.0), np.full(4000, GRADE))
    ratios = np.where(
        np.arange(4000) < 2000, vehicle.driveline.gear_ratios[2], vehicle.driveline.gear_ratios[3]
    )
    ratios = np.where((np.arange(4000) >= 1960) & (np.arange(4000) < 2000), 0.0, ratios)
    total = np.maximum(ratios, 0.5) * vehicle.driveline.final_drive
    torque = np.where(ratios > 0, 2 * log["drive_torque_fl"] / (total * vehicle.driveline.efficiency), 0.0)
    engine = {"engine_torque": torque, "gear_ratio": ratios, "brake": np.zeros(4000)}
    case = without(log, "accel_x", "drive_torque", "brake_torque").with_channels(engine)
    estimates = run(case, vehicle)
    assert set(estimates.labels()[1965:2040]) == {"gear_shift"}
    assert np.abs(error_percent(estimates, case)[1900:]).max() < 0.3


def test_standstill_and_silence_hold_the_grade(drive: Callable[..., Log], vehicle: Vehicle) -> None:
    speed = np.concatenate([np.full(2000, 10.0), np.linspace(10, 0, 500), np.zeros(3000)])
    log = without(drive(speed, np.full(5500, GRADE)), "accel_x")
    estimates = run(log, vehicle)
    assert estimates.labels()[-1] == "standstill"
    assert abs(error_percent(estimates, log)[-1]) < 0.5
    silent = {c: np.where(np.arange(5500) > 1500, np.nan, log[c]) for c in log.channels if "torque" in c}
    quiet = run(log.with_channels(silent), vehicle)
    assert quiet.labels()[1900] == "sensor_missing"
    assert quiet.std["grade"][1990] > 1.5 * estimates.std["grade"][1990]


def test_parameters_that_are_not_known_exactly_are_in_the_interval(
    drive: Callable[..., Log], vehicle: Vehicle
) -> None:
    """A car 7 % heavier than its file says is off by 7 % of its drive, and says it may be."""
    log = without(drive(np.full(4000, 15.0), np.full(4000, np.arctan(0.06))), "accel_x")
    light = vehicle.model_copy(update={"mass": vehicle.mass / 1.07})
    estimates = run(log, light)
    error = abs(estimates.values["grade"][-1] - log["ref_grade"][-1])
    assert 0.3 < 100 * error < 1.0
    assert error < 2 * estimates.std["grade"][-1]


def test_engine_torque_alone_is_refused_for_a_car_with_gears(vehicle: Vehicle) -> None:
    with pytest.raises(InputError, match=r"gear_ratio.*engine_speed"):
        build("debe", vehicle, {"speed", "engine_torque"})


def test_one_gear_needs_no_ratio() -> None:
    car = load_vehicle("in-wheel-ev")
    assert build("debe", car, {"speed", "engine_torque"}).channels == ("speed", "engine_torque")


@pytest.mark.parametrize("name", ["compact-car", "suv", "truck", "in-wheel-ev"])
def test_interval_covers_over_seeds_and_vehicles(name: str) -> None:
    car = load_vehicle(name)
    rng = np.random.default_rng(3)
    wheel, engine, mean_error = [], [], []
    for seed in range(4):
        noise = SensorNoise(torque_scale=float(rng.normal() * 0.03), accel_bias=float(rng.normal() * 0.1))
        believed = car.model_copy(update={"mass": car.mass * (1 + 0.05 * rng.normal())})
        plan = SpeedPlan.variable() if seed % 2 else SpeedPlan.constant()
        log = without(simulate(car, plan, seed=seed, noise=noise), "altitude")
        late = log.time > 5

        def inside(case: Log, late: np.ndarray = late, believed: Vehicle = believed) -> float:
            estimates = run(case, believed)
            error = (estimates.values["grade"] - case["ref_grade"])[late]
            return float(np.mean(np.abs(error) < 1.96 * estimates.std["grade"][late]))

        wheel.append(inside(without(log, "engine", "gear")))
        mean_error.append(np.abs(error_percent(run(without(log, "engine", "gear"), car), log)[late]).mean())
        if car.driveline.kind == "engine":
            engine.append(inside(without(log, "drive_torque", "brake_torque")))
            engine.append(inside(without(log, "drive_torque", "brake", "gear")))
    assert np.mean(wheel) > 0.93
    assert np.mean(mean_error) < 0.4
    assert not engine or np.mean(engine) > 0.88
