"""Covariances against closed forms, and what counts as undetermined."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.calibration.parameters import select
from roadstate.calibration.uncertainty import BLOCK, covariance, dispersion, undetermined, unseen
from roadstate.vehicles import Vehicle

ALL = np.ones(2, bool)


def test_dispersion_of_white_scores_is_the_sum_of_their_variances() -> None:
    random = np.random.default_rng(1)
    time = np.arange(0.0, 6000.0, 0.1)
    mixing = np.array([[1.0, 0.0], [0.6, 0.8]])
    scores = mixing @ random.normal(size=(2, len(time)))
    expected = len(time) * mixing @ mixing.T
    assert dispersion([scores], [time]) == pytest.approx(expected, rel=0.15)


def test_dispersion_sees_that_scores_last() -> None:
    random = np.random.default_rng(2)
    time = np.arange(0.0, 6000.0, 0.1)
    lasting = np.repeat(random.normal(size=len(time) // 10), 10)[None]  # each for 1 s
    assert dispersion([lasting], [time])[0, 0] == pytest.approx(10 * len(time), rel=0.2)


def test_dispersion_joins_logs() -> None:
    random = np.random.default_rng(3)
    time = np.arange(0.0, 20 * BLOCK, 0.5)
    scores = random.normal(size=(2, len(time)))
    half = len(time) // 2
    parts = dispersion([scores[:, :half], scores[:, half:]], [time[:half], time[half:]])
    assert parts == pytest.approx(dispersion([scores], [time]), rel=1e-6)


def test_a_break_adds_nothing_to_the_dispersion() -> None:
    """However long: the sample after it counted once for each ten seconds of it."""
    random = np.random.default_rng(4)
    scores = random.normal(size=(1, 1200))
    scores[0, 600] = 30.0
    time = np.arange(1200) / 10
    found = [dispersion([scores], [np.where(time < 60, time, time + gap)]) for gap in (600.0, 36000.0)]
    assert found[0] == pytest.approx(found[1], rel=0.01)
    halves = dispersion([scores[:, :600], scores[:, 600:]], [time[:600], time[600:]])
    assert found[0] == pytest.approx(halves, rel=0.35)


def test_covariance_of_an_exact_model_is_the_posterior() -> None:
    H = np.array([[5.0, 2.0], [2.0, 3.0]])
    assert covariance(H, H, ALL) == pytest.approx(np.linalg.inv(H + np.eye(2)))
    assert covariance(H, H, ALL, use_prior=False) == pytest.approx(np.linalg.inv(H))


def test_covariance_of_a_wrong_model_is_the_sandwich() -> None:
    H, J = np.diag([4.0, 9.0]), np.diag([16.0, 9.0])
    assert np.diag(covariance(H, J, ALL, use_prior=False)) == pytest.approx([1.0, 1 / 9])


def test_a_figure_that_is_kept_adds_its_error() -> None:
    H = np.array([[100.0, 100.0], [100.0, 100.0]])  # only the sum shows
    alone = covariance(H, H, np.array([True, False]))
    assert alone[0, 0] == pytest.approx(1.0, rel=0.02)  # as wrong as the other may be


def test_another_figure_of_the_file_adds_its_error() -> None:
    H = np.array([[5.0, 2.0], [2.0, 3.0]])
    shift = np.array([0.3, -0.2])  # what 1σ of it does to the estimates
    whole = covariance(H, H, ALL, beside=((H + np.eye(2)) @ shift)[:, None])
    assert whole == pytest.approx(covariance(H, H, ALL) + np.outer(shift, shift))
    first = covariance(H, H, np.array([True, False]), beside=np.array([[6.0], [7.0]]))
    assert first[0, 0] == pytest.approx(covariance(H, H, np.array([True, False]))[0, 0] + 1.0)


def test_undetermined(car: Vehicle) -> None:
    parameters = select(car, ["mass", "driveline"], tune=False).parameters
    assert unseen(np.diag([50.0, 0.3])) == [1]
    assert undetermined(np.diag([50.0, 20.0]), np.diag([50.0, 20.0]), parameters, ALL) == {}


def test_what_shows_only_together_is_refused_worst_first(car: Vehicle) -> None:
    parameters = select(car, ["mass", "driveline"], tune=False).parameters
    scale = np.array([50.0, 30.0])  # only mass over efficiency shows, each in its own prior's 1σ
    H = np.outer(scale, -scale) * np.array([[-1, 1], [1, -1]])
    found = undetermined(H, H, parameters, ALL)
    assert found == {1: "shows only together with mass"}
    std = covariance(H, H, np.array([True, False]))[0, 0] ** 0.5
    assert std == pytest.approx(30 / 50, rel=1e-2)  # the mass is as wrong as the efficiency makes it
    same = np.full((2, 2), 1000.0)
    assert set(undetermined(same, same, parameters, ALL)) == {0, 1}
