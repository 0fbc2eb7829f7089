"""How the car moves: through wheel slip, spinning wheels and lane changes."""

from __future__ import annotations

import numpy as np
import pytest
from tests.estimators.friction_drives import FRICTION, lane_change, level_car, pull

from roadstate.core import Log
from roadstate.estimators import build
from roadstate.run import scan


def without(log: Log, *channels: str) -> Log:
    return log.select([c for c in log.channels if c not in channels])


@pytest.fixture(scope="module")
def noisy() -> Log:
    return lane_change("paper", seed=3)


def test_lateral_velocity_is_found_within_its_deviation(noisy: Log) -> None:
    """Without a sensor for it: from a_y, r and a tire model whose friction is only roughly known."""
    log = without(noisy, "velocity_y")
    found = scan(build("friction-ukf", level_car(), log.available), log)
    error = found.values["velocity_y"] - log["ref_velocity_y"]
    moving = log.time > 1.0
    assert np.std(log["ref_velocity_y"]) > 0.1  # there is something to find
    assert np.sqrt(np.mean(error[moving] ** 2)) < 0.06
    assert np.mean(np.abs(error) < 1.96 * found.std["velocity_y"]) > 0.9


def test_speed_is_found_within_its_deviation(noisy: Log) -> None:
    log = without(noisy, "speed", "velocity_y")
    found = scan(build("friction-ukf", level_car(), log.available), log)
    error = (found.values["speed"] - log["ref_velocity_x"])[log.time > 1.0]
    assert np.sqrt(np.mean(error**2)) < 0.05
    assert np.mean(np.abs(error) < 1.96 * found.std["speed"][log.time > 1.0]) > 0.85


@pytest.mark.parametrize("sign", [1, -1])
def test_wheels_that_all_spin_or_lock_do_not_carry_the_speed_away(sign: int) -> None:
    """Slip grows to a half in half a second, stays for one, and is gone: the accelerometer knows better."""
    car, count = level_car(), 500
    knots, level = (1.0, 1.5, 2.5, 2.7), 0.5 * sign
    slip = np.interp(np.arange(count) / 100, knots, (0.0, level, level, 0.0))
    log = without(pull(car, np.full(count, 0.3), slip, 20.0, noise=0.05), "speed", "velocity_y")
    found = scan(build("friction-ukf", car, log.available), log)
    error = found.values["speed"] - log["ref_velocity_x"]
    assert np.abs(error[:250]).max() < 0.4
    assert np.abs(error).max() < 1.5  # as they come back, wheels are believed a little early
    assert np.abs(error[290:]).max() < 0.05
    sliding = (log.time > 1.6) & (log.time < 2.4)
    assert found.values["friction_peak"][sliding][-1] == pytest.approx(0.3, abs=0.05)


def test_a_wrong_friction_widens_the_lateral_velocity_near_the_limit(noisy: Log) -> None:
    log = without(noisy, "velocity_y")
    found = scan(build("friction-ukf", level_car(), log.available), log)
    used = np.abs(log["accel_y"]) / 9.81 / FRICTION
    spread = found.std["velocity_y"]
    assert used.max() > 0.4
    assert spread[used > 0.4].mean() > 1.1 * spread[(used < 0.1) & (log.time > 1)].mean()
