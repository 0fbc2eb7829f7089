"""Grade on the real recordings against the plain non-causal estimate; sideslip and forces of a race car."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks import race_car
from benchmarks.real_logs import load, of_friction, ours, plain, scores

from roadstate.core import Log
from roadstate.estimators import build
from roadstate.run import CHUNK, Stream, scan
from roadstate.vehicles import Vehicle


@pytest.fixture(scope="module")
def comma(shared_data: Path) -> tuple[Log, Vehicle]:
    files = [shared_data / "comma2k19" / "segment40_decoded_50Hz.csv.gz"]
    return load("comma2k19", files, [], "vehicle.yaml", "mapping.yaml")


@pytest.fixture(scope="module")
def css(shared_data: Path) -> tuple[Log, Vehicle]:
    folder = shared_data / "css_mf4"
    files = sorted(folder.glob("0*.MF4"))
    return load("css_mf4", files, [folder / "canmod-gps.dbc"], "vehicle.yaml", "mapping.yaml")


def test_kmbe_beats_the_plain_estimate_though_causal(comma: tuple[Log, Vehicle]) -> None:
    log, car = comma
    speed = car.wheels.radius * np.mean([log[f"wheel_speed_{w}"] for w in ("fl", "fr", "rl", "rr")], axis=0)
    baseline = plain(log, speed, 1.0)
    where = np.isfinite(baseline) & (log.time - log.time[0] >= 3.0)
    simple = scores(baseline, log, where)
    row, _ = ours("kmbe", log, car, where)
    assert row["r"] > simple["r"]
    assert row["MAE"] < simple["MAE"]
    assert row["MAE, bias removed"] < 0.36 < simple["MAE, bias removed"]
    assert row["coverage"] > 0.9


def test_debe_knows_what_it_does_not_know(comma: tuple[Log, Vehicle]) -> None:
    """Torque of unconfirmed scale, a converter, no brake signal: coarse, and its interval says so."""
    log, car = comma
    row, _ = ours("debe", log, car, log.time - log.time[0] >= 3.0)
    assert row["r"] > 0.9
    assert row["MAE"] < 1.3
    assert row["coverage"] > 0.9


def test_bumps_are_not_taken_for_ice(comma: tuple[Log, Vehicle]) -> None:
    """Streets in summer, driven with less than 0.2, and wheels that slip for a tenth of a second on bumps."""
    found = of_friction(*comma, "joint")
    assert found["used, at most"] < 0.25
    assert found["upper bound below 0.6"] == 0
    assert found["peak below 0.5"] < 0.2
    assert found["largest lower bound"] < 0.6


def test_both_estimators_on_the_long_drive(css: tuple[Log, Vehicle]) -> None:
    log, car = css
    second = log.time >= (log.time[0] + log.time[-1]) / 2
    for name, limit in (("kmbe", 1.0), ("debe", 1.05)):
        row, _ = ours(name, log, car, second)
        assert row["r"] > 0.79
        assert row["MAE, bias removed"] < limit
        assert row["coverage"] > 0.9


def test_a_stream_says_what_the_scan_says(comma: tuple[Log, Vehicle]) -> None:
    log, car = comma
    estimator = build("kmbe", car, log.available)
    whole = scan(estimator, log)
    stream = Stream(estimator)
    count = 300
    assert count < CHUNK
    for i, time in enumerate(log.time[:count]):
        now = stream.push(float(time), {c: float(v[i]) for c, v in log.channels.items()})
    np.testing.assert_allclose(
        float(now.values["grade"]), whole.values["grade"][count - 1], rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(float(now.std["grade"]), whole.std["grade"][count - 1], rtol=0, atol=1e-12)


@pytest.mark.usefixtures("optimised")
def test_a_race_car_at_its_limit(shared_data: Path) -> None:
    """Sideslip and axle forces from inertial sensors alone, and nothing hangs on the last digit."""
    files = [shared_data / "revs_250lm" / "run_20140222_01_01_03.csv.gz"]
    log, car = load("revs_250lm", files, [], "vehicle.yaml", "mapping.yaml")
    log = log.between(log.time[0], log.time[0] + 130.0)  # the first lap
    estimator = build("joint", car, log.available)
    there = scan(estimator, log)
    _, slip, r, inside, *forces = race_car.row("joint", there, log, car)
    assert float(slip) < 0.6
    assert float(r) > 0.93
    assert float(inside.rstrip(" %")) > 80
    assert max(float(share.rstrip(" %")) for share in forces) < 7
    nudged = scan(estimator, log.with_channels({"accel_y": log["accel_y"] * (1 + 1e-7)}))
    for quantity in ("velocity_y", "force_y_front", "friction_peak"):
        apart = np.abs(nudged.values[quantity] - there.values[quantity])
        assert np.max(apart / there.std[quantity]) < 0.01
