"""All sensors together: lever arm, mounting, rates, repeatability, files, faults."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from roadstate.core import CHANNELS, WHEELS, InputError, Recording
from roadstate.core.constants import GRAVITY
from roadstate.io import read, write
from roadstate.sim.sensors import (
    KINDS,
    PRESETS,
    Fault,
    InertialUnit,
    Probe,
    SensorSuite,
    inject,
    measure,
    sensor_preset,
    to_log,
)
from roadstate.sim.sensors.inertial import rotation

STEP = 1e-3


def drive(seconds: float = 20.0) -> dict[str, np.ndarray]:
    """A made-up drive: everything moves, nothing is constant."""
    time = np.arange(round(seconds / STEP) + 1) * STEP
    speed = 15.0 + 3.0 * np.sin(0.4 * time)
    rates = {
        "roll_rate": 0.05 * np.sin(2.0 * time),
        "pitch_rate": 0.04 * np.cos(1.5 * time),
        "yaw_rate": 0.3 * np.sin(0.7 * time),
    }
    heading = 0.3 / 0.7 * (1 - np.cos(0.7 * time))
    table = {
        "time": time,
        "accel_x": 1.2 * np.cos(0.4 * time),
        "accel_y": speed * rates["yaw_rate"],
        "accel_z": np.full(len(time), GRAVITY),
        **rates,
        "steering_wheel": 0.5 * np.sin(0.7 * time),
        "steer": 0.03 * np.sin(0.7 * time),
        "engine_torque": 80.0 + 20.0 * np.sin(time),
        "engine_speed": np.full(len(time), 200.0),
        "gear_ratio": np.full(len(time), 1.3),
        "brake": np.zeros(len(time)),
        "kinematic_accel_x": 1.2 * np.cos(0.4 * time),
        "kinematic_accel_y": speed * rates["yaw_rate"],
        "east": np.cumsum(speed * np.cos(heading)) * STEP,
        "north": np.cumsum(speed * np.sin(heading)) * STEP,
        "altitude": 250.0 + 2.0 * np.sin(0.1 * time),
        "ref_grade": 0.01 * np.sin(0.1 * time),
        "ref_velocity_x": speed,
    }
    for wheel in WHEELS:
        table[f"wheel_speed_{wheel}"] = speed / 0.3
        table[f"drive_torque_{wheel}"] = 100.0 + 10 * np.sin(time)
        table[f"brake_torque_{wheel}"] = np.zeros(len(time))
        table[f"brake_pressure_{wheel}"] = np.zeros(len(time))
        table[f"ref_force_x_{wheel}"] = 300.0 * np.sin(time)
    return table


TRUTH = drive()


def test_ideal_suite_records_the_truth_of_every_channel() -> None:
    recording = measure(TRUTH, sensor_preset("ideal"))
    for name, column in TRUTH.items():
        if name not in CHANNELS or name == "time":
            continue
        signal = recording[name]
        stride = round(1000 / signal.rate)
        assert signal.values == pytest.approx(column[::stride], abs=1e-9), name
        assert signal.unit == CHANNELS[name].unit
    assert {"latitude", "longitude", "vertical_speed", "speed"} <= set(recording)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_same_seed_same_bits_another_seed_other_noise(name: str) -> None:
    suite = sensor_preset(name)
    a, b, c = (measure(TRUTH, suite, seed=seed) for seed in (3, 3, 4))
    assert set(a) == set(b) == set(c)
    for channel in a:
        assert np.array_equal(a[channel].values, b[channel].values)
        assert np.array_equal(a[channel].time, b[channel].time)
    differs = {n for n in a if not np.array_equal(a[n].values, c[n].values)}
    assert ("accel_x" in differs) == (name != "ideal")
    assert not any(n.startswith("ref_") for n in differs)
    json.dumps(a.metadata, allow_nan=False)


def test_one_sensor_less_leaves_the_others_noise_alone() -> None:
    suite = sensor_preset("automotive")
    whole = measure(TRUTH, suite, seed=1)
    fewer = measure({n: v for n, v in TRUTH.items() if not n.startswith("drive_torque")}, suite, seed=1)
    assert set(whole) - set(fewer) == {f"drive_torque_{w}" for w in WHEELS}
    for channel in fewer:
        assert np.array_equal(whole[channel].values, fewer[channel].values)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_brake_pressure_is_never_negative_and_keeps_its_offset(name: str) -> None:
    suite = sensor_preset(name)
    assert suite.brake_pressure is not None
    probe = replace(suite.brake_pressure, least=None)
    for seed in range(5):
        told = measure(TRUTH, suite, seed=seed)
        uncut = measure(TRUTH, replace(suite, brake_pressure=probe), seed=seed)
        for channel in told:
            expected = uncut[channel].values
            if channel.startswith("brake_pressure"):
                expected = np.maximum(expected, 0.0)
            assert np.array_equal(told[channel].values, expected)


def test_rates_are_native_and_the_log_has_gaps_between() -> None:
    recording = measure(TRUTH, sensor_preset("worn"))
    rates = {
        n: recording[n].rate for n in ("accel_x", "wheel_speed_fl", "engine_torque", "brake", "latitude")
    }
    assert rates == pytest.approx(
        {"accel_x": 100, "wheel_speed_fl": 50, "engine_torque": 20, "brake": 10, "latitude": 1}
    )
    log = to_log(recording)
    assert np.isfinite(log["wheel_speed_fl"]).mean() == pytest.approx(0.5, abs=0.01)
    assert np.isfinite(log["ref_grade"]).all()
    assert "steer" not in log


def test_imu_off_the_centre_feels_the_motion_of_its_place() -> None:
    """Oracle: differentiate twice the path of a point that is fixed to a turning body."""
    time = TRUTH["time"]
    r = np.array([1.2, -0.4, 0.3])
    yaw = 0.3 / 0.7 * (1 - np.cos(0.7 * time))
    truth = {"time": time, "yaw_rate": 0.3 * np.sin(0.7 * time)}
    truth |= dict.fromkeys(("roll_rate", "pitch_rate", "accel_x", "accel_y"), np.zeros(len(time)))
    truth["accel_z"] = np.full(len(time), GRAVITY)
    path = np.stack([np.cos(yaw) * r[0] - np.sin(yaw) * r[1], np.sin(yaw) * r[0] + np.cos(yaw) * r[1]])
    accel = np.gradient(np.gradient(path, STEP, axis=1), STEP, axis=1)
    along = np.cos(yaw) * accel[0] + np.sin(yaw) * accel[1]
    across = np.cos(yaw) * accel[1] - np.sin(yaw) * accel[0]
    seen = InertialUnit(place=tuple(r)).seen(truth, np.random.default_rng(0))
    inner = slice(5, -5)
    assert seen["accel_x"][inner] == pytest.approx(along[inner], abs=2e-6)
    assert seen["accel_y"][inner] == pytest.approx(across[inner], abs=2e-6)
    assert seen["accel_z"] == pytest.approx(GRAVITY)
    given = truth | {"yaw_accel": 0.21 * np.cos(0.7 * time)}
    given |= dict.fromkeys(("roll_accel", "pitch_accel"), np.zeros(len(time)))
    exact = InertialUnit(place=tuple(r)).seen(given, np.random.default_rng(0))
    assert exact["accel_y"][inner] == pytest.approx(seen["accel_y"][inner], abs=1e-6)


def test_tilted_imu_sees_gravity() -> None:
    """Pitched nose down by ε it reads −g sin ε along x at rest; rolled to the right, +g sin ε along y."""
    level = {"time": np.arange(50) * 0.01, "accel_z": np.full(50, GRAVITY)}
    level |= dict.fromkeys(("accel_x", "accel_y", "roll_rate", "pitch_rate", "yaw_rate"), np.zeros(50))
    for mounting, x, y in (((0, 0.02, 0), -1.0, 0.0), ((0.02, 0, 0), 0.0, 1.0), ((0, 0, 0.02), 0.0, 0.0)):
        suite = SensorSuite(imu=InertialUnit(mounting=mounting))
        recording = measure(level, suite)
        assert recording["accel_x"].values == pytest.approx(x * GRAVITY * np.sin(0.02), abs=1e-12)
        assert recording["accel_y"].values == pytest.approx(y * GRAVITY * np.sin(0.02), abs=1e-12)
    assert rotation(0.1, -0.2, 0.3) @ rotation(0.1, -0.2, 0.3).T == pytest.approx(np.eye(3))


def test_mounting_is_drawn_with_the_size_it_says() -> None:
    level = {"time": np.arange(3) * 0.01, "accel_z": np.full(3, GRAVITY)}
    level |= dict.fromkeys(("accel_x", "accel_y", "roll_rate", "pitch_rate", "yaw_rate"), np.zeros(3))
    suite = SensorSuite(imu=InertialUnit(mounting_std=0.01))
    tilts = [measure(level, suite, seed=s)["accel_x"].values[0] / GRAVITY for s in range(400)]
    assert np.std(tilts) == pytest.approx(0.01, rel=0.12)


def test_receiver_gives_position_on_the_earth() -> None:
    recording = measure(TRUTH, sensor_preset("ideal"))
    latitude, longitude = recording["latitude"].values, recording["longitude"].values
    north = np.deg2rad(latitude - latitude[0]) * 6_371_000.0
    east = np.deg2rad(longitude - longitude[0]) * 6_371_000.0 * np.cos(np.deg2rad(29.54))
    assert north == pytest.approx(TRUTH["north"][::100] - TRUTH["north"][0], abs=1e-6)
    assert east == pytest.approx(TRUTH["east"][::100] - TRUTH["east"][0], abs=1e-6)
    assert recording["speed"].values[1:-1] == pytest.approx(TRUTH["ref_velocity_x"][100:-1:100], abs=1e-3)
    climb = 0.2 * np.cos(0.1 * recording["vertical_speed"].time)
    assert recording["vertical_speed"].values[1:-1] == pytest.approx(climb[1:-1], abs=1e-5)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_errors_of_a_preset_are_of_the_size_it_says(name: str) -> None:
    suite = sensor_preset(name)
    assert suite.imu is not None
    errors = []
    for seed in range(30):
        signal = measure(TRUTH, suite, seed=seed)["accel_x"]
        errors.append(np.mean(signal.values - TRUTH["accel_x"][:: round(1000 / signal.rate)]))
    tilt = GRAVITY * suite.imu.mounting_std
    expected = np.hypot(suite.imu.accel.bias, tilt)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(expected, rel=0.45, abs=0.01)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mf4"])
def test_logs_survive_files(tmp_path: Path, suffix: str) -> None:
    log = to_log(measure(drive(2.0), sensor_preset("automotive"), metadata={"vehicle": "made up"}))
    path = write(log, tmp_path / f"drive{suffix}")
    again = read(path).resample()
    for name in log.channels:
        good = np.isfinite(log[name])
        kept = np.interp(
            log.time, again.time[np.isfinite(again[name])], again[name][np.isfinite(again[name])]
        )
        assert kept[good] == pytest.approx(log[name][good], rel=1e-6, abs=1e-6), name


def recorded() -> Recording:
    return measure(TRUTH, sensor_preset("paper"), seed=2)


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_faults_touch_what_they_name_and_nothing_else(kind: str) -> None:
    clean = recorded()
    hurt = inject(clean, [Fault(kind, "wheel_speed_f*", start=5.0, duration=3.0, size=2.0)], seed=1)
    for name in clean:
        same = np.array_equal(clean[name].values, hurt[name].values) and np.array_equal(
            clean[name].time, hurt[name].time
        )
        assert same == (not name.startswith("wheel_speed_f")), name
    json.dumps(hurt.metadata, allow_nan=False)


def test_each_fault_does_what_its_name_says() -> None:
    clean = recorded()["yaw_rate"]
    during = (clean.time >= 5) & (clean.time < 8)

    def hurt(kind: str, **figures: float) -> tuple[np.ndarray, np.ndarray]:
        signal = inject(recorded(), [Fault(kind, "yaw_rate", 5.0, 3.0, **figures)])["yaw_rate"]
        return signal.time, signal.values

    time, _ = hurt("dropout")
    assert np.array_equal(time, clean.time[~during])
    assert (hurt("stuck")[1][during] == clean.values[499]).all()
    assert np.array_equal(hurt("sign")[1][during], -clean.values[during])
    drifted = hurt("drift", size=0.1)[1] - clean.values
    assert drifted[during] == pytest.approx(0.1 * (clean.time[during] - 5.0))
    assert (drifted[~during] == 0).all()
    spikes = hurt("spike", size=0.7, spikes_per_second=10.0)[1] - clean.values
    assert 15 < np.sum(np.abs(spikes) > 0.69) < 50
    assert set(np.round(np.unique(spikes), 9)) <= {-0.7, 0.0, 0.7}
    assert hurt("time_jump", size=0.25)[0][500:] == pytest.approx(clean.time[500:] + 0.25)


def test_log_survives_a_clock_that_jumps_back() -> None:
    hurt = inject(recorded(), [Fault("time_jump", "*", start=10.0, size=-0.5)])
    with pytest.raises(InputError, match="runs backward"):
        hurt.resample()
    log = to_log(hurt)
    assert log.time[-1] == pytest.approx(19.5, abs=0.02)
    assert np.isfinite(log["accel_x"]).sum() == pytest.approx(1951, abs=2)


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (lambda: Fault("drop-out", "speed"), "did you mean 'dropout'"),
        (lambda: Fault("stuck", "speed", duration=0.0), "impossible"),
        (lambda: inject(recorded(), [Fault("stuck", "wheel_sped_fl")]), "did you mean 'wheel_speed_fl'"),
        (lambda: sensor_preset("automotiv"), "did you mean 'automotive'"),
        (lambda: measure({"time": np.zeros(5)}, sensor_preset("ideal")), "equidistant"),
        (lambda: measure({}, sensor_preset("ideal")), "equidistant"),
        (lambda: measure({"time": np.arange(5.0), "brake": np.zeros(4)}, SensorSuite()), "has shape"),
        (lambda: Probe(rate=np.inf), "rate"),
    ],
)
def test_what_cannot_be_is_refused(make: object, what: str) -> None:
    with pytest.raises(InputError, match=what):
        make()  # type: ignore[operator]


def test_measuring_twenty_minutes_takes_seconds() -> None:
    import time as clock

    truth = {n: np.tile(v, 10)[: 10 * (len(v) - 1)] for n, v in TRUTH.items()}
    truth["time"] = np.arange(len(truth["accel_x"])) * STEP
    begun = clock.process_time()
    measure(truth, sensor_preset("automotive"))
    assert clock.process_time() - begun < 15.0  # 200 s of drive; some 2 s on an idle machine
