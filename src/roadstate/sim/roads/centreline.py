"""A road's tables from its plan: curvature sections, height and bank along the centreline."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from roadstate.core import InputError
from roadstate.core import numerics as numerics  # float64 before the first array
from roadstate.sim.roads.friction import FrictionMap
from roadstate.sim.roads.road import Road
from roadstate.sim.roads.surface import Surface

Array = NDArray[np.floating[Any]]
Along = Callable[[Array], tuple[Array, Array]]
"""A quantity and its derivative with respect to s, at places s."""

STEP = 0.5
"""Length of a cell of the tables, m."""
LONGEST = 200_000.0
"""Length of the longest road, m."""


class Bend(NamedTuple):
    """A section of the centreline, its curvature linear from start to end.

    Straight without curvature, an arc with one, a clothoid with two.

    Attributes:
        length: m.
        curvature: at its start, 1/m, positive to the left.
        end: at its end, 1/m.
    """

    length: float
    curvature: float = 0.0
    end: float | None = None


def half_cosine(knots: ArrayLike, values: ArrayLike) -> Along:
    """A quantity with half a cosine between its knots, constant before the first and after the last one.

    Args:
        knots: (K,) s, increasing, m.
        values: (K,) at the knots.

    Raises:
        InputError: none, not as many, or knots that do not increase.
    """
    s, v = np.asarray(knots, float).reshape(-1), np.asarray(values, float).reshape(-1)
    if len(s) == 0 or s.shape != v.shape or not (np.isfinite(s).all() and np.isfinite(v).all()):
        raise InputError(f"{len(s)} places and {len(v)} values along the road", mend="give as many")
    if not (np.diff(s) > 0).all():
        raise InputError("places along the road do not increase", mend="sort them and drop repeated ones")
    if len(s) == 1:
        return lambda at: (np.full_like(at, v[0]), np.zeros_like(at))

    def evaluate(at: Array) -> tuple[Array, Array]:
        i = np.clip(np.searchsorted(s, at, side="right") - 1, 0, len(s) - 2)
        length = s[i + 1] - s[i]
        u = np.clip((at - s[i]) / length, 0, 1)
        rise = v[i + 1] - v[i]
        value = v[i] + rise * (1 - np.cos(np.pi * u)) / 2
        return value, rise * np.pi / (2 * length) * np.sin(np.pi * u)

    return evaluate


def level(at: Array) -> tuple[Array, Array]:
    """Zero everywhere."""
    return np.zeros_like(at), np.zeros_like(at)


def make_road(
    bends: Sequence[Bend],
    *,
    height: Along = level,
    bank: Along = level,
    friction: FrictionMap,
    surface: Surface | None = None,
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    step: float = STEP,
) -> Road:
    """A road from its plan.

    The heading at the knots is the exact integral of the curvature; a jump of the curvature is spread over
    two cells, so that the curvature is continuous and the angle turned through remains.

    Args:
        bends: sections of the centreline, one after the other from s = 0.
        height: z₀(s) in m and its slope.
        bank: b(s) = tan φ and its derivative in 1/m.
        friction: by place.
        surface: unevenness on top.
        pose: x, y (m) and heading (rad) at the start.
        step: length of a cell, m; shortened so that cells end with the road.

    Raises:
        InputError: no section, or one without length; a road over 200 km.
    """
    lengths = np.array([b.length for b in bends])
    total = float(lengths.sum())
    if not len(bends) or not (np.isfinite(lengths).all() and (lengths > 0).all()):
        raise InputError("a section of the centreline has no length", mend="give each a length above 0")
    if total > LONGEST:
        raise InputError(f"a road of {total / 1000:.0f} km", mend=f"the longest is {LONGEST / 1000:.0f} km")
    cells = max(2, int(np.ceil(total / step - 1e-9)))
    h = total / cells
    s = h * np.arange(cells + 1)
    # the mean curvature over a cell's length about each knot: the exact difference of headings
    ahead = _heading(bends, np.concatenate([s - h / 2, [s[-1] + h / 2]]))
    return from_tables(
        np.diff(ahead) / h,
        h,
        height=height(s),
        bank=bank(s),
        friction=friction,
        surface=surface,
        pose=pose,
    )


def from_tables(
    curvature: Array,
    step: float,
    *,
    height: tuple[Array, Array],
    bank: tuple[Array, Array],
    friction: FrictionMap,
    surface: Surface | None = None,
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0),
    start: float = 0.0,
) -> Road:
    """A road from values at equidistant knots.

    Heading and place are integrals of the curvature, linear between its knots: the heading in closed form,
    the place by Gauss' formula with four points per cell.

    Args:
        curvature: (K,) 1/m.
        step: between knots, m.
        height: z₀ and its slope at the knots, (K,) each.
        bank: b = tan φ and its derivative (1/m) at the knots, (K,) each.
        friction: by place.
        surface: unevenness on top.
        pose: x, y (m) and heading (rad) at the start.
        start: s at the first knot, m.
    """
    k0, k1 = curvature[:-1], curvature[1:]
    heading = pose[2] + np.concatenate([[0.0], np.cumsum(step * (k0 + k1) / 2)])
    nodes, weights = np.polynomial.legendre.leggauss(4)
    u = (nodes + 1) / 2
    within = heading[:-1, None] + step * (k0[:, None] * u + (k1 - k0)[:, None] * u**2 / 2)
    x = pose[0] + np.concatenate([[0.0], np.cumsum(step / 2 * np.cos(within) @ weights)])
    y = pose[1] + np.concatenate([[0.0], np.cumsum(step / 2 * np.sin(within) @ weights)])
    zero = np.zeros_like(k0)
    turning = np.stack([heading[:-1], step * k0, step * (k1 - k0) / 2, zero], axis=-1)
    columns = [
        _cubic(x, np.cos(heading), step),
        _cubic(y, np.sin(heading), step),
        turning,
        _cubic(*height, step),
        _cubic(*bank, step),
    ]
    line = jnp.asarray(np.stack(columns, axis=-1))
    return Road(line, jnp.asarray(float(start)), jnp.asarray(float(step)), friction, surface)


def _heading(bends: Sequence[Bend], at: Array) -> Array:
    """Heading change since s = 0 at places, exact; outside, the curvature stays what it is at the ends."""
    lengths = np.array([b.length for b in bends])
    first = np.array([b.curvature for b in bends])
    last = np.array([b.curvature if b.end is None else b.end for b in bends])
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    turned = np.concatenate([[0.0], np.cumsum(lengths * (first + last) / 2)])
    place = np.clip(at, 0, starts[-1])
    i = np.clip(np.searchsorted(starts, place, side="right") - 1, 0, len(bends) - 1)
    u = place - starts[i]
    outside = np.minimum(at, 0) * first[0] + np.maximum(at - starts[-1], 0) * last[-1]
    heading: Array = outside + turned[i] + first[i] * u + (last - first)[i] * u**2 / (2 * lengths[i])
    return heading


def _cubic(value: Array, slope: Array, step: float) -> Array:
    """(C, 4) coefficients of the cubics through the values with the slopes at the knots."""
    z0, z1, m0, m1 = value[:-1], value[1:], step * slope[:-1], step * slope[1:]
    return np.stack([z0, m0, 3 * (z1 - z0) - 2 * m0 - m1, 2 * (z0 - z1) + m0 + m1], axis=-1)
