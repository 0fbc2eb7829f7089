"""A road as a surface over its centreline: cheap to look up at a point, differentiable, without branches."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from roadstate.core import numerics as numerics  # float64 before the first array
from roadstate.sim.roads.friction import FrictionMap
from roadstate.sim.roads.surface import Surface

Numbers = Float[Array, "*S"]
_NEWTON_STEPS = 3


class RoadPoint(NamedTuple):
    """The road at points; arrays of the points' shape.

    Attributes:
        x, y, z: place of the surface, m; x and y level, z up.
        heading: direction of the centreline in the level plane, rad, from x towards y.
        curvature: of the centreline, 1/m, positive to the left.
        dz_ds: ∂z/∂s at constant d. Along a line at offset d the slope is dz_ds/(1 − curvature·d), which on
            the centreline is the tangent of the grade.
        dz_dd: ∂z/∂d, the tangent of the bank, positive with the left side higher.
        friction: peak friction coefficient.
        roughness: the part of z that is unevenness, m.
    """

    x: Numbers
    y: Numbers
    z: Numbers
    heading: Numbers
    curvature: Numbers
    dz_ds: Numbers
    dz_dd: Numbers
    friction: Numbers
    roughness: Numbers


class Road(eqx.Module):
    """z(s, d) = z₀(s) + b(s) d + unevenness, over a centreline of curvature κ(s); d to the left.

    s is the length of the centreline in plan view (as in OpenCRG and OpenDRIVE). Between equidistant knots
    heading, place, height and cross slope are cubics, all derivatives those of the very interpolants. Before
    its start and after its end the road goes straight on with the slope and bank it has there.

    Attributes:
        line: (C, 4, 5) coefficients, constant first, of x, y, heading, z₀ and b in each of C cells; a cell's
            variable runs from 0 to 1.
        start: s of the first cell's start, m.
        step: length of a cell, m.
        friction: friction by place.
        surface: unevenness on top, or none.
    """

    line: Float[Array, "C 4 5"]
    start: Float[Array, ""]
    step: Float[Array, ""]
    friction: FrictionMap
    surface: Surface | None = None

    @property
    def length(self) -> float:
        """From first to last knot, m."""
        return float(self.line.shape[0] * self.step)

    def at(self, s: ArrayLike, d: ArrayLike) -> RoadPoint:
        """The road at points.

        Args:
            s: along the centreline, any shape, m.
            d: to the left of it, same shape or one to broadcast, m.
        """
        dtype = _float_type(s, d)
        s, d = jnp.broadcast_arrays(jnp.asarray(s, dtype), jnp.asarray(d, dtype))
        value, slope = self._centre(s)
        x, y, heading, z, bank = (value[..., i] for i in range(5))
        dz_ds, dz_dd = slope[..., 3] + d * slope[..., 4], bank
        z = z + d * bank
        roughness = jnp.zeros_like(z)
        if self.surface is not None:
            roughness, along, across = self.surface.at(s, d)
            z, dz_ds, dz_dd = z + roughness, dz_ds + along, dz_dd + across
        return RoadPoint(
            x - d * jnp.sin(heading),
            y + d * jnp.cos(heading),
            z,
            heading,
            slope[..., 2],
            dz_ds,
            dz_dd,
            self.friction.at(s, d),
            roughness,
        )

    def locate(self, x: ArrayLike, y: ArrayLike, near: ArrayLike) -> tuple[Numbers, Numbers]:
        """(s, d) of places in the level plane, by Newton's method from a nearby s.

        Args:
            x, y: places, any shape, m.
            near: s from which to search, same shape, m; within a tenth of the radius of curvature the result
                is exact to micrometres.
        """
        dtype = _float_type(x, y, near)
        px, py, s = jnp.broadcast_arrays(*(jnp.asarray(v, dtype) for v in (x, y, near)))
        d = jnp.zeros_like(s)
        for _ in range(_NEWTON_STEPS):
            value, slope = self._centre(s)
            cos, sin = jnp.cos(value[..., 2]), jnp.sin(value[..., 2])
            dx, dy = px - value[..., 0], py - value[..., 1]
            d = dy * cos - dx * sin
            ahead = dx * cos + dy * sin
            s = s + ahead / jnp.maximum(1 - slope[..., 2] * d, 0.1)
        return s, d

    def _centre(self, s: Numbers) -> tuple[Numbers, Numbers]:
        """(..., 5) x, y, heading, z₀, b and their derivatives with respect to s."""
        cells = self.line.shape[0]
        place = (s - self.start.astype(s.dtype)) / self.step.astype(s.dtype)
        inside = jnp.clip(place, 0, cells)
        cell = jnp.clip(jnp.floor(inside), 0, cells - 1)
        t = (inside - cell)[..., None]
        c = self.line[cell.astype(jnp.int32)].astype(s.dtype)
        c0, c1, c2, c3 = (c[..., i, :] for i in range(4))
        value = ((c3 * t + c2) * t + c1) * t + c0
        slope = ((3 * c3 * t + 2 * c2) * t + c1) / self.step.astype(s.dtype)
        beyond = (place - inside)[..., None] * self.step.astype(s.dtype)
        goes_on = jnp.asarray([1, 1, 0, 1, 0], s.dtype)
        slope = jnp.where(beyond == 0, slope, slope * goes_on)
        return value + beyond * slope * goes_on, slope


def _float_type(*values: ArrayLike) -> Any:
    """What arrays among the values agree on; Python's own numbers adapt."""
    found = [v.dtype for v in values if hasattr(v, "dtype") and jnp.issubdtype(v.dtype, jnp.inexact)]
    return jnp.result_type(*found) if found else jnp.result_type(float)
