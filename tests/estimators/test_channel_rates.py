"""A channel tells as much whatever other channels come between its samples."""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest
from tests.estimators.friction_drives import lane_change, level_car

from roadstate.core import Log
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.estimators.intake import ROWS, Intake
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


@pytest.mark.parametrize(
    ("every", "name", "error"),
    [(1, "yaw_rate", 0.0), (10, "yaw_rate", 0.01), (10, "accel_y", 0.01), (10, "accel_x", 0.27)],
)
def test_what_a_bend_does_goes_on_between_samples_that_are_sparse(
    vehicle: Vehicle, every: int, name: str, error: float
) -> None:
    """A signal that rises by 3/s, of which every tenth sample comes: brakes may let go at any time."""
    intake = Intake(vehicle, [name])
    state, none = intake.init(), dict.fromkeys(intake.channels, jnp.asarray(np.nan))
    leans = {"accel_x": vehicle.body.pitch_gradient, "accel_y": vehicle.body.roll_gradient}
    scale = 1 + GRAVITY * leans.get(name, 0.0)
    worst = 0.0
    for k in range(60):
        true = 0.03 * k * scale
        sample = none | {name: jnp.asarray(true)} if k % every == 0 else none
        state, told = intake.read(state, sample, jnp.asarray(20.0), jnp.asarray(0.01))
        if k > 2 * every:
            worst = max(worst, abs(float(told.value[ROWS.index(name)]) - 0.03 * k))
    assert worst == pytest.approx(error, abs=0.02)


@pytest.mark.parametrize("name", ["friction-ukf", "lm-aekf", "two-stage"])
def test_nor_do_they_make_the_friction_less_sure(name: str) -> None:
    """A lane change: what a tire model errs by lasts, and averages away by the sample."""
    log, car = lane_change(), level_car()
    few, many = (scan(build(name, car, a.available), a) for a in (log, row_by_row(log)))
    np.testing.assert_allclose(many.std["friction_peak"][::WITHIN], few.std["friction_peak"], rtol=0.03)
