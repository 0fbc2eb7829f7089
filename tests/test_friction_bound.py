"""The bound of friction: its derivatives, a closed form, and what it must do with excitation and noise."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.accuracy import friction_bound as module
from benchmarks.accuracy.friction_bound import (
    FRICTION,
    friction_bound,
    moved,
    prior_std,
    quantile,
    sample_noises,
)
from benchmarks.accuracy.friction_truth import brush_slope, plant_tire, truth_of
from benchmarks.accuracy.friction_world import NOISES, SENSORS, STATES, equations, slopes, world_of

from roadstate.core import WHEELS, Log
from roadstate.sim.sensors import sensor_preset
from roadstate.sim.sensors.wheel_pulses import ToothSensor
from roadstate.vehicles import load_vehicle

_CAR = load_vehicle("family-car")
_TIRE = plant_tire(_CAR)
_LOAD = 0.5 * np.repeat(_CAR.static_axle_loads, 2)


def _log(
    slip: float, *, angle: float = 0.0, count: int = 300, dt: float = 0.01, friction: float = 0.8
) -> Log:
    """All wheels at one slip and slip angle, at 20 m/s, their torques with the forces."""
    force = _TIRE.forces(slip, angle, _LOAD, friction, 20.0)
    known = {"velocity_x": 20.0, "velocity_y": 0.0, "grade": 0.0, "bank": 0.0}
    channels = {f"ref_{name}": np.full(count, value) for name, value in known.items()}
    for i, w in enumerate(WHEELS):
        along, across = float(force.F_x[i]), float(force.F_y[i])
        torque = along * _CAR.wheels.radius
        wheel = {
            "ref_slip": slip, "ref_slip_angle": angle, "ref_load": _LOAD[i], "ref_friction": friction,
            "ref_force_x": along, "ref_force_y": across,
            "drive_torque": max(torque, 0.0), "brake_torque": max(-torque, 0.0),
        }  # fmt: skip
        channels |= {f"{name}_{w}": np.full(count, float(value)) for name, value in wheel.items()}
    return Log(np.arange(count) * dt, channels)


def _by_friction(slip: float) -> np.ndarray:
    """(4,) ∂F_x/∂ln μ by central differences, N."""
    up, down = (_TIRE.forces(slip, 0.0, _LOAD, 0.8 * f, 20.0).F_x for f in (1.001, 0.999))
    return np.asarray(up - down) / np.log(1.001 / 0.999)


def _one(log: Log, k: int = 100) -> tuple:
    """World, the truth of a sample, and its noise."""
    suite, truth = sensor_preset("automotive"), truth_of(log, _CAR, _TIRE)
    noise = sample_noises(truth, _CAR, suite, 0.01)
    return world_of(_CAR, _TIRE), *jax.tree.map(lambda a: jnp.asarray(a[k]), (truth, noise))


@pytest.mark.parametrize(("slip", "angle"), [(0.02, 0.0), (-0.08, 0.02), (0.01, 0.06)])
def test_slopes_are_those_of_central_differences(slip: float, angle: float) -> None:
    """By every state and noise, in the straight part of the tire's curve and beyond its peak."""
    world, truth, _ = _one(_log(slip, angle=angle))
    found = slopes(world, truth)
    whole = jax.jit(lambda y: jnp.concatenate(equations(world, truth, y)))
    found_whole = np.concatenate([np.asarray(part) for part in found])
    size = len(STATES) + len(NOISES)
    step = 1e-6
    for i, name in enumerate((*STATES, *NOISES)):
        y = np.zeros(size)
        y[i] = step
        differences = np.asarray(whole(jnp.asarray(y)) - whole(jnp.asarray(-y))) / (2 * step)
        np.testing.assert_allclose(found_whole[:, i], differences, rtol=1e-5, atol=2e-3, err_msg=name)


