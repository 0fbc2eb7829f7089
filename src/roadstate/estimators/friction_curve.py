"""How a tire's force grows with slip towards the friction: one curve, its shape and its slopes."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from roadstate.estimators.trigonometry import arcsin, arctan, sin_cos
from roadstate.tires.smooth import Numbers

_LEAST = 1e-6  # of a normalised slip: below it the curve is its tangent
_CLOSE = 1e-4  # of c σ: two that are no farther apart have the tangent for a chord
_SHAPES = (1.4, 0.4)  # shape factors there are: middle and half range
_TOP = 0.95  # share of the friction from which on a force hardly tells the slip


class Grip(NamedTuple):
    """Force over load of a tire that slips along and across, and its slopes; shapes broadcast.

    Attributes:
        along, across: F_x/F_z and F_y/F_z.
        along_by_slip: ∂(F_x/F_z)/∂ ln c_κ, which is also σ_x ∂/∂σ_x.
        across_by_slip: ∂(F_y/F_z)/∂ ln c_α, which is also σ_y ∂/∂σ_y.
        across_by_angle: ∂(F_y/F_z)/∂σ_y over c_α.
        along_by_ratio: ∂(F_x/F_z)/∂σ_x over c_κ.
        along_by_shape, across_by_shape: ∂/∂C.
    """

    along: Numbers
    across: Numbers
    along_by_slip: Numbers
    across_by_slip: Numbers
    across_by_angle: Numbers
    along_by_ratio: Numbers
    along_by_shape: Numbers
    across_by_shape: Numbers


def grip(stiff_x: Numbers, stiff_y: Numbers, friction: Numbers, shape: Numbers) -> Grip:
    """Force over load, F/F_z = μ sin(C atan(x/C)), x = |(c_κ σ_x, c_α σ_y)|/μ, along the slip.

    The Magic Formula without E (Pacejka, *Tire and Vehicle Dynamics*, ch. 4.3) written for a given stiffness
    and peak, with similarity for combined slip: friction scales the peak and leaves the stiffness. C is the
    shape: near 1 the force bends early and saturates late (brush), at 1.65 it peaks at x = 2.3 and falls.

    Args:
        stiff_x: c_κ σ_x: what the force over load would be if it stayed linear.
        stiff_y: c_α σ_y.
        friction: μ.
        shape: C, 1 < C < 2.
    """
    a, b = stiff_x / friction, stiff_y / friction
    square = a * a + b * b
    x = jnp.sqrt(square + _LEAST)
    t = x / shape
    bend = arctan(t)
    sine, cosine = sin_cos(shape * bend)
    slope = cosine / (1 + t * t)
    secant = sine / x
    curve = (slope - secant) / (square + _LEAST)
    by_shape = friction * cosine * (bend - t / (1 + t * t)) / x
    across_by_angle = secant + b * b * curve
    along_by_ratio = secant + a * a * curve
    return Grip(
        along=stiff_x * secant,
        across=stiff_y * secant,
        along_by_slip=stiff_x * along_by_ratio,
        across_by_slip=stiff_y * across_by_angle,
        across_by_angle=across_by_angle,
        along_by_ratio=along_by_ratio,
        along_by_shape=a * by_shape,
        across_by_shape=b * by_shape,
    )


def bounded(stiff_x: Numbers, stiff_y: Numbers, friction: Numbers, shape: Numbers) -> Grip:
    """:func:`grip` with a shape factor kept among those there are, whatever a linear update makes of it."""
    factor, slope = _within(shape)
    here = grip(stiff_x, stiff_y, friction, factor)
    return here._replace(
        along_by_shape=here.along_by_shape * slope, across_by_shape=here.across_by_shape * slope
    )


def elastic(force: Numbers, friction: Numbers, shape: Numbers) -> Numbers:
    """c σ at which a tire that slips one way has this force over load, on the rising branch of :func:`grip`.

    Args:
        force: F/F_z, of which no more counts than 95 % of the friction.
        friction: μ.
        shape: C, kept within those there are.
    """
    factor, _ = _within(shape)
    share = jnp.minimum(jnp.abs(force) / friction, _TOP)
    sine, cosine = sin_cos(arcsin(share) / factor)
    return jnp.sign(force) * friction * factor * sine / cosine


def chord(
    linear: Numbers, told: Numbers, slope: Numbers, bent: Numbers, force: Numbers, friction: Numbers
) -> Numbers:
    """Mean slope, over c, of the curve from the slip there is to the one that goes with the force there is.

    Next to its peak a curve is flat, and yet no slip there goes with half the force. Where it is steep, a
    slip that is too small for the force is as unlikely as one too large by as much. So a force's distance
    from the curve, over this slope, is a slip's distance from it, whatever the hypothesis.

    Args:
        linear: c σ of a slip, at which the curve has
        told: so much force over load, and
        slope: the slope ∂told/∂σ over c, which comes of a force that hardly tells the slip.
        bent: :func:`elastic` of
        force: F/F_z measured.
        friction: μ.
    """
    mean = (jnp.abs(told - force) + _CLOSE * slope) / (jnp.abs(linear - bent) + _CLOSE)
    return jnp.where(jnp.abs(force) < _TOP * friction, mean, slope)


def theoretical_slip(slip: Numbers) -> Numbers:
    """σ = κ/(1 + κ) of a practical slip κ, as far as a wheel that is nearly locked (Pacejka, ch. 3)."""
    return slip / jnp.maximum(1 + slip, 0.1)


def _within(shape: Numbers) -> tuple[Numbers, Numbers]:
    """The shape factor that counts, and its derivative by the one given."""
    share = jnp.tanh((shape - _SHAPES[0]) / _SHAPES[1])
    return _SHAPES[0] + _SHAPES[1] * share, 1 - share**2
