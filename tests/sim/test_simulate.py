"""Whole drives: what the driver does and what the sensors read."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.core import WHEELS, InputError, Log
from roadstate.core.constants import GRAVITY
from roadstate.sim import Driver, GradeProfile, SensorNoise, SpeedPlan, follow, interchange_ramp, simulate
from roadstate.sim.drive import Truth
from roadstate.vehicles import load_vehicle, presets


@pytest.fixture(scope="module")
def truth() -> Truth:
    return follow(Driver.from_vehicle(load_vehicle("family-car")), interchange_ramp(), SpeedPlan.variable())


@pytest.fixture(scope="module")
def clean() -> Log:
    return simulate(load_vehicle("family-car"), noise=SensorNoise.none())


def test_same_seed_gives_the_same_bits_and_another_does_not() -> None:
    vehicle, plan = load_vehicle("compact-car"), SpeedPlan.constant(duration=5.0)
    a, b, c = (simulate(vehicle, plan, seed=seed) for seed in (3, 3, 4))
    assert a.channels.keys() == b.channels.keys()
    for name in a.channels:
        assert np.array_equal(a[name], b[name], equal_nan=True)
    assert not np.array_equal(a["accel_x"], c["accel_x"])
    assert np.array_equal(a["ref_grade"], c["ref_grade"])


def test_constant_drive_keeps_the_speed_of_the_paper_and_meets_its_grades() -> None:
    truth = follow(Driver.from_vehicle(load_vehicle("family-car")), interchange_ramp(), SpeedPlan.constant())
    assert np.abs(truth.velocity - 9.7).max() < 0.3
    at = [int(t * 100) for t in (20, 45, 80)]
    assert np.rad2deg(truth.grade[at]) == pytest.approx([-1.8, 3.4, -3.9], abs=0.01)


def test_variable_drive_brakes_shifts_stops_and_starts_again(truth: Truth) -> None:
    stands = truth.velocity == 0
    assert 7.0 < stands.sum() / 100 < 10.0
    assert np.rad2deg(truth.grade[stands]) == pytest.approx(3.4, abs=0.01)
    assert (truth.velocity >= 0).all()
    assert set(np.unique(truth.brake)) == {0.0, 1.0}
    meshed = truth.gear_ratio[truth.gear_ratio > 0]
    assert len(np.unique(meshed)) >= 4
    moving_open = (truth.gear_ratio == 0) & (truth.velocity > 1)
    assert 3 <= np.sum(np.diff(moving_open.astype(int)) == 1) <= 12
    assert truth.velocity[-1] == pytest.approx(10.0, abs=0.1)


def test_energy_of_a_whole_drive_balances(truth: Truth) -> None:
    vehicle = load_vehicle("family-car")
    v, R = truth.velocity, vehicle.wheels.radius
    rotating = vehicle.driveline.engine_inertia * truth.total_ratio**2 * truth.acceleration / R
    rolling = vehicle.rolling_resistance.coefficient + vehicle.rolling_resistance.speed_coefficient * v**2
    force = (truth.drive_torque - rotating - truth.brake_torque) / R
    force -= vehicle.mass * GRAVITY * rolling * np.cos(truth.grade)
    force -= 0.5 * vehicle.aerodynamics.air_density * vehicle.drag_area * v**2
    power = force * v
    work = np.sum((power[1:] + power[:-1]) / 2 * 0.01)
    gain = 0.5 * vehicle.effective_mass() * (v[-1] ** 2 - v[0] ** 2)
    gain += vehicle.mass * GRAVITY * (truth.altitude[-1] - truth.altitude[0])
    throughput = np.sum(np.abs(power)) * 0.01
    assert abs(work - gain) < 1e-3 * throughput


def test_parked_car_reads_the_slope_and_rolling_wheels_nothing_else(clean: Log) -> None:
    vehicle, theta = load_vehicle("family-car"), np.deg2rad(3.4)
    parked = (clean.time > 51) & (clean.time < 55)
    force = GRAVITY * np.sin(theta)
    pitch = vehicle.body.pitch_gradient * force
    expected = force * np.cos(pitch) + GRAVITY * np.cos(theta) * np.sin(pitch)
    assert clean["accel_x"][parked] == pytest.approx(expected, abs=1e-4)
    for wheel in WHEELS:
        assert (clean[f"wheel_speed_{wheel}"][parked] == 0).all()


def test_parked_car_on_stiff_springs_reads_g_sin_theta() -> None:
    stiff = load_vehicle("family-car").model_copy(
        update={"body": load_vehicle("family-car").body.model_copy(update={"pitch_gradient": 0.0})}
    )
    plan = SpeedPlan((0.0, 3.0), (0.0, 0.0))
    log = simulate(stiff, plan, road=GradeProfile([0.0], [-0.07]), noise=SensorNoise.none())
    late = log.time > 1.0
    assert log["accel_x"][late] == pytest.approx(GRAVITY * np.sin(-0.07), abs=1e-12)


def test_noise_has_the_size_it_says(clean: Log) -> None:
    noise = SensorNoise()
    noisy = simulate(load_vehicle("family-car"), seed=11)
    error = noisy["accel_x"] - clean["accel_x"]
    assert np.mean(error) == pytest.approx(noise.accel_bias, abs=4 * noise.accel / np.sqrt(len(clean)))
    assert np.std(error) == pytest.approx(noise.accel, rel=0.05)
    moving = clean["ref_velocity_x"] > 1
    assert np.std((noisy["wheel_speed_rl"] - clean["wheel_speed_rl"])[moving]) == pytest.approx(
        noise.wheel_speed, rel=0.05
    )
    scale = np.polyfit(clean["engine_torque"], noisy["engine_torque"], 1)[0]
    assert scale == pytest.approx(1 + noise.torque_scale, abs=0.003)


def test_gnss_comes_once_a_second_along_the_heading(clean: Log) -> None:
    fixes = np.isfinite(clean["latitude"])
    assert np.flatnonzero(fixes).tolist() == list(range(0, len(clean), 100))
    assert np.array_equal(fixes, np.isfinite(clean["altitude"]))
    assert np.array_equal(fixes, np.isfinite(clean["longitude"]))
    north = np.deg2rad(np.ptp(clean["latitude"][fixes])) * 6_371_000.0
    mean_latitude = np.deg2rad(clean["latitude"][0])
    east = np.deg2rad(np.ptp(clean["longitude"][fixes])) * 6_371_000.0 * np.cos(mean_latitude)
    travelled = np.sum(clean["ref_velocity_x"][: fixes.nonzero()[0][-1]]) * 0.01
    assert np.hypot(north, east) == pytest.approx(travelled, rel=1e-3)


@pytest.mark.parametrize("name", sorted(presets()))
def test_every_preset_can_be_driven(name: str) -> None:
    vehicle = load_vehicle(name)
    log = simulate(vehicle, SpeedPlan((0.0, 4.0, 12.0, 16.0), (0.0, 0.0, 10.0, 9.0)), seed=1)
    assert 8.5 < log["ref_velocity_x"][-1] < 10.5
    assert ("engine_torque" in log) == (vehicle.driveline.kind == "engine")
    undriven = {"front": ("rl", "rr"), "rear": ("fl", "fr"), "all": ()}[vehicle.driveline.driven]
    for wheel in WHEELS:
        drives = np.abs(log[f"drive_torque_{wheel}"]).max() > 10 * SensorNoise().wheel_torque
        assert drives == (wheel not in undriven)


def test_car_without_ratios_is_refused() -> None:
    vehicle = load_vehicle("family-car")
    line = vehicle.driveline.model_copy(update={"gear_ratios": ()})
    with pytest.raises(InputError, match=r"no gear ratios to drive with; give 'driveline.gear_ratios'"):
        simulate(vehicle.model_copy(update={"driveline": line}))


@pytest.mark.parametrize(
    ("time", "speed"),
    [((0.0,), (1.0,)), ((0.0, 0.0), (1.0, 1.0)), ((1.0, 2.0), (1.0, 1.0)), ((0.0, 1.0), (1.0, -1.0))],
)
def test_bad_plans_are_refused(time: tuple[float, ...], speed: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="a speed plan needs times from 0 upward"):
        SpeedPlan(time, speed)


def test_negative_noise_is_refused() -> None:
    with pytest.raises(InputError, match="sensor noise 'accel' is -1"):
        SensorNoise(accel=-1.0)