def test_slope_by_friction_is_the_tires() -> None:
    """Of the axles' forces, the torques and the accelerometer: nothing where the tire is a spring."""
    i, first = STATES.index("friction_slippery"), SENSORS.index("torque_fl")
    shares = []
    for slip in (-0.001, -0.03, -0.5):
        world, truth, _ = _one(_log(slip))
        found = slopes(world, truth)
        by_hand = _by_friction(slip)
        np.testing.assert_allclose(found.axles[:2, i], by_hand.reshape(2, 2).sum(axis=1), rtol=1e-4)
        np.testing.assert_allclose(found.sensors[first:, i], _CAR.wheels.radius * by_hand, rtol=1e-4)
        np.testing.assert_allclose(found.sensors[0, i], by_hand.sum() / _CAR.mass, rtol=1e-4)
        shares.append(by_hand.sum() / np.sum(truth.force_x))
    assert abs(shares[0]) < 0.01
    assert 0.1 < shares[1] < 0.6
    assert 1.0 < shares[2] < 1.3  # beyond its peak the curve falls, and on more grip from farther on


def test_step_is_backward_euler() -> None:
    """δx⁺ = δx + Δt A δx⁺ of the motion; grade and bank as their prior says; no time changes nothing."""
    world, truth, noise = _one(_log(-0.02, angle=0.03))
    at = slopes(world, truth)
    F, root_Q = (np.asarray(a) for a in moved(world, truth, at, noise, 0.01))
    x = np.random.default_rng(0).normal(size=len(STATES)) * 1e-2
    after = F @ x
    rates = np.asarray(at.motion[:, : len(STATES)]) @ np.concatenate([after[:3], x[3:]])
    np.testing.assert_allclose(after[:3], x[:3] + 0.01 * rates, rtol=1e-9)
    road = [STATES.index(f"{name}{what}") for name in ("grade", "bank") for what in ("", "_slope")]
    kept = np.setdiff1d(np.arange(3, len(STATES)), road)
    np.testing.assert_array_equal(after[kept], x[kept])
    np.testing.assert_allclose(after[road[2:]], world.bank.transition(0.2) @ x[road[2:]], rtol=1e-9)
    own = root_Q[road[2:]] @ root_Q[road[2:]].T
    np.testing.assert_allclose(own, world.bank.sqrt_Q(0.2) @ world.bank.sqrt_Q(0.2).T, rtol=1e-9)
    i = STATES.index("friction_grippy")
    assert root_Q[i] @ root_Q[i] == pytest.approx(0.1**2 / 300 * 0.2)
    still, none = moved(world, truth, at, noise, 0.0)
    np.testing.assert_allclose(still, np.eye(len(STATES)), atol=1e-15)
    assert not np.asarray(none).any()


def test_one_unknown_has_a_closed_form() -> None:
    """σ = 1/√(N hᵀR⁻¹h + 1/σ₀²) with all but friction known, in so little time that nothing moves."""
    count, slip = 200, -0.03
    log = _log(slip, count=count, dt=1e-8)
    known = dict.fromkeys(STATES, 1e-7) | {"friction_slippery": FRICTION}
    found = friction_bound(log, _CAR, known).friction["car"]

    more, less = (_TIRE.forces(slip + d, 0.0, _LOAD, 0.8, 20.0).F_x for d in (1e-4, -1e-4))
    by_friction, by_slip = _by_friction(slip), np.asarray(more - less) / 2e-4
    spin = 0.02 / np.sqrt(12)
    sensed = 5.0**2 + 1 / 12  # of either kind of torque sensor; the rear wheels have brakes only
    torque = sensed * np.array([2, 2, 1, 1]) + 2 * (_CAR.wheels.inertia * spin * 100) ** 2
    accel = np.sqrt(0.008**2 * 100 + 0.01**2 / 12)
    radius = _CAR.wheels.radius
    h = np.concatenate([[by_friction.sum() / _CAR.mass], radius * by_friction])
    slipped = np.concatenate([[by_slip / _CAR.mass], radius * np.diag(by_slip)]) * (radius * spin / 20.0)
    R = np.diag(np.concatenate([[accel**2], torque])) + slipped @ slipped.T
    information = h @ np.linalg.solve(R, h)
    expected = 1 / np.sqrt(np.arange(1, count + 1) * information + FRICTION**-2)
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_more_excitation_tells_more() -> None:
    """A car that rolls learns nothing of friction; the more slip up to the peak, the more it learns."""
    std = [friction_bound(_log(-slip), _CAR).friction["car"][-1] for slip in (0.0, 0.02, 0.05, 0.08)]
    assert std[0] == pytest.approx(FRICTION, rel=0.01)
    assert 0.97 * std[0] > std[1] > 1.5 * std[2] > 4 * std[3]
    gentle, hard = (friction_bound(_log(0.0, angle=a), _CAR).friction["front"][-1] for a in (0.01, 0.08))
    assert gentle == pytest.approx(FRICTION, rel=1e-2)
    assert hard < 0.1 * FRICTION


