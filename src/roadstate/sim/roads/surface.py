"""Unevenness of a road on a regular grid."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

Numbers = Float[Array, "*S"]


class Surface(eqx.Module):
    """Heights on a grid: cubic along the road with given slopes at the knots, linear across it.

    So the height is C¹ along the road and continuous across it. Beyond its sides it stays as it is at the
    outermost line.

    Attributes:
        knots: (N, M, 2) height in m and its derivative along the road (m per cell), at N places along and M
            lines across, right to left.
        start: s of the first row, m.
        right: d of the first line, m.
        step: distance of the rows, m.
        spacing: distance of the lines, m.
        wraps: whether the first row follows the last one (a repeated surface), rather than the ends going on
            as they are.
    """

    knots: Float[Array, "N M 2"]
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
        t = (along - i)[..., None]
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
        z0, m0, z1, m1 = (
            corner[..., 0, :, 0],
            corner[..., 0, :, 1],
            corner[..., 1, :, 0],
            corner[..., 1, :, 1],
        )
        # the cubic through both heights with both slopes
        c2, c3 = 3 * (z1 - z0) - 2 * m0 - m1, 2 * (z0 - z1) + m0 + m1
        height = ((c3 * t + c2) * t + m0) * t + z0
        slope = ((3 * c3 * t + 2 * c2) * t + m0) / self.step.astype(s.dtype)
        slope = jnp.where(outside[..., None], 0, slope)
        tilt = (height[..., 1] - height[..., 0]) / self.spacing.astype(s.dtype)
        return (
            height[..., 0] + w * (height[..., 1] - height[..., 0]),
            slope[..., 0] + w * (slope[..., 1] - slope[..., 0]),
            jnp.where(beside, 0, tilt),
        )
