"""Load that follows an acceleration by way of the springs."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from roadstate.estimators.load_transfer import Lean


def followed(accel: np.ndarray, dt: float) -> np.ndarray:
    """What has come over of accelerations that are held for ``dt`` each, at the end of each."""
    lean, out = Lean.upright(), []
    for a in accel:
        lean = lean.after(jnp.asarray(a), jnp.asarray(dt))
        out.append(float(lean.transferred(jnp.asarray(a))))
    return np.array(out)


def test_it_is_a_body_on_springs_and_dampers() -> None:
    """Against the equation of motion ψ̈ = ω²(a − ψ) − 2ζω ψ̇ itself."""
    natural, damping, direct, dt = 2 * np.pi * 1.35, 0.35, 0.15, 0.05
    accel = np.random.default_rng(0).normal(0.0, 4.0, 40)
    x, expected = np.zeros(2), []
    for a in accel:

        def slope(_: float, x: np.ndarray, a: float = a) -> list[float]:
            return [x[1], natural**2 * (a - x[0]) - 2 * damping * natural * x[1]]

        x = solve_ivp(slope, (0.0, dt), x, rtol=1e-9, atol=1e-9).y[:, -1]
        expected.append(direct * a + (1 - direct) * (x[0] + 2 * damping / natural * x[1]))
    np.testing.assert_allclose(followed(accel, dt), expected, atol=1e-6)


def test_a_lasting_acceleration_shifts_the_load_of_a_rigid_body() -> None:
    assert followed(np.full(300, -6.0), 0.01)[-1] == pytest.approx(-6.0, rel=1e-3)
    # however long the step, and after any gap
    assert followed(np.array([3.0, -6.0]), 60.0)[-1] == pytest.approx(-6.0)


def test_at_first_only_the_links_press_the_wheels() -> None:
    """Brakes that bite within a thousandth of a second find hardly more load on the front wheels."""
    at_once = followed(np.array([-8.0]), 0.001)[-1]
    assert 0.14 < at_once / -8.0 < 0.17
    assert np.max(followed(np.full(100, -8.0), 0.01) / -8.0) > 1.1