def test_what_was_known_fades_as_the_car_drives_on() -> None:
    """All but friction known, it loses as it rolls what the road drifts by, and just that."""
    brakes, rolls = _log(-0.05), _log(0.0)
    both = Log(
        np.arange(2 * len(brakes)) * 0.01,
        {name: np.concatenate([brakes[name], rolls[name]]) for name in brakes.channels},
    )
    known = dict.fromkeys(STATES, 1e-7) | {"friction_slippery": FRICTION}
    found = friction_bound(both, _CAR, known)
    last, end = found.friction["car"][[len(brakes) - 1, -1]]
    assert last < 0.1 * FRICTION
    drift = 0.1**2 / 300 * 20.0 * len(rolls) * 0.01
    assert end**2 - last**2 == pytest.approx(drift, rel=0.05)
    assert set(found.forces) == {f"force_{a}_{axle}" for a in "xy" for axle in ("front", "rear")}
    assert all(np.isfinite(std).all() for std in found.forces.values())


def test_better_sensors_lower_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """And what is known beforehand does."""
    log = _log(-0.05)
    usual = friction_bound(log, _CAR).friction["car"][-1]
    surer = friction_bound(log, _CAR, {"velocity_x": 1e-3, "radius": 1e-6}).friction["car"][-1]
    assert surer < 0.5 * usual
    suite = sensor_preset("automotive")
    assert isinstance(suite.wheel_speed, ToothSensor)
    assert suite.brake_torque is not None
    poor = replace(
        suite,
        wheel_speed=replace(suite.wheel_speed, resolution=0.2),
        brake_torque=replace(suite.brake_torque, gain_std=0.2, noise=50.0),
    )
    monkeypatch.setattr(module, "sensor_preset", lambda name: poor)
    assert friction_bound(log, _CAR).friction["car"][-1] > 1.02 * usual


def test_every_state_has_a_spread_before_the_drive() -> None:
    first = prior_std(_CAR, sensor_preset("automotive"))
    assert set(first) == set(STATES)
    assert all(value > 0 for value in first.values())


def test_pieces_of_road_are_learnt_apart() -> None:
    """Left wheels slide on one surface; of the other, under wheels that roll, nothing is told."""
    log = _log(-0.08, friction=0.3)
    grips = {f"ref_friction_{w}": np.full(len(log), 0.8) for w in ("fr", "rr")}
    rolls = {f"{name}_{w}": np.zeros(len(log)) for w in ("fr", "rr") for name in ("ref_slip", "brake_torque")}
    found = friction_bound(log.with_channels(grips | rolls), _CAR).friction["car"][-1]
    assert found == pytest.approx(FRICTION * 0.8 / 1.1, rel=0.01)


def test_a_mixtures_quantile() -> None:
    """Of one σ that of the normal distribution; of two, what drawing says."""
    assert quantile(np.full(5, 2.0), 0.5) == pytest.approx(2 * 0.67449, rel=1e-4)
    random = np.random.default_rng(0)
    std = np.array([0.1, 3.0])
    drawn = np.abs(random.normal(size=400_000) * random.choice(std, 400_000, p=[0.25, 0.75]))
    for share in (0.5, 0.9):
        assert quantile(std, share, np.array([1.0, 3.0])) == pytest.approx(
            np.quantile(drawn, share), rel=0.01
        )


def test_lag_shortens_as_a_brush_tires_does() -> None:
    """Secant 1 − θ + θ²/3, slope (1 − θ)²."""
    theta = np.linspace(0, 1, 11)
    np.testing.assert_allclose(brush_slope(1 - theta + theta**2 / 3), (1 - theta) ** 2, atol=1e-9)
