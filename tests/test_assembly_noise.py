"""The noise of assembled models against Van Loan's integral, and what a gap of any length does."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg as jsl
import numpy as np
import pytest

from roadstate.assembly import AssembledModel, assemble
from roadstate.tires import Brush, Linear
from roadstate.vehicles import RK4, SingleTrack
from test_assembly import CAR, U, X, bicycle


def test_no_time_no_change_no_noise() -> None:
    model = bicycle(time_constants={"friction": 3.0})
    assert np.array_equal(model.f(X, U, jnp.asarray(0.0)), X)
    assert np.all(model.sqrt_Q(U, jnp.asarray(0.0)) == 0)


@eqx.filter_jit
def linear_step(model: AssembledModel, x: jax.Array, dt: jax.Array) -> tuple[jax.Array, jax.Array]:
    """F and the noise's root of one step."""
    return jax.jacfwd(lambda x: model.f(x, U, dt))(x), model.sqrt_Q(U, dt)


def covariance(model: AssembledModel, P: np.ndarray, duration: float, steps: int) -> np.ndarray:
    dt = jnp.asarray(duration / steps)
    F, root = (np.asarray(a) for a in linear_step(model, X, dt))
    for _ in range(steps):
        P = F @ P @ F.T + root @ root.T
    return P


@pytest.mark.parametrize("tau", [None, 0.4])
def test_the_noise_of_slow_states_is_exact_for_any_step(tau: float | None) -> None:
    model = bicycle(time_constants={} if tau is None else {"friction": tau})
    P0 = np.diag([0.0, 0.0, 0.01, 0.02])
    variance = [np.diag(covariance(model, P0, 1.3, steps))[2:] for steps in (1, 2, 13)]
    if tau is None:
        exact = np.array([0.01, 0.02]) + 0.05**2 * 1.3
    else:  # the stationary variance is n² τ/2
        stationary = 0.05**2 * tau / 2
        exact = stationary + (np.array([0.01, 0.02]) - stationary) * np.exp(-2 * 1.3 / tau)
    for one in variance:
        np.testing.assert_allclose(one, exact, rtol=1e-12)


def test_a_gauss_markov_state_returns_to_its_prior_mean() -> None:
    model = bicycle(time_constants={"friction_front": 0.5})
    after = model.f(X, U, jnp.asarray(0.5))
    np.testing.assert_allclose(after[2], 0.8 + (0.7 - 0.8) * np.exp(-1), rtol=1e-12)
    assert after[3] == X[3]


def test_the_noise_of_the_vehicles_states_is_of_first_order() -> None:
    """Against Van Loan's integral for the linearised system: half the step, half the error."""
    tire = SingleTrack.from_vehicle(CAR).tire
    linear = Linear(
        slip_stiffness=tire.slip_stiffness,
        cornering_stiffness=tire.cornering_stiffness,
        nominal_load=tire.nominal_load,
    )
    car = SingleTrack.from_vehicle(CAR, tire=linear)
    model = assemble(
        car,
        states=["velocity_y", "yaw_rate"],
        sensors=["yaw_rate"],
        noise={"velocity_y": 0.3, "yaw_rate": 0.1},
        sensor_noise={"yaw_rate": 0.01},
        prior={"velocity_y": (0, 1), "yaw_rate": (0, 1)},
        integrator=RK4(),
    )
    x, duration = jnp.zeros(2), 0.4
    A = np.asarray(jax.jacfwd(car.derivative)(jnp.asarray([20.0, 0, 0]), jnp.zeros(4)))[1:, 1:]
    Qc = np.diag([0.3**2, 0.1**2])
    block = jsl.expm(jnp.asarray(np.block([[-A, Qc], [np.zeros((2, 2)), A.T]]) * duration))
    exact = np.asarray(block[2:, 2:].T @ block[:2, 2:])
    errors = []
    for steps in (20, 40, 80, 160):
        dt = jnp.asarray(duration / steps)
        F, root = (np.asarray(a) for a in linear_step(model, x, dt))
        P = np.zeros((2, 2))
        for _ in range(steps):
            P = F @ P @ F.T + root**2
        errors.append(np.max(np.abs(P - exact) / np.sqrt(np.outer(np.diag(exact), np.diag(exact)))))
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 2, rtol=0.1)
    assert errors[-1] < 0.02


