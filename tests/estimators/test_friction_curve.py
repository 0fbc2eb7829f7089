"""One curve of a tire's force against closed forms."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import pytest

from roadstate.estimators.friction_curve import bounded, chord, elastic, grip


def test_small_slips_are_linear_and_large_ones_reach_the_friction() -> None:
    small = grip(jnp.asarray(0.0), jnp.asarray(1e-3), jnp.asarray(0.8), jnp.asarray(1.45))
    assert float(small.across) == pytest.approx(1e-3, rel=1e-3)
    slips = jnp.linspace(0.0, 8.0, 4001)
    force = grip(jnp.zeros_like(slips), slips, jnp.asarray(0.8), jnp.asarray(1.45)).across
    assert float(jnp.max(force)) == pytest.approx(0.8, rel=1e-5)


@pytest.mark.parametrize("share", [-0.9, -0.3, 0.0, 0.5, 0.94])
def test_a_force_tells_the_slip_of_the_rising_branch(share: float) -> None:
    friction, shape = jnp.asarray(0.7), jnp.asarray(1.5)
    slip = elastic(share * friction, friction, shape)
    force = bounded(slip, jnp.zeros(()), friction, shape).along
    assert float(force) == pytest.approx(share * 0.7, abs=1e-6)


def test_no_shape_factor_leaves_those_there_are() -> None:
    """However far a linear update goes, a tire that slides keeps a good part of its friction."""
    sliding = bounded(jnp.asarray(500.0), jnp.zeros(()), jnp.asarray(1.0), jnp.linspace(-3.0, 6.0, 50))
    assert float(jnp.min(sliding.along)) > 0.3
    assert float(jnp.max(sliding.along)) <= 1.0
    by_shape = jax.grad(lambda c: bounded(jnp.asarray(3.0), jnp.asarray(1.0), 0.8, c).along)
    here = bounded(jnp.asarray(3.0), jnp.asarray(1.0), jnp.asarray(0.8), jnp.asarray(1.6))
    assert float(here.along_by_shape) == pytest.approx(float(by_shape(1.6)), rel=1e-4)


def test_combined_slip_shares_one_curve() -> None:
    pure = grip(jnp.asarray(1.0), jnp.asarray(0.0), jnp.asarray(0.6), jnp.asarray(1.3))
    both = grip(jnp.asarray(0.6), jnp.asarray(0.8), jnp.asarray(0.6), jnp.asarray(1.3))
    assert float(jnp.hypot(both.along, both.across)) == pytest.approx(float(pure.along), rel=1e-6)
    assert float(both.across / both.along) == pytest.approx(0.8 / 0.6)


def test_slopes_are_those_of_the_force() -> None:
    friction, shape = jnp.asarray(0.7), jnp.asarray(1.5)
    a, b = jnp.asarray(0.5), jnp.asarray(0.9)
    here = grip(a, b, friction, shape)
    by_b = jax.grad(lambda v: grip(a, v, friction, shape).across)(b)
    by_a = jax.grad(lambda v: grip(v, b, friction, shape).along)(a)
    by_shape = jax.grad(lambda v: grip(a, b, friction, v).across)(shape)
    assert float(here.across_by_angle) == pytest.approx(float(by_b), rel=1e-4)
    assert float(here.along_by_ratio) == pytest.approx(float(by_a), rel=1e-4)
    assert float(here.across_by_shape) == pytest.approx(float(by_shape), rel=1e-4)


@pytest.mark.parametrize("reach", [0.0, 0.2, 0.3, 1.0, 4.0])
def test_a_chord_leads_from_the_slip_there_is_to_the_force_there_is(reach: float) -> None:
    """From a slip before it, at it, next to the peak, or beyond; of a force next to that, it is a tangent."""
    friction, shape, zero = jnp.asarray(0.5), jnp.asarray(1.45), jnp.zeros(())
    there, here = jnp.asarray(0.2), bounded(zero, jnp.asarray(reach), friction, shape)
    by_slip, told = float(here.across_by_angle), float(here.across)
    force = bounded(zero, there, friction, shape).across
    bent = elastic(force, friction, shape)
    assert float(bent) == pytest.approx(0.2, rel=1e-5)
    slope = float(chord(jnp.asarray(reach), here.across, here.across_by_angle, bent, force, friction))
    mean = by_slip if reach == 0.2 else (told - float(force)) / (reach - 0.2)
    assert slope == pytest.approx(mean, rel=1e-3)
    limit = 0.96 * friction
    assert chord(jnp.asarray(reach), here.across, here.across_by_angle, bent, limit, friction) == by_slip
