"""Scores against differences of what the ordinary scan leaves behind."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from calibration_case import SPEED_NOISE

from roadstate.calibration import likelihood as calibration
from roadstate.calibration.likelihood import Likelihood
from roadstate.calibration.parameters import Parameter, moved, select
from roadstate.calibration.scores import Rows, kept
from roadstate.core import InputError, Log
from roadstate.estimators import build
from roadstate.run import scan
from roadstate.vehicles import Vehicle

NOBODY = np.zeros(1, bool)


def parameter(car: Vehicle, name: str) -> Parameter:
    groups = ["mass", "aero", "radius"]
    return next(p for p in select(car, groups, tune=True).parameters if p.name == name)


def innovations(
    car: Vehicle, one: Parameter, free: float, name: str, sensor: str, log: Log
) -> tuple[np.ndarray, np.ndarray]:
    """ν and √S of a filter's sensor, by the scan that estimates."""
    estimator = build(name, moved(car, [one], np.array([free])), log.available)
    estimates, place = scan(estimator, log), estimator.sensors.index(sensor)
    return estimates.innovation[:, place], estimates.innovation_std[:, place]


def test_score_of_a_figure_is_that_of_innovations_with_their_covariance_held(
    car: Vehicle, hilly: Log
) -> None:
    one = parameter(car, "mass")
    # so that the balance of forces judges alone
    log = hilly.select(set(hilly.channels) - {"altitude", "vertical_speed"}).between(0.0, 10.0)
    (before, _), (here, std), (after, _) = (
        innovations(car, one, free, "joint", "traction", log) for free in (-1e-5, 0.0, 1e-5)
    )
    slope = (after - before) / 2e-5
    found = Likelihood(car, [one], {"log": log}, "joint")(np.zeros(1), NOBODY)
    assert found.gradient[0] == pytest.approx(-np.nansum(slope * here / std**2), rel=2e-3)
    assert found.information[0, 0] == pytest.approx(np.nansum((slope / std) ** 2), rel=2e-3)


def test_score_of_a_noise_level_is_that_of_the_whole_likelihood(car: Vehicle, level: Log) -> None:
    one = parameter(car, "sensors.speed.noise")
    free = np.array([np.log(2 * SPEED_NOISE / one.start)])  # so large that no sample is refused

    def log_likelihood(change: float) -> float:
        innovation, std = innovations(car, one, float(free[0]) + change, "kmbe", "speed", level)
        return float(-0.5 * np.nansum((innovation / std) ** 2 + 2 * np.log(std)))

    expected = (log_likelihood(1e-3) - log_likelihood(-1e-3)) / 2e-3
    found = Likelihood(car, [one], {"log": level}, "kmbe")(free, NOBODY)
    assert expected < 0
    assert found.gradient[0] == pytest.approx(expected, rel=2e-3)


def test_what_an_estimator_does_not_use_is_named(car: Vehicle, level: Log) -> None:
    parameters = select(car, ["mass", "friction"], tune=False).parameters
    unused = Likelihood(car, parameters, {"log": level}, "kmbe").unused()
    assert unused["tires.friction"] == "'kmbe' does not use it"


def test_logs_add_up(car: Vehicle, level: Log) -> None:
    one = parameter(car, "sensors.speed.noise")
    single = Likelihood(car, [one], {"log": level}, "kmbe")(np.zeros(1), NOBODY)
    twice = Likelihood(car, [one], {"a": level, "b": level}, "kmbe")(np.zeros(1), NOBODY)
    assert twice.gradient == pytest.approx(2 * single.gradient)
    assert twice.information == pytest.approx(2 * single.information)


def test_missing_channel_names_the_log(car: Vehicle, level: Log) -> None:
    with pytest.raises(InputError, match="other: 'joint' needs"):
        Likelihood(car, [parameter(car, "mass")], {"other": level.select(["speed"])}, "joint")


def test_failing_filter_says_where_and_when(
    car: Vehicle, level: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that takes a speed far off for a failure: no sample of a log makes a sound one fail."""

    def failing(estimator: Any, state: Any, info: Any) -> Rows:
        rows = kept(estimator, state, info)
        return rows._replace(ok=rows.ok & ~jnp.any(jnp.abs(info.innovation) > 50))

    monkeypatch.setattr(calibration, "kept", failing)
    speed = level["speed"].copy()
    speed[1200] += 60
    broken = level.with_channels({"speed": speed})
    likelihood = Likelihood(car, [parameter(car, "sensors.speed.noise")], {"broken": broken}, "kmbe")
    with pytest.raises(InputError, match=r"broken: the filter of 'kmbe' fails at t=60\.0"):
        likelihood(np.zeros(1), NOBODY)