def linearised(model: AssembledModel, car: SingleTrack, x: np.ndarray) -> np.ndarray:
    """A of the whole x of :func:`bicycle` at a point: vehicle, parameters, and one on the other."""
    tau = np.array([3.0, np.inf])

    def rate(state: jax.Array) -> jax.Array:
        mu = state[2:][jnp.asarray([0, 0, 1, 1])]
        whole = jnp.concatenate([jnp.asarray([20.0]), state[:2]])
        moved = car.with_parameters({"friction": mu}).derivative(whole, jnp.asarray([0.03, 0.0, 0.0, 0.0]))
        return jnp.concatenate([moved[1:], -state[2:] / tau])

    return np.asarray(jax.jacfwd(rate)(jnp.asarray(x)))


def van_loan(A: np.ndarray, Qc: np.ndarray, duration: float) -> np.ndarray:
    """∫ eᴬˢ Qc eᴬᵀˢ ds."""
    n = len(A)
    block = np.asarray(jsl.expm(jnp.asarray(np.block([[-A, Qc], [np.zeros((n, n)), A.T]]) * duration)))
    return block[n:, n:].T @ block[:n, n:]


def test_noise_that_reaches_the_vehicle_through_a_parameter_is_of_first_order() -> None:
    """Friction that wanders moves v̇_y: a step is wrong by order Δt², a given time by order Δt."""
    car = SingleTrack.from_vehicle(CAR, tire=Brush())
    x = np.array([-0.6, 0.35, 0.5, 0.6])
    model = assemble(
        car,
        states=["velocity_y", "yaw_rate"],
        parameters=["friction"],
        groupings={"friction": "front_rear"},
        time_constants={"friction_front": 3.0},
        sensors=["yaw_rate"],
        noise={"velocity_y": 0.05, "yaw_rate": 0.01, "friction": 0.2},
        sensor_noise={"yaw_rate": 0.01},
        prior={"velocity_y": (0, 1), "yaw_rate": (0, 1), "friction": (0.8, 0.3)},
        integrator=RK4(),
    )
    A = linearised(model, car, x)
    assert np.min(np.abs(A[:2, 2:])) > 0.1  # both frictions do move both states
    Qc = np.diag([0.05, 0.01, 0.2, 0.2]) ** 2
    steps = np.array([4e-3, 2e-3, 1e-3])
    local, cross = [], []
    for dt in steps:
        error = van_loan(A, Qc, dt) - np.asarray(model.sqrt_Q(U, jnp.asarray(dt))) ** 2
        local.append(np.abs(error[:2, :2]).max())
        cross.append(np.abs(error[:2, 2:]).max())
        np.testing.assert_allclose(error[2:, 2:], 0, atol=1e-12)
        np.testing.assert_allclose(error[:2, 2:], 0.5 * dt**2 * A[:2, 2:] * 0.2**2, rtol=0.05)
    np.testing.assert_allclose(np.array(local[:-1]) / local[1:], 4, rtol=0.1)
    np.testing.assert_allclose(np.array(cross[:-1]) / cross[1:], 4, rtol=0.1)
    duration, errors = 0.2, []
    exact = van_loan(A, Qc, duration)
    size = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    for count in (20, 40, 80, 160):
        F = np.asarray(jsl.expm(jnp.asarray(A * duration / count)))
        Q = np.asarray(model.sqrt_Q(U, jnp.asarray(duration / count))) ** 2
        P = np.zeros((4, 4))
        for _ in range(count):
            P = F @ P @ F.T + Q
        errors.append(np.max(np.abs(P - exact) / size))
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 2, rtol=0.1)
    assert errors[0] < 0.1
