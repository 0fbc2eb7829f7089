"""Smoothing whole logs: against a dense solution, chunk by chunk, for every estimator that says it can be."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

from contracts.plausible import plausible_log
from oracles.batch import condition, trajectory
from roadstate.core import Estimates, InputError, Log
from roadstate.core.quantities import reference
from roadstate.estimators import all_estimators, build
from roadstate.filters import KF, GateRule
from roadstate.papers.base import MISMATCHED
from roadstate.papers.plants import told
from roadstate.run import scan, smooth
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.manoeuvres.script import STEP, Script
from roadstate.sim.plant import multibody_plant
from roadstate.sim.run import drive, truth_table
from roadstate.sim.sensors import measure, sensor_preset, to_log
from roadstate.vehicles import load_vehicle
from run.level import ALTITUDE_STD, CLIMB_STD, WHITE, Level
from run.odometer import Odometer

NAN = np.nan
ABLE = [name for name, kind in all_estimators().items() if kind.smoothable is not None]


def make_log(samples: int, seed: int = 0) -> Log:
    random = np.random.default_rng(seed)
    steps = random.uniform(0.01, 0.2, samples)
    accel = random.normal(size=samples)
    climb = np.cumsum((accel + WHITE * random.normal(size=samples)) * steps)
    channels = {
        "altitude": np.cumsum(climb * steps) + ALTITUDE_STD * random.normal(size=samples),
        "vertical_speed": climb + CLIMB_STD * random.normal(size=samples),
        "accel_z": accel,
    }
    channels["altitude"][random.random(samples) < 0.6] = NAN
    return Log(7.0 + np.cumsum(steps), channels)


def dense(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Altitude and its 1σ given all samples, by one solve."""
    dt = np.diff(log.time, prepend=log.time[0])
    one = np.ones_like(dt)
    F = np.stack([np.stack([one, dt]), np.stack([0 * one, one])]).transpose(2, 0, 1)
    b = np.stack([0 * dt, log["accel_z"] * dt], axis=1)
    Q = WHITE**2 * dt[:, None, None] * np.diag([0.04, 1.0])
    H, R = (
        np.tile(np.eye(2), (len(log), 1, 1)),
        np.tile(np.diag([ALTITUDE_STD, CLIMB_STD]) ** 2, (len(log), 1, 1)),
    )
    z = np.stack([log["altitude"], log["vertical_speed"]], axis=1)
    prior = trajectory(F, b, Q, np.zeros(2), np.diag([25.0, 4.0]))
    mean, cov = condition(*prior, H, np.zeros((len(log), 2)), R, z)
    return mean[::2], np.sqrt(np.diag(cov)[::2])


