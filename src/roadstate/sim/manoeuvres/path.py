"""Where to drive: the lateral offset from the centreline as a function of the distance along it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core import InputError
from roadstate.core import numerics as numerics  # float64 before the first array

Numbers = Float[Array, "*S"]
STEP = 0.25
"""Distance of the table's rows, m."""


class Offset(NamedTuple):
    """The path at a place.

    Attributes:
        d: offset to the left, m.
        slope: dd/ds.
        curvature: d²d/ds², on a straight road the path's curvature while the slope is small, 1/m.
    """

    d: Numbers
    slope: Numbers
    curvature: Numbers


class Path(eqx.Module):
    """A table of :class:`Offset`, linear between its rows, constant beyond its ends.

    Attributes:
        table: (N, 3) offset, slope and curvature.
        start: s of the first row, m.
    """

    table: Float[Array, "N 3"]
    start: Float[Array, ""]

    def at(self, s: Any) -> Offset:
        """The path at s (any shape), m."""
        rows = self.table.shape[0]
        place = jnp.clip((jnp.asarray(s) - self.start) / STEP, 0, rows - 1)
        i = jnp.clip(jnp.floor(place), 0, max(rows - 2, 0)).astype(jnp.int32)
        u = (place - i)[..., None]
        row = self.table[i] + u * (self.table[jnp.minimum(i + 1, rows - 1)] - self.table[i])
        return Offset(row[..., 0], row[..., 1], row[..., 2])


def straight(d: float = 0.0) -> Path:
    """Along the centreline, ``d`` metres to its left."""
    return Path(jnp.asarray([[d, 0.0, 0.0]]), jnp.asarray(0.0))


def cosine_changes(changes: Sequence[tuple[float, float, float]], d: float = 0.0) -> Path:
    """Lane changes of half a cosine each.

    Args:
        changes: (s where it begins, its length, how far to the left), one after the other, m.
        d: offset before the first, m.

    Raises:
        InputError: a change without length, or that begins before the last one ends.
    """
    last = -np.inf
    for start, length, _ in changes:
        if not length > 0 or start < last:
            raise InputError("lane changes that overlap or have no length", mend="move them apart")
        last = start + length
    s = np.arange(min(c[0] for c in changes) - 2 * STEP, last + 3 * STEP, STEP)
    table = np.zeros((len(s), 3))
    table[:, 0] = d
    for start, length, side in changes:
        u = np.clip((s - start) / length, 0, 1)
        inside = (u > 0) & (u < 1)
        table[:, 0] += side * (1 - np.cos(np.pi * u)) / 2
        table[:, 1] += np.where(inside, side * np.pi / (2 * length) * np.sin(np.pi * u), 0)
        table[:, 2] += np.where(inside, side * (np.pi / length) ** 2 / 2 * np.cos(np.pi * u), 0)
    return Path(jnp.asarray(table), jnp.asarray(float(s[0])))


def rounded(corners: Sequence[tuple[float, float]], rounding: float) -> Path:
    """Straight lines between corners, each corner rounded by a raised cosine.

    The polyline is averaged with the weight (1 + cos(2πx/w))/w over the width w, so that a change of slope m
    bends the path with a curvature of at most 2m/w and moves it aside by at most 0.074 m·w at the corner.

    Args:
        corners: (s, d), increasing in s, m; level before the first and after the last.
        rounding: w, m; at most the distance of two corners keeps the lines between them.

    Raises:
        InputError: fewer than two corners, or unsorted ones.
    """
    s, d = (np.asarray(column, float) for column in zip(*corners, strict=True))
    if len(s) < 2 or not (np.diff(s) > 0).all() or not rounding > 0:
        raise InputError("a path needs two corners or more, in order, and a rounding above 0")
    at = np.arange(s[0] - rounding, s[-1] + rounding + STEP, STEP)
    bend = np.diff(np.concatenate([[0.0], np.diff(d) / np.diff(s), [0.0]]))
    table = np.zeros((len(at), 3))
    table[:, 0] = d[0]
    for place, change in zip(s, bend, strict=True):
        x = np.clip((at - place) / rounding, -0.5, 0.5)
        turn = x + 0.5 + np.sin(2 * np.pi * x) / (2 * np.pi)
        # ∫ of the turn: what the rounded corner has moved aside
        moved = (x + 0.5) ** 2 / 2 - (np.cos(2 * np.pi * x) + 1) / (4 * np.pi**2)
        beyond = np.maximum(at - place - rounding / 2, 0)
        table[:, 0] += change * (rounding * moved + beyond)
        table[:, 1] += change * turn
        inside = np.abs(x) < 0.5
        table[:, 2] += np.where(inside, change * (1 + np.cos(2 * np.pi * x)) / rounding, 0)
    return Path(jnp.asarray(table), jnp.asarray(float(at[0])))


def waves(start: float, spacing: float, count: int, amplitude: float) -> Path:
    """Around gates: half a wave between two of them, faded in and out over one spacing at the ends.

    Args:
        start: s of the first gate, m.
        spacing: between gates, m.
        count: of gates.
        amplitude: of the path, m; the first gate is passed on its left.
    """
    s = np.arange(start - 2 * spacing, start + (count + 1) * spacing, STEP / 8)
    u = (s - start) / spacing
    fade = _smooth(u + 1.5) * _smooth(count + 0.5 - u)
    d = amplitude * np.cos(np.pi * u) * fade
    slope = np.gradient(d, s)
    table = np.stack([d, slope, np.gradient(slope, s)], axis=-1)[::8]
    return Path(jnp.asarray(table), jnp.asarray(float(s[0])))


def _smooth(u: np.ndarray) -> np.ndarray:
    x = np.clip(u, 0, 1)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x**2))
