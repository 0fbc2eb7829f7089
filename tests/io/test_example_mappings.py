"""The example mappings on the drives they are for: signs, axes and delays against physics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import Log, Recording, Signal
from roadstate.io.files import read, read_all
from roadstate.io.mapping import load_mapping

Array = NDArray[np.float64]
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
G = 9.81


def smooth(values: Array, count: int) -> Array:
    return np.convolve(values, np.ones(count) / count, mode="same")


def fit(x: Array, y: Array) -> tuple[float, float]:
    """Correlation, and slope of y over x."""
    return float(np.corrcoef(x, y)[0, 1]), float(np.polyfit(x, y, 1)[0])


# --- comma2k19: 50 Hz on one base ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def segment(shared_data: Path) -> Recording:
    return read(shared_data / "comma2k19" / "segment40_decoded_50Hz.csv.gz")


def comma(segment: Recording, name: str) -> tuple[Log, Array, slice]:
    """The log, the speed by its wheels in m/s, and the samples away from the ends."""
    log = load_mapping(EXAMPLES / "comma2k19" / name).apply(segment, wheel_radius=0.352).resample()
    speed = 0.352 * np.mean([log[f"wheel_speed_{w}"] for w in ("fl", "fr", "rl", "rr")], axis=0)
    return log, speed, slice(100, -100)


@pytest.mark.parametrize(("name", "bias"), [("mapping.yaml", -0.06), ("mapping_phone.yaml", -0.72)])
def test_comma_accel_x_counts_forward_and_uphill(segment: Recording, name: str, bias: float) -> None:
    log, speed, inner = comma(segment, name)
    expected = np.gradient(smooth(speed, 50), log.time) + G * np.sin(log["ref_grade"])
    measured = smooth(log["accel_x"], 50)
    r, slope = fit(expected[inner], measured[inner])
    assert r > 0.985
    assert 0.97 < slope < 1.13
    assert np.mean((measured - expected)[inner]) == pytest.approx(bias, abs=0.03)


@pytest.mark.parametrize("name", ["mapping.yaml", "mapping_phone.yaml"])
def test_comma_turning_is_to_the_left_for_all_that_sense_it(segment: Recording, name: str) -> None:
    """Against the steering wheel, whose own sign is that of the pose's path (see the example's comments)."""
    log, speed, inner = comma(segment, name)
    turning = smooth(speed * log["steering_wheel"], 50)[inner]
    assert fit(turning, smooth(log["yaw_rate"], 50)[inner])[0] > 0.9
    lateral = smooth(speed * log["yaw_rate"], 50)[inner]
    r, slope = fit(lateral, smooth(log["accel_y"], 50)[inner])
    assert r > 0.75
    assert 0.6 < slope < 1.5


def test_comma_steering_is_to_the_left_where_the_pose_turns_left(
    segment: Recording, shared_data: Path
) -> None:
    log, speed, inner = comma(segment, "mapping.yaml")
    pose = shared_data / "comma2k19" / "segment40" / "global_pose"
    time = np.load(pose / "frame_times", allow_pickle=False)
    position = np.load(pose / "frame_positions", allow_pickle=False)
    velocity = np.load(pose / "frame_velocities", allow_pickle=False)
    up = position[0] / np.linalg.norm(position[0])
    east = np.cross([0.0, 0.0, 1.0], up)
    east /= np.linalg.norm(east)
    heading = np.unwrap(np.arctan2(velocity @ np.cross(up, east), velocity @ east))
    rate = np.gradient(smooth(heading, 11), time)
    horizontal = np.linalg.norm(velocity - np.outer(velocity @ up, up), axis=1)
    shifts = np.arange(time[0] - 1.0, time[0] + 1.0, 0.01)  # the CSV starts anew at zero
    start = min(
        shifts, key=lambda s: np.sum((np.interp(log.time + s, time, horizontal) - log["ref_velocity_x"]) ** 2)
    )
    turning = smooth(np.interp(log.time + start, time, rate), 50)[inner]
    assert fit(turning, smooth(log["yaw_rate"], 50)[inner])[0] > 0.85
    assert fit(turning, smooth(speed * log["steering_wheel"], 50)[inner])[0] > 0.85
    assert fit(turning, smooth(log["accel_y"], 50)[inner])[0] > 0.8


def test_comma_phone_points_up_and_pitches_nose_down_positive(segment: Recording) -> None:
    log, _, inner = comma(segment, "mapping_phone.yaml")
    assert np.mean(log["accel_z"]) == pytest.approx(9.66, abs=0.02)
    climb = np.gradient(smooth(log["ref_grade"], 25), log.time)
    assert fit(smooth(climb, 50)[inner], smooth(log["pitch_rate"], 50)[inner])[0] < -0.9


def test_comma_ignores_the_pose(segment: Recording) -> None:
    for name in ("mapping.yaml", "mapping_phone.yaml"):
        log, _, _ = comma(segment, name)
        sources = {c: s for c, s in log.metadata["mapped"].items() if not c.startswith("ref_")}
        assert not [s for s in sources.values() if "pose" in s or "ref" in s]


# --- CSS: raw CAN, each message in its own time ----------------------------------------------------------


@pytest.fixture(scope="module")
def drive(shared_data: Path) -> Recording:
    folder = shared_data / "css_mf4"
    raw = read_all(sorted(folder.glob("0*.MF4")), dbc=[folder / "canmod-gps.dbc"])
    return load_mapping(EXAMPLES / "css_mf4" / "mapping.yaml").apply(raw)


def valid(signal: Signal) -> tuple[Array, Array]:
    good = np.isfinite(signal.values)
    return signal.time[good], signal.values[good]


def mean_between(signal: Signal, start: Array, stop: Array) -> Array:
    """Mean of a signal between two instants, by its integral."""
    time, values = valid(signal)
    total = np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2 * np.diff(time))])
    return (np.interp(stop, time, total) - np.interp(start, time, total)) / (stop - start)


def changes(drive: Recording) -> tuple[Array, Array, Array, Array]:
    """Of neighbouring GNSS speeds above 5 m/s: both instants, their acceleration, the mean speed."""
    time, speed = valid(drive["speed"])
    near = (np.diff(time) < 1.2) & (speed[1:] > 5) & (speed[:-1] > 5)
    start, stop = time[:-1][near], time[1:][near]
    return start, stop, np.diff(speed)[near] / (stop - start), ((speed[1:] + speed[:-1]) / 2)[near]


def without_slow_part(values: Array) -> Array:
    return values - smooth(values, 15)


def test_css_invalid_samples_are_missing(drive: Recording) -> None:
    for name, least in (("accel_z", 3.0), ("latitude", 55.0), ("longitude", 9.0), ("speed", 0.0)):
        values = drive[name].values
        assert np.isnan(values).any() or name == "latitude"
        assert np.nanmin(values) >= least
    assert np.isnan(drive["latitude"].values).mean() == pytest.approx(0.049, abs=0.002)


def test_css_imu_points_up_and_forward(drive: Recording) -> None:
    assert np.nanmean(drive["accel_z"].values) == pytest.approx(9.67, abs=0.03)
    start, stop, change, _ = changes(drive)
    forward = mean_between(drive["accel_x"], start, stop)
    r, slope = fit(without_slow_part(change), without_slow_part(forward))
    assert r > 0.88
    assert slope == pytest.approx(0.9, abs=0.1)
    # levelled on the first half; over the whole drive what the second half moved by is left
    assert np.mean(forward - change) == pytest.approx(0.05, abs=0.03)


def test_css_mounting_angles_leave_no_turning_in_accel_x(drive: Recording) -> None:
    """Of the lateral acceleration, little is left in accel_x; without the yaw angle 0.14 would be."""
    start, stop, change, pace = changes(drive)
    turning = pace * mean_between(drive["yaw_rate"], start, stop)
    lateral = mean_between(drive["accel_y"], start, stop)
    r, slope = fit(turning, lateral)
    assert r > 0.8
    assert 0.7 < slope < 1.1
    left_over = without_slow_part(mean_between(drive["accel_x"], start, stop) - change)
    assert abs(fit(without_slow_part(turning), left_over)[1]) < 0.07
    # gravity does not lean sideways on average
    assert abs(np.nanmean(drive["accel_y"].values)) < 0.1


def test_css_the_path_turns_left_where_the_yaw_rate_is_positive(drive: Recording) -> None:
    time, latitude = valid(drive["latitude"])
    longitude = valid(drive["longitude"])[1]
    x = np.radians(longitude) * np.cos(np.radians(56)) * 6.37e6
    y = np.radians(latitude) * 6.37e6
    steps = (np.diff(time) < 1.2) & (np.hypot(np.diff(x), np.diff(y)) > 8)
    course = np.arctan2(np.diff(y), np.diff(x))
    both = steps[1:] & steps[:-1]
    turned = ((np.diff(course) + np.pi) % (2 * np.pi) - np.pi)[both]
    middle = (time[1:] + time[:-1]) / 2
    start, stop = middle[:-1][both], middle[1:][both]
    r, slope = fit(mean_between(drive["yaw_rate"], start, stop), turned / (stop - start))
    assert r > 0.75  # positions come in steps of 0.1 m
    assert slope == pytest.approx(0.95, abs=0.15)


def test_css_delays_bring_speed_acceleration_and_path_together(drive: Recording) -> None:
    """The lag left after the mapping, where forward specific force follows the change of GNSS speed best."""
    start, stop, change, _ = changes(drive)
    lags = np.arange(-0.4, 0.41, 0.02)
    follow = [
        fit(
            without_slow_part(change),
            without_slow_part(mean_between(drive["accel_x"], start + lag, stop + lag)),
        )[0]
        for lag in lags
    ]
    assert abs(lags[int(np.argmax(follow))]) <= 0.04


def test_css_obd_leads_as_the_mapping_says(shared_data: Path, drive: Recording) -> None:
    """OBD speed is no channel there, but the clock of its replies is what the delays count from."""
    folder = shared_data / "css_mf4"
    obd = read_all(sorted(folder.glob("0*.MF4")))["obd.vehicle_speed"]
    speed = obd.values / 3.6
    span = obd.time[2:] - obd.time[:-2]
    near = (span < 1.2) & (speed[1:-1] > 5)
    change = ((speed[2:] - speed[:-2]) / span)[near]
    start, stop = obd.time[:-2][near], obd.time[2:][near]
    lags = np.arange(-0.4, 0.41, 0.02)
    follow = [
        fit(
            without_slow_part(change),
            without_slow_part(mean_between(drive["accel_x"], start + lag, stop + lag)),
        )[0]
        for lag in lags
    ]
    assert abs(lags[int(np.argmax(follow))]) <= 0.06


def test_css_engine_torque_drives_the_car(drive: Recording) -> None:
    """Force by torque, engine speed and road speed, against mass times specific force; no height in it."""
    start, stop, _, pace = changes(drive)
    torque = mean_between(drive["engine_torque"], start, stop)
    force = 0.92 * torque * mean_between(drive["engine_speed"], start, stop) / pace
    pulling = torque > 10
    _, slope = fit(force[pulling], 1400 * mean_between(drive["accel_x"], start, stop)[pulling])
    assert slope == pytest.approx(1.0, abs=0.1)
    assert np.nanmin(drive["engine_torque"].values) == -18.0


def test_css_reference(drive: Recording) -> None:
    """The road's grade agrees with a plain, non-causal reading of the IMU; its own error is known."""
    time, grade = valid(drive["ref_grade"])
    assert len(time) == pytest.approx(1897, abs=5)
    forward = mean_between(drive["accel_x"], time - 1.5, time + 1.5)
    at, speed = valid(drive["speed"])
    change = (np.interp(time + 1.5, at, speed) - np.interp(time - 1.5, at, speed)) / 3
    near = np.interp(time, at[:-1], np.diff(at)) < 1.5
    plain = (forward - change)[near] / G
    assert fit(plain, grade[near])[0] > 0.82
    error = 100 * (plain - grade[near])
    assert np.mean(np.abs(error - error.mean())) < 0.9
    assert 100 * drive.metadata["reference_std"]["ref_grade"] == pytest.approx(0.74, abs=0.05)
