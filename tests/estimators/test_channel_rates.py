"""A channel tells as much whatever other channels come between its samples."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from tests.estimators.friction_drives import lane_change, level_car

from roadstate.core import Log
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.vehicles import Vehicle

WITHIN = 4
"""Rows of the log for each sample of a channel."""


def noisy(log: Log) -> Log:
    rng, count = np.random.default_rng(0), len(log.time)
    felt = log["accel_x"] + rng.normal(0, 0.05, count)
    others = {"yaw_rate": 0.002, "accel_y": 0.05, "steer": 0.001, "pitch_rate": 0.003}
    return log.with_channels(
        {"accel_x": felt, **{name: rng.normal(0, std, count) for name, std in others.items()}}
    )


def row_by_row(log: Log) -> Log:
    """Every fourth row as it is; in those between, nothing comes."""
    step = log.time[1] - log.time[0]
    time = np.repeat(log.time, WITHIN) + np.tile(np.arange(WITHIN) * step / WITHIN, len(log.time))
    channels = {}
    for name, values in log.channels.items():
        channels[name] = np.full(len(time), np.nan)
        channels[name][::WITHIN] = values
    return Log(time, channels)


@pytest.mark.parametrize("name", ["joint", "tfobe", "friction-ukf"])
def test_rows_between_its_samples_make_a_channel_no_less_sure(
    vehicle: Vehicle, drive: Callable[..., Log], name: str
) -> None:
    speed = 14 + 4 * np.sin(np.arange(0, 30, 0.01))
    log = noisy(drive(speed, np.full(len(speed), 0.03)))
    few, many = (scan(build(name, vehicle, a.available), a) for a in (log, row_by_row(log)))
    for quantity in {"speed", "grade", "velocity_y"} & set(few.std):
        ratio = np.median(many.std[quantity][::WITHIN][500:] / few.std[quantity][500:])
        assert ratio == pytest.approx(1.0, abs=0.06), quantity


@pytest.mark.parametrize("name", ["friction-ukf", "lm-aekf", "two-stage"])
def test_nor_do_they_make_the_friction_less_sure(name: str) -> None:
    """A lane change: what a tire model errs by lasts, and averages away by the sample."""
    log, car = lane_change(), level_car()
    few, many = (scan(build(name, car, a.available), a) for a in (log, row_by_row(log)))
    np.testing.assert_allclose(many.std["friction_peak"][::WITHIN], few.std["friction_peak"], rtol=0.03)
