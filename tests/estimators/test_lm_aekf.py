"""The LM-AEKF on a joint road: what each of its ideas is good for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.estimators.friction_drives import level_car, pull

from roadstate.core import Estimates, Log
from roadstate.estimators import build
from roadstate.papers.friction_measures import chatter, convergence_time, final_error, new_surface
from roadstate.run import scan
from roadstate.vehicles import Vehicle

NOISE = 0.05


@pytest.fixture(scope="module")
def car() -> Vehicle:
    return level_car()


@pytest.fixture(scope="module")
def joint(car: Vehicle) -> Log:
    """2 s on a friction of 0.2, then 0.8, with a slip that uses up neither."""
    friction = np.where(np.arange(600) < 200, 0.2, 0.8)
    return pull(car, friction, np.full(600, 0.02), 9.0, noise=NOISE)


def run(name: str, car: Vehicle, log: Log, **filter_options: Any) -> Estimates:
    return scan(build(name, car, log.available, as_printed=True, filter_options=filter_options), log)


def test_a_jump_is_found_within_a_third_of_a_second(car: Vehicle, joint: Log) -> None:
    found = run("lm-aekf", car, joint)
    assert convergence_time(new_surface, 0.05)(found, joint) < 0.3
    assert final_error(1.0)(found, joint) < 2.0
    assert chatter(new_surface, 1.0)(found, joint) < 0.2


def test_the_plain_filter_with_the_same_noises_does_not(car: Vehicle, joint: Log) -> None:
    found = run("friction-ekf", car, joint)
    assert not convergence_time(new_surface, 0.05)(found, joint) < 1.0


def test_without_the_fading_factor_a_jump_takes_longer(car: Vehicle, joint: Log) -> None:
    times = [
        convergence_time(new_surface, 0.05)(run("lm-aekf", car, joint, **options), joint)
        for options in ({}, {"fading": None})
    ]
    assert times[0] < 0.5 * times[1]


def test_without_the_fuzzy_noise_estimates_chatter(car: Vehicle, joint: Log) -> None:
    """The printed R is that of a sensor five times as good; fuzzy adaptation finds out."""
    restless, calm = (
        chatter(new_surface, 1.0)(run("lm-aekf", car, joint, **options), joint)
        for options in ({"fuzzy": None}, {})
    )
    assert calm < 0.3 * restless


def test_without_all_three_it_is_the_plain_filter(car: Vehicle, joint: Log) -> None:
    options = {"memory": None, "fading": None, "fuzzy": None}
    bare, plain = run("lm-aekf", car, joint, **options), run("friction-ekf", car, joint)
    for quantity, values in plain.values.items():
        np.testing.assert_allclose(bare.values[quantity], values, rtol=1e-7, atol=1e-9)
    for quantity, spread in plain.std.items():
        np.testing.assert_allclose(bare.std[quantity], spread, rtol=1e-7, atol=1e-9)


def test_limited_memory_forgets_a_surface_that_all_memory_keeps(car: Vehicle, joint: Log) -> None:
    """Nothing but the memory switched on: N samples after the jump little is left of the old surface."""
    late = joint.time >= new_surface(joint) + 0.75
    limited, whole = (
        np.abs(run("lm-aekf", car, joint, **o).values["friction_peak"][late] / 0.8 - 1)
        for o in (
            {"memory": 50, "fading": None, "fuzzy": None},
            {"memory": None, "fading": None, "fuzzy": None},
        )
    )
    assert limited.max() < 0.1
    assert limited.max() < 0.2 * whole.max()
