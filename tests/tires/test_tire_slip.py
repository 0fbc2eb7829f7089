"""Slips against their definitions, in reverse, at standstill, spinning and locked."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from roadstate.tires.slip import (
    SPEED_FLOOR,
    bounded_from_practical,
    bounded_slip,
    practical_slip,
    slip_angle,
    theoretical_from_practical,
    theoretical_slip,
)
from roadstate.tires.smooth import bounded_tan, safe_hypot, soft_abs

speeds = st.floats(-80, 80)


@pytest.mark.parametrize(
    ("rolling", "v_x", "kappa", "sigma", "bounded"),
    [
        (20.0, 20.0, 0.0, 0.0, 0.0),
        (22.0, 20.0, 0.1, 2 / 22, 2 / 22),  # driving
        (18.0, 20.0, -0.1, -2 / 18, -0.1),  # braking
        (0.0, 20.0, -1.0, -20 / (SPEED_FLOOR / 2), -1.0),  # locked
        (-18.0, -20.0, 0.1, 2 / 18, 0.1),  # reverse, braking: the force points forward
        (-22.0, -20.0, -0.1, -2 / 22, -2 / 22),  # reverse, driving
        (5.0, -5.0, 2.0, 2.0, 2.0),  # rolling back while the wheel spins forward
    ],
)
def test_longitudinal_slips(rolling: float, v_x: float, kappa: float, sigma: float, bounded: float) -> None:
    np.testing.assert_allclose(practical_slip(rolling, v_x), kappa, rtol=1e-12)
    np.testing.assert_allclose(theoretical_slip(rolling, v_x, 0.0).x, sigma, rtol=1e-12)
    np.testing.assert_allclose(bounded_slip(rolling, v_x), bounded, rtol=1e-12)


def test_slip_angle_opposes_the_lateral_velocity_forwards_and_backwards() -> None:
    np.testing.assert_allclose(slip_angle(20.0, 1.0), -np.arctan(0.05), rtol=1e-12)
    np.testing.assert_allclose(slip_angle(-20.0, 1.0), -np.arctan(0.05), rtol=1e-12)
    np.testing.assert_allclose(slip_angle(20.0, 1.0, steer=0.1), 0.1 - np.arctan(0.05), rtol=1e-12)


@given(rolling=speeds, v_x=speeds, v_y=speeds)
def test_one_slip_follows_from_another(rolling: float, v_x: float, v_y: float) -> None:
    assume(abs(v_x) > 1 and abs(rolling) > 1 and abs(v_y) < 30 * abs(v_x))
    kappa, alpha = practical_slip(rolling, v_x), slip_angle(v_x, v_y)
    direct, derived = theoretical_slip(rolling, v_x, v_y), theoretical_from_practical(kappa, alpha, v_x)
    np.testing.assert_allclose(derived, direct, rtol=1e-9, atol=1e-12)
    bounded = bounded_from_practical(kappa, alpha, v_x)
    np.testing.assert_allclose(bounded.x, bounded_slip(rolling, v_x), rtol=1e-9, atol=1e-12)


@given(rolling=speeds, v_x=speeds, v_y=speeds)
def test_every_slip_and_slope_is_finite_at_any_speed(rolling: float, v_x: float, v_y: float) -> None:
    def everything(r: Any, x: Any, y: Any) -> jax.Array:
        return jnp.stack(
            [practical_slip(r, x), *theoretical_slip(r, x, y), bounded_slip(r, x), slip_angle(x, y)]
        )

    point = (jnp.asarray(rolling), jnp.asarray(v_x), jnp.asarray(v_y))
    assert np.all(np.isfinite(everything(*point)))
    assert np.all(np.isfinite(jnp.stack(jax.jacrev(everything, argnums=(0, 1, 2))(*point))))


def test_standstill_is_no_slip_and_a_bounded_slope() -> None:
    assert practical_slip(0.0, 0.0) == 0
    assert bounded_slip(0.0, 0.0) == 0
    assert slip_angle(0.0, 0.0) == 0
    assert theoretical_slip(0.0, 0.0, 0.0) == (0, 0)
    slope = jax.grad(lambda r: practical_slip(r, 0.0))(0.0)
    assert slope == pytest.approx(2 / SPEED_FLOOR)
    assert practical_slip(10.0, 0.0) == pytest.approx(10 / (SPEED_FLOOR / 2))


def test_soft_abs_is_exact_above_its_floor_and_smooth_across_it() -> None:
    x = np.linspace(-2, 2, 4001)
    value = soft_abs(x, 0.5)
    outside = np.abs(x) > 0.5
    np.testing.assert_array_equal(value[outside], np.abs(x)[outside])
    assert np.min(value) == 0.25
    slope = jax.vmap(jax.grad(lambda v: soft_abs(v, 0.5)))(jnp.asarray(x))
    assert np.max(np.abs(np.diff(slope))) < 2 * (x[1] - x[0]) / 0.5 + 1e-9


def test_safe_hypot_has_no_nan_slope() -> None:
    assert safe_hypot(jnp.asarray(3.0), jnp.asarray(4.0)) == 5
    assert jax.grad(safe_hypot, argnums=(0, 1))(0.0, 0.0) == (0, 0)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_tangent_keeps_its_sign_at_a_right_angle(dtype: type) -> None:
    steep = np.array([np.pi / 2, 2.0, -np.pi / 2, -3.0], dtype)
    assert np.all(np.sign(bounded_tan(jnp.asarray(steep))) == np.sign(steep))
    np.testing.assert_allclose(bounded_tan(jnp.asarray(0.3)), np.tan(0.3), rtol=1e-12)
