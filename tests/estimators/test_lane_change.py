"""A lane change that uses most of a slippery road's friction, on the reference plant."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import KMH, SATELLITE, Scenario, named, on_plant

from roadstate.core import Estimates, Log
from roadstate.estimators import build
from roadstate.run import batch

FRICTION, BEGINS = 0.4, 1.0  # and s from which on it counts


@pytest.fixture(scope="module")
def changes() -> list[tuple[Log, Estimates]]:
    """Recordings, and what `joint` says of them."""
    script = named("double-lane-change", speed=48 * KMH, friction=FRICTION)
    made = on_plant("family-car", Scenario("lane change", "a lane change", script), 4)
    logs = [without(log, SATELLITE) for log, _ in made]
    built = [build("joint", car, log.available) for log, (_, car) in zip(logs, made, strict=True)]
    return list(zip(logs, batch(built, logs), strict=True))


def late(log: Log) -> np.ndarray:
    """Samples that count."""
    return log.time - log.time[0] > BEGINS


def test_bounds_hold(changes: list[tuple[Log, Estimates]]) -> None:
    """Up to then stiffness tells more than friction does; but no bound may say that the road is dry."""
    below = [(said.values["friction_peak_lower"] <= FRICTION)[late(log)] for log, said in changes]
    above = [(said.values["friction_peak_upper"] >= FRICTION)[late(log)] for log, said in changes]
    assert np.mean(np.concatenate(below)) > 0.95
    assert np.mean(np.concatenate(above)) > 0.99


def test_sideslip_is_known(changes: list[tuple[Log, Estimates]]) -> None:
    off = [(said.values["velocity_y"] - log["ref_velocity_y"])[late(log)] for log, said in changes]
    std = [said.std["velocity_y"][late(log)] for log, said in changes]
    assert np.sqrt(np.mean(np.concatenate(off) ** 2)) < 0.03
    assert np.mean(np.abs(np.concatenate(off)) < 1.96 * np.concatenate(std)) > 0.92
