"""Integrators: order, and stability where the wheels are stiff."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.vehicles.drive import held, rolling, simulate

from roadstate.tires import Linear
from roadstate.vehicles import RK4, Euler, Integrator, LinearlyImplicit, SevenDof, SubSteps, load_vehicle
from roadstate.vehicles.model import Stiff

CAR = load_vehicle("family-car")
MODEL = SevenDof.from_vehicle(CAR)
R = CAR.wheels.radius
IMPLICIT = LinearlyImplicit()
SLIDING_START = [15.0, 0.5, 0.2, 50.0, 49.0, 48.0, 47.0]


@eqx.filter_jit
def endpoint(model: SevenDof, integrator: Integrator, steps: jax.Array, duration: float) -> jax.Array:
    """State after ``steps`` steps; any number of them compiles once."""
    drive = {n: 200.0 for n in model.inputs if n.startswith("drive")}
    brake = {n: 0.0 for n in model.inputs if n.startswith("brake")}
    u, dt = model.input_vector({"steer": 0.03, **drive, **brake}), duration / steps
    start = jnp.asarray(SLIDING_START)
    return jax.lax.fori_loop(0, steps, lambda _, x: integrator.step(model, x, u, dt), start)


@pytest.mark.parametrize("integrator", [Euler(), RK4(), IMPLICIT], ids=lambda i: i.name)
def test_order_of_convergence(integrator: Integrator) -> None:
    """On the full model, wheels and body; the linear tire is smooth."""
    model = SevenDof.from_vehicle(CAR, tire=Linear())
    exact = endpoint(model, RK4(), jnp.asarray(4096), 0.02)
    counts = jnp.asarray([64, 128, 256, 512])
    errors = [float(jnp.max(jnp.abs(endpoint(model, integrator, n, 0.02) - exact))) for n in counts]
    measured = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(measured - integrator.order) < 0.25), measured


@pytest.mark.parametrize("integrator", [Euler(), RK4(), IMPLICIT, SubSteps(Euler(), 3)])
@pytest.mark.parametrize("start", [SLIDING_START, [0.0] * 7, [5.0, 0, 0, 0, 0, 0, 0]])
def test_no_time_no_change(integrator: Integrator, start: list[float]) -> None:
    x = jnp.asarray(start)
    u = held(MODEL, 1, {"drive_torque": 300.0, "brake_torque": 100.0, "steer": 0.1})[0]
    assert np.array_equal(integrator.step(MODEL, x, u, jnp.asarray(0.0)), x)


def test_substeps_are_the_steps_written_out() -> None:
    x, u = jnp.asarray(SLIDING_START), held(MODEL, 1, {"drive_torque": 300.0})[0]
    by_hand = x
    for _ in range(5):
        by_hand = RK4().step(MODEL, by_hand, u, jnp.asarray(0.0002))
    np.testing.assert_allclose(SubSteps(RK4(), 5).step(MODEL, x, u, jnp.asarray(0.001)), by_hand, rtol=1e-13)
    with pytest.raises(ValueError, match="at least 1"):
        SubSteps(RK4(), 0)


class Decay(eqx.Module):
    """ẋ = λx, with the right damping or a wrong one."""

    rate: jax.Array
    claimed: jax.Array

    def derivative(self, x: jax.Array, u: Any) -> jax.Array:
        return self.rate * x

    def stiff(self, x: jax.Array, u: Any) -> Stiff:
        return Stiff(self.rate * x, jnp.zeros(1), self.claimed.reshape(1, 1))


@pytest.mark.parametrize("factor", [1.0, 2.0, 5.0])
def test_any_decay_is_damped_without_overshoot(factor: float) -> None:
    """Also where the damping is overrated."""
    step = eqx.filter_jit(IMPLICIT.step)
    for rate in 10.0 ** np.arange(-1, 8):
        model, z = Decay(jnp.asarray(-rate), jnp.asarray(-rate * factor)), -rate * 0.01
        after = float(step(model, jnp.ones(1), None, jnp.asarray(0.01))[0])
        assert 0 < after < 1
        if factor == 1:
            np.testing.assert_allclose(after, 1 / (1 - z) - 0.5 * z**2 / (1 - z) ** 3, rtol=1e-9)


class Saturated(eqx.Module):
    """ẋ = −λ tanh(x/w)·w: stiff about zero, a constant pull beyond w."""

    rate: jax.Array
    width: float = 0.01

    def derivative(self, x: jax.Array, u: Any) -> jax.Array:
        return -self.rate * self.width * jnp.tanh(x / self.width)

    def stiff(self, x: jax.Array, u: Any) -> Stiff:
        return Stiff(self.derivative(x, u), jnp.zeros(1), jnp.diag(self.derivative(x, u) / x))


@pytest.mark.parametrize("rate", [1e3, 1e4, 1e6])
def test_a_saturated_pull_brings_to_rest_and_not_beyond(rate: float) -> None:
    x, dt = jnp.ones(1), jnp.asarray(0.01)
    step, path = eqx.filter_jit(IMPLICIT.step), [1.0]
    for _ in range(30):
        x = step(Saturated(jnp.asarray(rate)), x, None, dt)
        path.append(float(x[0]))
    assert np.all(np.diff(path) < 0)
    assert 0 < path[-1] < (0.9 if rate == 1e3 else 1e-3)


def test_dry_friction_stops_and_holds() -> None:
    """A block pushed with 1 m/s² and held by 3 m/s² of friction: 2 m/s² of braking, then rest, exactly."""

    class Block(eqx.Module):
        push: float

        def derivative(self, x: jax.Array, u: Any) -> jax.Array:
            return self.stiff(x, u).derivative

        def stiff(self, x: jax.Array, u: Any) -> Stiff:
            from roadstate.vehicles.model import soft_sign

            dry = jnp.full(1, 3.0)
            return Stiff(self.push - dry * soft_sign(x), dry, jnp.zeros((1, 1)))

    x, dt = jnp.ones(1), jnp.asarray(0.03)
    step = eqx.filter_jit(IMPLICIT.step)
    for i in range(30):
        x = step(Block(1.0), x, None, dt)
        np.testing.assert_allclose(x[0], max(1 - 2 * 0.03 * (i + 1), 0), atol=1e-12)
    assert x[0] == 0
    # a push beyond the friction moves it again
    np.testing.assert_allclose(IMPLICIT.step(Block(-4.5), x, None, dt), -1.5 * 0.03)


DRIVES = {
    "from standstill": (0.0, {"drive_torque_fl": 300.0, "drive_torque_fr": 300.0}, 1.0),
    "wheel spin on ice": (0.0, {"drive_torque_fl": 300.0, "drive_torque_fr": 300.0}, 0.1),
    "braking to rest": (4.0, {"brake_torque": 350.0}, 1.0),
    "locking on wet": (12.0, {"brake_torque": 1500.0}, 0.5),
    "coasting to rest": (0.3, {}, 1.0),
    "backing off": (0.0, {"drive_torque": -150.0}, 1.0),
    "turning at a crawl": (1.0, {"steer": 0.5}, 1.0),
}


@pytest.mark.parametrize("name", list(DRIVES))
def test_the_implicit_scheme_follows_the_fine_solution_with_steps_of_10_ms(name: str) -> None:
    speed, inputs, friction = DRIVES[name]
    model = MODEL.with_parameters({"friction": friction})
    start = rolling(speed, R)
    coarse = np.asarray(simulate(model, IMPLICIT, start, held(model, 200, inputs), 0.01))
    fine = np.asarray(simulate(model, SubSteps(IMPLICIT, 100), start, held(model, 200, inputs), 0.01))
    assert np.all(np.isfinite(coarse))
    reach = max(1.0, float(np.max(np.abs(fine[:, 0]))))
    assert np.max(np.abs(coarse[:, :2] - fine[:, :2])) < 0.05 * reach
    rims = np.max(np.abs(fine[:, 3:])) * R
    np.testing.assert_allclose(coarse[-1, 3:] * R, fine[-1, 3:] * R, atol=0.05 * max(rims, 1.0))


@pytest.mark.parametrize("integrator", [Euler(), RK4()])
def test_explicit_steps_of_10_ms_do_not(integrator: Integrator) -> None:
    """What the implicit scheme is for."""
    u = held(MODEL, 200, {"drive_torque_fl": 300.0, "drive_torque_fr": 300.0})
    rim = np.asarray(simulate(MODEL, integrator, rolling(0.0, R), u, 0.01))[:, 3] * R
    assert not np.max(np.abs(np.diff(rim[50:]))) < 0.5
    implicit = np.asarray(simulate(MODEL, IMPLICIT, rolling(0.0, R), u, 0.01))[:, 3] * R
    assert np.max(np.abs(np.diff(implicit[50:]))) < 0.05


def test_wheels_lock_exactly_and_are_released() -> None:
    inputs = jnp.concatenate([held(MODEL, 100, {"brake_torque": 3000.0}), held(MODEL, 100, {})])
    states = np.asarray(simulate(MODEL, IMPLICIT, rolling(20.0, R), inputs, 0.01))
    assert np.all(states[20:100, 3:] == 0)
    assert np.all(states[:100, 3:] >= 0)
    np.testing.assert_allclose(states[130:, 3] * R, states[130:, 0], rtol=0.01)
    assert states[-1, 0] > 8


@pytest.mark.parametrize("dt", [0.001, 0.01, 0.05])
def test_without_drive_no_step_gains_energy(dt: float) -> None:
    """Any slip, any speed down to standstill."""
    inertia = np.array([CAR.mass, CAR.mass, CAR.yaw_inertia] + [CAR.wheels.inertia] * 4)
    rng = np.random.default_rng(3)
    starts = (
        rng.normal(size=(40, 7)) * np.array([3, 0.5, 0.5, 15, 15, 15, 15]) * rng.choice([0.1, 1], (40, 1))
    )
    runs = jax.vmap(lambda x: simulate(MODEL, IMPLICIT, x, held(MODEL, 200, {}), dt))
    states = np.concatenate([starts[:, None], np.asarray(runs(jnp.asarray(starts)))], axis=1)
    energy = 0.5 * np.sum(inertia * states**2, axis=-1)
    scale = energy[:, :1]
    assert np.all(np.diff(energy) <= 0.02 * scale)
    assert np.all(np.max(energy[:, 1:], axis=1) <= scale[:, 0] * 1.001)
    assert np.all(energy[:, -1] < energy[:, 0])


@pytest.mark.parametrize("start", [SLIDING_START, [0.0] * 7, [5.0, 0, 0, 0, 0, 0, 0]])
def test_steps_can_be_differentiated(start: list[float]) -> None:
    u = held(MODEL, 1, {"brake_torque": 800.0})[0]

    def after(x: jax.Array, friction: jax.Array) -> jax.Array:
        return IMPLICIT.step(MODEL.with_parameters({"friction": friction}), x, u, jnp.asarray(0.01))

    for J in jax.jit(jax.jacfwd(after, argnums=(0, 1)))(jnp.asarray(start), jnp.full(4, 0.8)):
        assert np.all(np.isfinite(J))