@pytest.mark.parametrize(("samples", "chunk"), [(1, 8), (2, 8), (7, 8), (8, 8), (9, 8), (61, 8), (61, 512)])
def test_a_linear_estimator_gives_the_dense_solution(
    samples: int, chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the chunks; times are uneven, samples are missing."""
    monkeypatch.setattr(import_module("roadstate.run.smooth"), "_CHUNK", chunk)
    log = make_log(samples)
    told = smooth(Level(), log)
    altitude, std = dense(log)
    np.testing.assert_allclose(told.values["altitude"], altitude, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(told.std["altitude"], std, rtol=1e-8)


def test_what_the_gate_refused_is_not_believed_on_the_way_back() -> None:
    log = make_log(60)
    wild, without = log["altitude"].copy(), log["altitude"].copy()
    place = np.flatnonzero(np.isfinite(wild))[10]
    wild[place], without[place] = wild[place] + 100, NAN
    gated = Level(filter=KF(gate=GateRule(threshold=30.0)))
    refused, missing = (smooth(gated, log.with_channels({"altitude": a})) for a in (wild, without))
    assert refused.metadata["rejected"]["altitude"] == 1
    np.testing.assert_allclose(refused.values["altitude"], missing.values["altitude"], rtol=1e-12)
    np.testing.assert_allclose(refused.std["altitude"], missing.std["altitude"], rtol=1e-12)


def test_the_rest_is_the_forward_passs() -> None:
    log = make_log(40)
    forward, back = scan(Level(), log), smooth(Level(), log)
    assert back.metadata == {**forward.metadata, "smoothed": ["altitude"]}
    for one, other in (
        (forward.values["speed"], back.values["speed"]),
        (forward.innovation, back.innovation),
        (forward.innovation_std, back.innovation_std),
        (forward.nis, back.nis),
        (forward.validity, back.validity),
    ):
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_progress_goes_there_and_back() -> None:
    calls: list[tuple[int, int]] = []
    smooth(Level(), make_log(1200), progress=lambda done, of: calls.append((done, of)))
    done = [d for d, _ in calls]
    assert done == sorted(done)
    assert calls[-1] == (1200, 1200)
    assert {of for _, of in calls} == {1200}


def test_what_cannot_be_smoothed_says_what_can() -> None:
    with pytest.raises(InputError, match=r"'odometer' cannot be smoothed.*joint") as refusal:
        smooth(Odometer(), make_log(3))
    assert "\n" not in str(refusal.value)
    assert set(ABLE) >= {"joint", "kmbe", "debe", "tfobe"}


@pytest.mark.parametrize("name", ABLE)
def test_every_estimator_that_says_so_can_be_smoothed(name: str) -> None:
    """From all channels there are; what it declares is told, the last sample is the filter's."""
    vehicle = load_vehicle("family-car")
    log = plausible_log(vehicle, 700)
    estimator = build(name, vehicle, [*log.available])
    forward, back = scan(estimator, log), smooth(estimator, log)
    smoothed = back.metadata["smoothed"]
    assert {"grade", "speed"} <= set(smoothed) <= set(forward.values)
    for quantity, values in back.values.items():
        np.testing.assert_allclose(values[-1], forward.values[quantity][-1], rtol=1e-9, atol=1e-9)
        assert np.isfinite(values).all(), quantity
    for quantity in smoothed:
        assert (back.std[quantity] > 0).all()
        # a mass' own changes with the mass that is found
        most = 1 + (1e-3 if quantity == "mass" else 1e-6)
        assert (back.std[quantity] <= forward.std[quantity] * most).mean() > 0.99
        assert back.std[quantity][100] < forward.std[quantity][100]
    np.testing.assert_allclose(back.nis, forward.nis, rtol=1e-6)


@pytest.fixture(scope="module")
def hilly() -> list[Log]:
    """The first forty seconds of a drive over slopes, on the reference plant, by seeds of the sensors."""
    vehicle = load_vehicle("family-car")
    whole = manoeuvre("straight-variable-speed").prepare(vehicle)
    script = replace(whole, script=Script(whole.script.table[: round(40.0 / STEP) + 1]))
    table = truth_table(drive(multibody_plant(vehicle), script, vehicle, rate=200.0))
    return [to_log(measure(table, sensor_preset("automotive"), seed=s, metadata={})) for s in range(2)]


def test_on_the_plant_it_is_nearer_and_honest(hilly: list[Log]) -> None:
    vehicle = load_vehicle("family-car")
    # as for the log of all channels above, so that one program serves both; what is not recorded is missing
    channels = plausible_log(vehicle, 1).available

    def errors(said: Estimates, log: Log) -> np.ndarray:
        true = reference("grade", log.channels)
        assert true is not None
        return said.values["grade"] - true

    ahead, behind, inside = [], [], []
    for seed, log in enumerate(hilly):
        estimator = build("joint", told(vehicle, MISMATCHED, seed), channels)
        forward, back = scan(estimator, log), smooth(estimator, log)
        ahead.append(errors(forward, log)[500:])
        behind.append(errors(back, log)[500:])
        inside.append(np.abs(behind[-1]) < 1.96 * back.std["grade"][500:])
    root_mean_square = [float(np.sqrt(np.mean(np.square(e)))) for e in (ahead, behind)]
    assert root_mean_square[1] < 0.7 * root_mean_square[0]
    assert root_mean_square[1] < 0.002
    assert np.mean(inside) > 0.9
