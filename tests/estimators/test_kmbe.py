"""KMBE: what it must tell of drives whose grade is known, and how sure it may be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from roadstate.core import Estimates, Log, Validity
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.sim.drive import SpeedPlan
from roadstate.sim.scenario import simulate
from roadstate.sim.sensors import SensorNoise
from roadstate.vehicles import Vehicle, load_vehicle

KINEMATIC = {f"wheel_speed_{w}" for w in ("fl", "fr", "rl", "rr")} | {
    "accel_x",
    "ref_grade",
    "ref_velocity_x",
}
GRADE = np.arctan(0.04)


def run(log: Log, vehicle: Vehicle) -> Estimates:
    return scan(build("kmbe", vehicle, log.available), log)


def error_percent(estimates: Estimates, log: Log) -> np.ndarray:
    return 100 * (np.tan(estimates.values["grade"]) - np.tan(log["ref_grade"]))


def test_constant_grade_is_found_at_changing_speed(drive: Callable[..., Log], vehicle: Vehicle) -> None:
    time = np.arange(3000) / 100
    log = drive(12 + 4 * np.sin(0.5 * time), np.full(3000, GRADE)).select(KINEMATIC)
    estimates = run(log, vehicle)
    assert (
        np.abs(error_percent(estimates, log)[1000:]).max() < 0.1
    )  # the prior of a level road pulls a little
    assert np.abs(estimates.values["speed"] - log["ref_velocity_x"])[500:].max() < 0.02
    assert set(estimates.labels()[10:]) == {"excited"}


def test_parked_car_reads_the_slope(drive: Callable[..., Log], vehicle: Vehicle) -> None:
    log = drive(np.zeros(2000), np.full(2000, GRADE)).select(KINEMATIC)
    estimates = run(log, vehicle)
    assert abs(error_percent(estimates, log)[-1]) < 0.1
    assert estimates.labels()[-1] == "standstill"


def test_an_hour_at_rest_neither_drifts_nor_claims_more_than_the_bias_allows(
    drive: Callable[..., Log], vehicle: Vehicle
) -> None:
    speed = np.concatenate([np.linspace(10, 0, 1000), np.zeros(360_000)])
    log = drive(speed, np.full(len(speed), GRADE), accel_bias=0.05).select(KINEMATIC)
    estimates = run(log, vehicle)
    assert abs(error_percent(estimates, log)[-1] - 100 * 0.05 / GRAVITY) < 0.05
    assert estimates.std["grade"][-1] >= vehicle.sensors.accel.bias / GRAVITY


def test_reverse_is_told_by_the_gear(drive: Callable[..., Log], vehicle: Vehicle) -> None:
    time = np.arange(3000) / 100
    log = drive(-3 + np.sin(0.5 * time), np.full(3000, GRADE)).select(KINEMATIC)
    unsigned = {c: np.abs(log[c]) for c in log.channels if c.startswith("wheel_speed")}
    log = log.with_channels({**unsigned, "gear_ratio": np.full(3000, -3.5)})
    estimates = run(log, vehicle)
    assert np.abs(error_percent(estimates, log)[1500:]).max() < 0.1
    assert estimates.values["speed"][-1] < 0


def test_turning_on_the_flat_is_not_a_grade(drive: Callable[..., Log], vehicle: Vehicle) -> None:
    """On a circle the centre of gravity drifts outward of its path: a_x = −v_y r, which is not the road's."""
    speed, yaw_rate = 12.0, 0.4
    rear = speed**2 * yaw_rate / (GRAVITY * vehicle.tires.cornering_stiffness_rear)
    side_slip = vehicle.geometry.cg_to_rear_axle * yaw_rate - rear
    log = drive(np.full(2000, speed), np.zeros(2000)).select(KINEMATIC)
    reading = -(1 + GRAVITY * vehicle.body.pitch_gradient) * side_slip * yaw_rate
    turning = {"accel_x": np.full(2000, reading), "yaw_rate": np.full(2000, yaw_rate)}
    for wheel, half in (("fl", -0.5), ("fr", 0.5), ("rl", -0.5), ("rr", 0.5)):
        track = vehicle.geometry.track_front if wheel[0] == "f" else vehicle.geometry.track_rear
        turning[f"wheel_speed_{wheel}"] = np.full(
            2000, (speed + half * track * yaw_rate) / vehicle.wheels.radius
        )
    corrected = run(log.with_channels(turning), vehicle)
    assert abs(100 * corrected.values["grade"][-1]) < 0.03
    del turning["yaw_rate"]
    naive = run(log.with_channels(turning), vehicle)
    assert abs(100 * naive.values["grade"][-1]) > 0.5


