"""Wheel speed from tooth edges, against constant speeds, stops and a brute-force counter."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.core import InputError
from roadstate.sim.sensors import ToothSensor

TIME = np.arange(10_001) * 1e-3
PERFECT = ToothSensor(tooth_error=0.0, timer=0.0)


def read(sensor: ToothSensor, values: np.ndarray, seed: int = 0) -> np.ndarray:
    return sensor.read(TIME[: len(values)], values, np.random.default_rng(seed))[1]


@pytest.mark.parametrize("speed", [1.0, 20.0, 150.0])
def test_constant_speed_is_read_exactly_by_a_perfect_sensor(speed: float) -> None:
    reading = read(PERFECT, np.full(10_001, speed))
    assert reading == pytest.approx(speed, rel=1e-9)


def test_acceleration_is_read_with_a_delay_of_about_half_a_window() -> None:
    speed = 10.0 + 4.0 * TIME
    lag = (speed[::10] - read(PERFECT, speed)) / 4.0
    # half the time between the edges used, and on average half a tooth since the last of them
    assert lag[50:].mean() == pytest.approx(0.5 * 0.01 + 0.5 * np.mean(2 * np.pi / 48 / speed), rel=0.25)
    assert lag[50:].min() > 0


def test_edges_are_those_of_a_brute_force_counter() -> None:
    speed = 6.0 + 5.0 * np.sin(TIME)
    sensor = ToothSensor(teeth=24, tooth_error=0.0, timer=0.0)
    reading = read(sensor, speed, seed=4)
    angle = np.random.default_rng(4)
    angle.standard_normal(24)  # the places of the teeth are drawn first
    start = angle.uniform(0, 2 * np.pi)
    fine = np.linspace(0, 10, 1_000_001)
    turned = start + 6.0 * fine + 5.0 * (1 - np.cos(fine))
    count = np.floor(turned / (2 * np.pi / 24))
    edges = fine[1:][np.diff(count) > 0]
    for k in range(100, 1001, 50):
        passed, earlier = edges[edges <= 0.01 * k], edges[edges <= 0.01 * (k - 1)]
        if len(passed) > len(earlier):
            expected = (len(passed) - len(earlier)) * 2 * np.pi / 24 / (passed[-1] - earlier[-1])
            assert reading[k] == pytest.approx(expected, rel=2e-3)


def test_stop_is_seen_after_the_timeout_and_the_start_after_two_teeth() -> None:
    speed = np.concatenate([np.linspace(8.0, 0.0, 2000), np.zeros(3000), np.linspace(0.0, 8.0, 5001)])
    reading = read(PERFECT, speed)
    assert (reading >= 0).all()
    stopped = np.flatnonzero(reading == 0)
    assert 1.9 < TIME[::10][stopped[0]] < 2.0 + PERFECT.timeout + 0.15
    assert (reading[240:500] == 0).all()
    assert reading[-1] == pytest.approx(8.0, rel=0.02)
    assert reading[505] == 0.0  # not one tooth yet


def test_slowing_down_never_reads_more_than_a_tooth_since_the_last_edge_allows() -> None:
    speed = np.concatenate([np.full(3000, 2.0), np.full(7001, 0.05)])
    reading = read(PERFECT, speed)
    between = reading[310:325]
    assert (np.diff(between) <= 1e-9).all()
    assert between[-1] < 1.1


def test_direction_is_known_to_a_signed_sensor_only() -> None:
    speed = np.full(10_001, -5.0)
    assert read(PERFECT, speed) == pytest.approx(5.0, rel=1e-9)
    signed = ToothSensor(tooth_error=0.0, timer=0.0, is_signed=True)
    assert read(signed, speed) == pytest.approx(-5.0, rel=1e-9)


def test_misplaced_teeth_repeat_every_turn_and_average_out() -> None:
    speed = 2 * np.pi  # one turn a second: readings 0.01 s apart repeat after 100 of them
    reading = read(ToothSensor(tooth_error=0.02, timer=0.0), np.full(10_001, speed))
    assert reading[200:300] == pytest.approx(reading[300:400], abs=1e-6)
    assert 0.005 < np.std(reading) / speed < 0.05
    assert reading[200:700].mean() == pytest.approx(speed, rel=2e-3)


def test_timer_and_resolution_quantise() -> None:
    reading = read(ToothSensor(tooth_error=0.0, timer=1e-4, resolution=0.05), np.full(10_001, 30.03))
    assert reading / 0.05 == pytest.approx(np.round(reading / 0.05), abs=1e-9)
    assert 0.05 <= np.ptp(reading) < 1.0


def test_delay_shifts_the_reading() -> None:
    speed = 10.0 + 4.0 * TIME
    late = read(ToothSensor(tooth_error=0.0, timer=0.0, delay=0.05), speed)
    assert (read(PERFECT, speed) - late)[100:].mean() == pytest.approx(0.2, rel=0.02)


def test_standing_wheel_gives_zeros() -> None:
    assert (read(PERFECT, np.zeros(2001)) == 0).all()


@pytest.mark.parametrize("bad", [{"teeth": 0}, {"tooth_error": 0.5}, {"timeout": 0.0}, {"rate": np.nan}])
def test_impossible_sensors_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(InputError, match="tooth sensor"):
        ToothSensor(**bad)  # type: ignore[arg-type]
