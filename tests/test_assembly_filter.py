"""An assembled model under a filter, on data of another model of the same car."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from roadstate.assembly import AssembledModel, assemble
from roadstate.core.channels import WHEELS
from roadstate.filters import EKF
from roadstate.observability import empirical_gramian, unobservable
from roadstate.tires import Brush
from roadstate.vehicles import RK4, LinearlyImplicit, SevenDof, SubSteps, ThreeDof, load_vehicle

CAR = load_vehicle("family-car")
RATE = 100.0


def simulated(
    friction: list[float], grade: float
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], np.ndarray]:
    """Fifteen seconds of a 7-DOF car that swerves, brakes and drives: what goes in, what is seen, Δt."""
    car = SevenDof.from_vehicle(CAR, tire=Brush(), friction=jnp.asarray(friction), grade=grade)
    t = jnp.arange(0, 15, 1 / RATE)
    steer = 0.09 * jnp.sin(2 * np.pi * 0.4 * t)
    force = 4500.0 * jnp.sin(2 * np.pi * 0.17 * t)  # N, in all
    drive, brake = jnp.maximum(force, 0) * 0.32 / 2, jnp.maximum(-force, 0) * 0.32 / 4

    def inputs(k: jax.Array) -> jax.Array:
        zero = jnp.zeros(())
        return jnp.stack([steer[k], zero, drive[k], drive[k], zero, zero, *[brake[k]] * 4])

    def step(x: jax.Array, k: jax.Array) -> tuple[jax.Array, dict[str, jax.Array]]:
        x = SubSteps(LinearlyImplicit(), 5).step(car, x, inputs(k), jnp.asarray(1 / RATE))
        return x, car.measure(x, inputs(k))

    start = jnp.asarray([22.0, 0, 0, *[22.0 / CAR.wheels.radius] * 4])
    seen = jax.tree.map(np.asarray, jax.jit(lambda: jax.lax.scan(step, start, jnp.arange(len(t))))()[1])
    known = {"steer": np.asarray(steer)} | {f"slip_{w}": seen[f"slip_{w}"] for w in WHEELS}
    return known, seen, np.full(len(t), 1 / RATE)


SEEN = {"speed": 0.05, "accel_x": 0.05, "accel_y": 0.05, "yaw_rate": 0.005}


def three_dof(grouping: str, sensors: dict[str, float]) -> AssembledModel:
    """v_x, v_y, r, friction and grade of a car on four tires whose slips are known.

    A wheel that turns against its rolling resistance slips: slips that were seen hold it already.
    """
    no_rolling = {"rolling_resistance": 0.0, "rolling_resistance_speed": 0.0}
    return assemble(
        ThreeDof.from_vehicle(CAR, tire=Brush(), **no_rolling),
        states=["speed", "velocity_y", "yaw_rate"],
        parameters=["friction", "grade"],
        groupings={"friction": grouping},
        sensors=list(sensors),
        noise={"speed": 0.02, "velocity_y": 0.02, "yaw_rate": 0.01, "friction": 0.005, "grade": 0.002},
        sensor_noise=sensors,
        prior={
            "speed": (22.0, 0.5),
            "velocity_y": (0.0, 0.1),
            "yaw_rate": (0.0, 0.05),
            "friction": (0.9, 0.25),
            "grade": (0.0, 0.1),
        },
        integrator=RK4(),
    )


def test_an_ekf_finds_friction_of_both_axles_and_grade() -> None:
    known, seen, dt = simulated([0.5, 0.5, 0.75, 0.75], 0.04)
    rng = np.random.default_rng(0)
    z = np.stack([seen[n] + s * rng.normal(size=len(dt)) for n, s in SEEN.items()], axis=1)
    model, ekf = three_dof("front_rear", SEEN), EKF()

    def step(state: Any, row: Any) -> tuple[Any, Any]:
        u, sample, interval = row
        state, info = ekf.step(model, state, u, sample, interval)
        return state, (ekf.posterior(state).mean, ekf.posterior(state).std, info.ok)

    run = jax.jit(lambda: jax.lax.scan(step, ekf.init(model), (known, jnp.asarray(z), jnp.asarray(dt)))[1])
    mean, std, ok = (np.asarray(v) for v in run())
    assert np.all(ok)
    rows = [model.index(n) for n in ("friction_front", "friction_rear", "grade")]
    late = slice(len(dt) // 2, None)
    error = mean[late][:, rows] - [0.5, 0.75, 0.04]
    assert np.all(np.abs(mean[0, rows] - [0.5, 0.75, 0.04]) > [0.2, 0.1, 0.02])  # it does not start there
    assert np.all(np.sqrt(np.mean(error**2, axis=0)) < [0.02, 0.03, 0.004])
    assert np.all(np.abs(error[-1]) < 4 * std[-1, rows])
    assert np.all(std[-1, rows] < [0.05, 0.05, 0.02])
    slide = mean[late, model.index("velocity_y")] - seen["velocity_y"][late]
    assert np.sqrt(np.mean(slide**2)) < 0.05


def test_four_frictions_behind_three_sensors_are_told_to_be_unobservable() -> None:
    """An instant of a_x, a_y, ṙ tells three combinations of four frictions, of two it tells both."""
    known, seen, dt = simulated([0.6] * 4, 0.0)
    three = {"accel_x": 0.05, "accel_y": 0.05, "yaw_accel": 0.05}
    for grouping in ("four", "front_rear"):
        model = three_dof(grouping, three)
        truth = np.full((len(dt), len(model.states)), 0.6)
        truth[:, :3] = np.stack([seen[n] for n in model.states[:3]], axis=1)
        truth[:, -1] = 0.0
        is_friction = np.array([n.startswith("friction") for n in model.states])
        spread = np.where(is_friction, 0.25, 1e-9)
        gramians = empirical_gramian(model, truth, known, jnp.asarray(dt), spread, window=1, every=25)
        hidden = [
            [d for d in unobservable(model.states, W, spread, remaining=0.999) if "friction" in d.words]
            for W in np.asarray(gramians)
        ]
        if grouping == "four":
            assert all(hidden)
        else:
            assert hidden[31] == []  # swerving and braking near the limit
