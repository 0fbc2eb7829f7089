"""Bumps, patches and potholes on a road."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError
from roadstate.core import numerics as numerics  # float64 before the first array
from roadstate.sim.roads.surface import Surface, smooth_across

Array = NDArray[np.floating[Any]]

_STEP = 0.05  # m between the rows
_SPACING = 0.25  # m between the lines


@dataclass(frozen=True)
class Bump:
    """A rise or a hole: a full wave of a cosine along the road, level from side to side.

    Attributes:
        at: where it begins, m along the road.
        length: m along the road.
        height: m; of a hole less than 0.
        right, left: from where to where it reaches across, m to the left of the middle.
    """

    at: float
    length: float
    height: float
    right: float = -4.0
    left: float = 4.0

    def profile(self, s: Array) -> tuple[Array, Array]:
        """Height (m) and slope at places along the road, any shape."""
        part = (s - self.at) / self.length
        inside = (part > 0) & (part < 1)
        height = np.where(inside, 0.5 * (1 - np.cos(2 * np.pi * part)), 0.0) * self.height
        slope = np.where(inside, np.pi / self.length * np.sin(2 * np.pi * part), 0.0) * self.height
        return height, slope


def bumpy_surface(bumps: Sequence[Bump], length: float, width: float = 8.0) -> Surface:
    """An even surface but for bumps, repeated along the road.

    Args:
        bumps: that may overlap: heights add.
        length: of a period, m.
        width: from the right to the left line, m, centred.

    Raises:
        InputError: a bump that does not lie on the surface, or is too short to be told from a step.
    """
    for bump in bumps:
        fits = bump.at >= 0 and bump.at + bump.length <= length and bump.right < bump.left
        if not (fits and bump.length >= 4 * _STEP):
            raise InputError(
                f"a bump of {bump.length:g} m at {bump.at:g} m on a surface of {length:g} m",
                mend=f"let it lie between 0 and {length:g} m, {4 * _STEP:g} m long at least",
            )
    rows, lines = round(length / _STEP), round(width / _SPACING) + 1
    s = _STEP * np.arange(rows)
    d = _SPACING * (np.arange(lines) - (lines - 1) / 2)
    knots = np.zeros((rows, lines, 2))
    for bump in bumps:
        height, slope = bump.profile(s)
        across = (d >= bump.right) & (d <= bump.left)
        knots += np.stack([height, slope * _STEP], axis=-1)[:, None] * across[:, None]
    return Surface(
        knots=jnp.asarray(smooth_across(knots, level_edges=True)),
        start=jnp.asarray(0.0),
        right=jnp.asarray(float(d[0])),
        step=jnp.asarray(_STEP),
        spacing=jnp.asarray(_SPACING),
        wraps=True,
    )
