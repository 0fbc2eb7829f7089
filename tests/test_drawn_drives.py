"""Drives drawn at random: what is drawn, what is counted, and one that used to lead the estimator astray."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE
from benchmarks.drawn import drives
from benchmarks.drawn.__main__ import Row, cells, rows
from benchmarks.starts import STARTS, cuts
from benchmarks.starts import rows as start_rows
from benchmarks.stops import judged

from roadstate.core import WHEELS, Estimates, Log
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.vehicles import load_vehicle


def test_what_is_drawn() -> None:
    """Same seed, same drive; of many, grade and friction as the module says."""
    car = load_vehicle("family-car")
    one, same, other = (drives._manoeuvre(np.random.default_rng(s), drives.MIXED, car) for s in (1, 1, 2))
    np.testing.assert_array_equal(one.script.table, same.script.table)
    assert one.speed == same.speed != other.speed
    assert one.duration == pytest.approx(drives._SETTLES + drives.SECONDS)
    many = [drives._manoeuvre(np.random.default_rng(s), drives.MIXED, car) for s in range(16)]
    places = np.arange(50.0, 1500.0, 50.0)
    points = [m.road.at(places, np.zeros_like(places)) for m in many]
    friction = np.concatenate([np.asarray(p.friction) for p in points])
    assert friction.min() >= 0.1
    assert friction.max() <= 1.05
    assert 0.35 < np.mean(friction >= 0.75) < 0.65
    # a slope beyond unevenness: of heights 50 m apart
    grade = np.concatenate([np.diff(np.asarray(p.z)) / 50.0 for p in points])
    assert 0.02 < grade.std() < 0.08
    turning = np.array(
        [m.speed**2 * np.abs(np.asarray(p.curvature)).max() for m, p in zip(many, points, strict=True)]
    )
    assert turning.max() < 0.7 * 1.05 * GRAVITY
    # a winding road asks for more, and of a friction that stays
    winding = [drives._manoeuvre(np.random.default_rng(s), drives.WINDING, car) for s in range(16)]
    points = [m.road.at(places, np.zeros_like(places)) for m in winding]
    for road in points:
        assert np.ptp(np.asarray(road.friction)) == 0
    curvatures = np.array([np.abs(np.asarray(p.curvature)).max() for p in points])
    assert np.median([m.speed**2 for m in winding] * curvatures) > 2 * np.median(turning)


def test_what_is_counted_of_a_stop() -> None:
    """From when the brakes act: half of the samples off by 3 σ of the speed, all by a σ of the slope."""
    time = np.arange(400) / 100
    speed = np.where(time < 1, 28.0, 10 - 2 * time)
    log = Log(time, {"ref_velocity_x": speed, "ref_grade": np.zeros(400)})
    off = np.where(np.arange(400) % 2, 0.3, 0.0) + 5.0 * (time < 1)
    said = {"speed": speed + off, "grade": np.full(400, 0.02)}
    std = {"speed": np.full(400, 0.1), "grade": np.full(400, 0.02)}
    found = judged([Estimates(time, said, std, np.zeros(400, int))], [log], 1.0)
    expected = {"speed": 0.3 / np.sqrt(2), "inside": 50.0, "slope": 2.0, "slope inside": 100.0}
    assert found == pytest.approx(expected | {"below 5 m/s": 0.3 / np.sqrt(2)}, rel=0.01)


def test_what_is_counted() -> None:
    time = np.arange(400) / 100
    log = Log(
        time,
        {
            "ref_velocity_x": np.full(400, 10.0),
            "ref_grade": np.full(400, 0.0),
            **{f"ref_friction_{w}": np.where(time < 3, 0.5, 1.0) for w in WHEELS},
        },
    )
    values = {
        "speed": np.where(time < 1, 10.3, 10.1),
        "grade": np.full(400, 0.01),
        "friction_peak": np.full(400, 0.6),
        "friction_peak_lower": np.full(400, 0.4),
        "friction_peak_upper": np.full(400, 0.8),
    }
    std = {"speed": np.full(400, 0.1), "grade": np.full(400, 0.01), "friction_peak": np.full(400, 0.2)}
    found = rows(Estimates(time, values, std, np.zeros(400, np.int8)), log)
    assert set(found) == {"speed", "grade", "friction_peak"}
    assert found["speed"].inside == pytest.approx(0.75)
    assert found["speed"].above == pytest.approx(0.75)
    assert found["speed"].squared == pytest.approx(0.25 * 0.09 + 0.75 * 0.01)
    assert found["speed"].variance == pytest.approx(0.01)
    assert found["grade"].squared == pytest.approx((100 * np.tan(0.01)) ** 2)
    assert found["friction_peak"].inside == pytest.approx(0.75)
    assert found["friction_peak"].above == 1.0
    told = cells([Row(4.0, 1.0, 1.0, 1.0), Row(0.0, 1.0, 0.5, 0.9)])
    assert told == ["1.41", "1", "75.0 %", "55.0 %", "95.0 %"]


@pytest.mark.usefixtures("optimised")
def test_a_log_that_begins_with_wheels_that_spin_on_ice() -> None:
    """Without a receiver its speed used to run away to 50 m/s, its slope to -30 %."""
    log, car = drives.drawn(load_vehicle("family-car"), 13)
    log = without(log, SATELLITE)
    found = rows(scan(build("joint", car, log.available), log), log)
    assert found["speed"].squared < 0.2**2
    assert found["grade"].squared < 1.0**2
    assert found["grade"].inside > 0.85
    assert found["friction_peak"].above > 0.9
    for force in ("force_y_front", "force_y_rear", "force_x_front", "force_x_rear"):
        assert found[force].inside > 0.7


def test_logs_are_cut_where_a_wheel_slips_on_the_move() -> None:
    time = np.arange(0, 40, 0.01)
    speed = np.where(time < 5, 1.0, 10.0)  # it slips while it hardly moves, too
    slips = np.where((time < 6) | (time > 35), -0.3, 0.0)
    channels = {f"ref_slip_{w}": 0.01 * np.ones_like(time) for w in WHEELS}
    log = Log(time, {**channels, "ref_slip_rl": slips, "ref_velocity_x": speed})
    slip = STARTS[0]
    parts = list(cuts(log, slip.begins(log), np.random.default_rng(0)))
    assert parts
    for part in parts:
        assert 5 <= part.time[0] < 6  # not in the last ten seconds, either
        assert part.time[-1] - part.time[0] == pytest.approx(10, abs=0.02)
        assert part["ref_velocity_x"][0] == 10
    smooth = log.with_channels({"ref_slip_rl": 0 * slips})
    assert not list(cuts(smooth, slip.begins(smooth), np.random.default_rng(0)))


def test_what_is_counted_of_a_log_that_begins_in_a_bend() -> None:
    time = np.arange(0, 10, 0.01)
    truth = {f"ref_friction_{w}": np.full_like(time, 0.8) for w in WHEELS}
    log = Log(time, {**truth, "ref_velocity_y": 0 * time, "accel_y": np.where(time < 5, -3.0, 1.0)})
    begins = STARTS[1].begins(log)
    np.testing.assert_array_equal(begins, time < 5)
    values = {
        "friction_peak": np.where(time < 2, 0.4, 0.8),
        "friction_peak_lower": np.full_like(time, 0.3),
        "friction_peak_upper": np.where(time < 0.5, 0.5, 1.0),
        "velocity_y": np.where(time < 5, 0.1, 0.0),
    }
    std = {"velocity_y": np.full_like(time, 0.04), "friction_peak": np.full_like(time, 0.2)}
    said = Estimates(time, values, std, np.zeros(len(time), np.int8))
    friction, sideways = np.swapaxes(start_rows(said, log, STARTS[1]), 0, 1)
    np.testing.assert_allclose(friction[:, 0], np.array([1, 1, 0, 0]) * np.log(2) ** 2)
    np.testing.assert_allclose(friction[:, 1], [0, 1, 1, 1])
    np.testing.assert_allclose(sideways[:, 0], [0.01, 0.01, 0.01, 0])
    np.testing.assert_allclose(sideways[:, 1], [0, 0, 0, 1])
