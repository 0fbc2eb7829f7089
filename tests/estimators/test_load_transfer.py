"""A body that comes to pitch as the car accelerates."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from roadstate.core.constants import GRAVITY
from roadstate.estimators.load_transfer import Lean


def followed(accel: np.ndarray, dt: float) -> np.ndarray:
    """What has come over of accelerations that are held for ``dt`` each, at the end of each."""
    lean, out = Lean.upright(), []
    for a in accel:
        lean = lean.after(jnp.asarray(a), jnp.asarray(dt))
        out.append(float(lean.transferred()))
    return np.array(out)


def test_it_is_a_body_on_springs_and_dampers() -> None:
    """Against the equation of motion ψ̈ = ω²(a − ψ) − 2ζω ψ̇ itself."""
    natural, damping, dt = 2 * np.pi * 1.5, 0.35, 0.05
    accel = np.random.default_rng(0).normal(0.0, 4.0, 40)
    x, expected = np.zeros(2), []
    for a in accel:

        def slope(_: float, x: np.ndarray, a: float = a) -> list[float]:
            return [x[1], natural**2 * (a - x[0]) - 2 * damping * natural * x[1]]

        x = solve_ivp(slope, (0.0, dt), x, rtol=1e-9, atol=1e-9).y[:, -1]
        expected.append(x[0] + 2 * damping / natural * x[1])
    np.testing.assert_allclose(followed(accel, dt), expected, atol=1e-6)


def test_a_lasting_acceleration_shifts_the_load_of_a_rigid_body() -> None:
    assert followed(np.full(300, -6.0), 0.01)[-1] == pytest.approx(-6.0, rel=1e-3)
    # however long the step, and after any gap
    assert followed(np.array([3.0, -6.0]), 60.0)[-1] == pytest.approx(-6.0)


def test_at_first_hardly_anything_presses_the_wheels() -> None:
    """Brakes that bite within a thousandth of a second find no more load on the front wheels, but soon do."""
    assert 0 < followed(np.array([-8.0]), 0.001)[-1] / -8.0 < 0.01
    assert np.max(followed(np.full(100, -8.0), 0.01) / -8.0) > 1.1


def test_a_low_pass_is_undone_to_the_digit() -> None:
    """The lean under a low-passed acceleration, taken ahead, is that under the acceleration itself."""
    dt, lag = 1e-4, 0.05
    accel = np.repeat(np.random.default_rng(1).normal(0.0, 3.0, 8), 2500)
    slow, late, exact = 0.0, Lean.upright(), Lean.upright()
    step = jax.jit(Lean.after)
    for a in accel:
        slow += -np.expm1(-dt / lag) * (a - slow)
        late, exact = step(late, slow, dt), step(exact, a, dt)
    assert float(late.ahead(lag).accel) == pytest.approx(float(exact.accel), abs=2e-3)
    assert abs(float(late.accel) - float(exact.accel)) > 0.1


def test_an_accelerometer_is_freed_of_the_pitch_there_is() -> None:
    """It reads the specific force, and gravity by as much as the body has pitched."""
    gradient, force, lean = 0.0045, -6.0, Lean.upright()._replace(accel=jnp.asarray(-4.0))
    share = jnp.asarray(GRAVITY * gradient)
    reading = force + GRAVITY * gradient * -4.0
    assert float(lean.freed(jnp.asarray(reading) / (1 + share), share)) == pytest.approx(force)