def test_bias_is_only_estimated_where_altitude_or_climb_observes_it(
    drive: Callable[..., Log], vehicle: Vehicle
) -> None:
    time = np.arange(12_000) / 100
    grade = np.arctan(0.04 * np.sin(0.2 * time))
    log = drive(np.full(12_000, 15.0), grade, accel_bias=0.15).select(KINEMATIC)
    plain = run(log, vehicle)
    assert "accel_x_bias" not in plain.values
    fixes = np.where(np.arange(12_000) % 100 == 0, 0.0, np.nan)
    altitude = np.cumsum(15.0 * np.sin(grade)) / 100
    for aiding in ({"altitude": altitude + fixes}, {"vertical_speed": 15.0 * np.sin(grade) + fixes}):
        aided_log = log.with_channels(aiding)
        aided = run(aided_log, vehicle)
        assert abs(aided.values["accel_x_bias"][-1] - 0.15) < 2 * aided.std["accel_x_bias"][-1]
        assert aided.std["accel_x_bias"][-1] < 0.5 * vehicle.sensors.accel.bias
        late = slice(6000, None)
        assert (
            np.abs(error_percent(aided, aided_log))[late].mean()
            < 0.35 * np.abs(error_percent(plain, log))[late].mean()
        )


@pytest.mark.parametrize("missing", ["random", "gap", "accel", "speed"])
def test_missing_samples_widen_the_interval_and_nothing_else(
    missing: str, drive: Callable[..., Log], vehicle: Vehicle
) -> None:
    time = np.arange(6000) / 100
    log = drive(12 + 3 * np.sin(0.4 * time), np.arctan(0.03 * np.sin(0.1 * time))).select(KINEMATIC)
    rng = np.random.default_rng(0)
    lost = {
        "random": rng.random((6000, len(KINEMATIC))) < 0.3,
        "gap": np.repeat(((time > 20) & (time < 28))[:, None], len(KINEMATIC), axis=1),
        "accel": np.repeat(((time > 20) & (time < 28))[:, None], len(KINEMATIC), axis=1),
        "speed": np.repeat(((time > 20) & (time < 28))[:, None], len(KINEMATIC), axis=1),
    }[missing]
    touched = [c for c in sorted(log.channels) if not c.startswith("ref_")]
    if missing in ("accel", "speed"):
        touched = [c for c in touched if c.startswith({"accel": "accel", "speed": "wheel"}[missing])]
    holes = {c: np.where(lost[:, i], np.nan, log[c]) for i, c in enumerate(touched)}
    estimates = run(log.with_channels(holes), vehicle)
    whole = run(log, vehicle)
    error = error_percent(estimates, log)
    assert all(np.isfinite(v).all() for v in (*estimates.values.values(), *estimates.std.values()))
    assert np.abs(error[4000:]).max() < 0.5
    inside = np.abs(estimates.values["grade"] - log["ref_grade"]) < 3 * estimates.std["grade"]
    assert inside[500:].all()
    if missing != "random":
        assert estimates.std["grade"][2790] > 1.2 * whole.std["grade"][2790]
        assert set(estimates.labels()[2400:2790]) == {"sensor_missing"}
        assert estimates.validity[-1] == Validity.EXCITED


def test_a_hole_in_the_time_base_is_bridged(drive: Callable[..., Log], vehicle: Vehicle) -> None:
    time = np.arange(6000) / 100
    log = drive(np.full(6000, 12.0), np.arctan(0.03 * np.sin(0.1 * time))).select(KINEMATIC)
    keep = (time < 20) | (time > 50)
    cut = Log(log.time[keep], {c: v[keep] for c, v in log.channels.items()})
    estimates = run(cut, vehicle)
    assert np.abs(error_percent(estimates, cut)[-500:]).max() < 0.5
    after = int(np.argmax(cut.time > 50))
    assert estimates.std["grade"][after] > 2 * estimates.std["grade"][after - 2]


@pytest.mark.parametrize("name", ["compact-car", "suv", "truck", "in-wheel-ev"])
def test_interval_covers_over_seeds_biases_and_vehicles(name: str) -> None:
    """Biases drawn from the σ that the vehicle file states; the plant slips, pitches and shifts gear."""
    car = load_vehicle(name)
    rng = np.random.default_rng(7)
    inside, spread, centred = [], [], []
    for seed in range(6):
        noise = SensorNoise(accel_bias=float(rng.normal() * car.sensors.accel.bias))
        plan = SpeedPlan.variable() if seed % 2 else SpeedPlan.constant()
        log = simulate(car, plan, seed=seed, noise=noise).select(KINEMATIC | {"yaw_rate", "gear_ratio"})
        estimates = run(log, car)
        late = log.time > 5
        z = (estimates.values["grade"] - log["ref_grade"])[late] / estimates.std["grade"][late]
        inside.append(np.mean(np.abs(z) < 1.96))
        spread.append(np.mean(z**2))
        error = error_percent(estimates, log)[late]
        centred.append(np.abs(error - error.mean()).mean())
    assert np.mean(inside) > 0.85
    assert 0.15 < np.mean(spread) < 2.0
    assert np.mean(centred) < 0.26
