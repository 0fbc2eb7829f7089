"""Unevenness of a road on a regular grid."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Numbers = Float[Array, "*S"]


class Surface(eqx.Module):
    """Heights on a grid: bicubic, with given slopes along and across at the knots.

    So the height is C¹: its slopes are continuous. Beyond its sides it stays as it is at the outermost line.

    Attributes:
        knots: (N, M, 4) height in m, its derivative across, along, and the mixed one (m per cell), at N
            places along and M lines across, right to left; from :func:`smooth_across`.
        start: s of the first row, m.
        right: d of the first line, m.
        step: distance of the rows, m.
        spacing: distance of the lines, m.
        wraps: whether the first row follows the last one (a repeated surface), rather than the ends going on
            as they are.
    """

    knots: Float[Array, "N M 4"]
    start: Float[Array, ""]
    right: Float[Array, ""]
    step: Float[Array, ""]
    spacing: Float[Array, ""]
    wraps: bool = eqx.field(static=True, default=True)

    def at(self, s: Numbers, d: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        """Height (m), its derivative along the road and across it, at points of one shape."""
        rows, lines = self.knots.shape[:2]
        along = (s - self.start.astype(s.dtype)) / self.step.astype(s.dtype)
        outside = jnp.zeros_like(along, bool)
        if not self.wraps:
            outside = (along < 0) | (along > rows - 1)
            along = jnp.clip(along, 0, rows - 1)
        i = jnp.floor(along) if self.wraps else jnp.clip(jnp.floor(along), 0, rows - 2)
        t = (along - i)[..., None, None]
        across = (d - self.right.astype(d.dtype)) / self.spacing.astype(d.dtype)
        beside = (across < 0) | (across > lines - 1)
        across = jnp.clip(across, 0, lines - 1)
        j = jnp.clip(jnp.floor(across), 0, max(lines - 2, 0))
        w = across - j
        near, line = i.astype(jnp.int32), j.astype(jnp.int32)
        pair = jnp.stack([near, near + 1], axis=-1)
        pair = pair % rows if self.wraps else jnp.minimum(pair, rows - 1)
        lanes = jnp.minimum(jnp.stack([line, line + 1], axis=-1), lines - 1)
        corner = self.knots[pair[..., :, None], lanes[..., None, :]].astype(s.dtype)
        # (..., 2 lines, 2): height and its derivative across, and both along the road
        v0, m0 = corner[..., 0, :, :2], corner[..., 0, :, 2:]
        v1, m1 = corner[..., 1, :, :2], corner[..., 1, :, 2:]
        # the cubic through both values with both slopes
        c2, c3 = 3 * (v1 - v0) - 2 * m0 - m1, 2 * (v0 - v1) + m0 + m1
        value = ((c3 * t + c2) * t + m0) * t + v0
        slope = ((3 * c3 * t + 2 * c2) * t + m0) / self.step.astype(s.dtype)
        slope = jnp.where(outside[..., None, None], 0, slope)
        # and the same across, as weights of the four
        weight = _weights(w)
        rate = jnp.where(beside[..., None, None], 0, _weight_rates(w)) / self.spacing.astype(s.dtype)
        height, rise, tilt = (
            jnp.sum(a * b, axis=(-2, -1)) for a, b in ((weight, value), (weight, slope), (rate, value))
        )
        return height, rise, tilt


def smooth_across(knots: Float[Any, "N M 2"], *, level_edges: bool) -> Float[Any, "N M 4"]:
    """Knots of a :class:`Surface` from heights and derivatives along the road.

    The derivatives across are central differences (Catmull–Rom splines: a plane stays one).

    Args:
        knots: height in m and its derivative along the road in m per cell.
        level_edges: whether the surface becomes level towards its sides, beyond which it is; else it ends
            there with the slope of its last cell.
    """
    across = np.gradient(knots, axis=1)
    if level_edges:
        across[:, [0, -1]] = 0
    return np.stack([knots[..., 0], across[..., 0], knots[..., 1], across[..., 1]], axis=-1)


def _weights(w: Numbers) -> Numbers:
    """(..., 2 lines, value and slope) of Hermite's cubic at ``w`` from 0 to 1."""
    rising = w * w * (3 - 2 * w)
    near, far = w * (1 - w) ** 2, w * w * (w - 1)
    return jnp.stack([jnp.stack([1 - rising, near], axis=-1), jnp.stack([rising, far], axis=-1)], axis=-2)


def _weight_rates(w: Numbers) -> Numbers:
    """Their derivatives."""
    rising = 6 * w * (1 - w)
    near, far = (1 - w) * (1 - 3 * w), w * (3 * w - 2)
    return jnp.stack([jnp.stack([-rising, near], axis=-1), jnp.stack([rising, far], axis=-1)], axis=-2)
