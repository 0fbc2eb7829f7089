"""Friction as a function of place: rectangles with short, smooth edges."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike, NDArray

from roadstate.core import InputError
from roadstate.core import numerics as numerics  # float64 before the first array

Numbers = Float[Array, "*S"]
EDGE = 0.2
"""Width in m over which friction changes from one surface to the next: about a contact patch's length."""
_LARGEST = 20_000  # cells of a map


class FrictionMap(eqx.Module):
    """A grid of rectangles of one friction each, with edges between them that are C¹.

    Across an edge friction follows 3u² − 2u³, u from 0 to 1 over the edge's width, half of it on either side.

    Attributes:
        along: (A,) s of the edges across the road, increasing, m.
        across: (B,) d of the edges along the road, increasing, m.
        cells: (A + 1, B + 1) peak friction coefficient, in the order of s and of d.
        edge: width of the edges, m.
    """

    along: Float[Array, " A"]
    across: Float[Array, " B"]
    cells: Float[Array, "A1 B1"]
    edge: Float[Array, ""]

    def __init__(
        self, cells: ArrayLike, along: ArrayLike = (), across: ArrayLike = (), edge: float = EDGE
    ) -> None:
        table = np.atleast_2d(np.asarray(cells, float))
        s, d = np.asarray(along, float).reshape(-1), np.asarray(across, float).reshape(-1)
        if table.shape != (len(s) + 1, len(d) + 1):
            raise InputError(
                f"{table.shape[0]} × {table.shape[1]} frictions for {len(s)} edges across the road and "
                f"{len(d)} along it",
                mend="give one more than edges",
            )
        if not (np.isfinite(table).all() and (table > 0).all() and (table <= 3).all()):
            raise InputError("a friction is not between 0 and 3", where="friction")
        if not 0 < edge <= 100:
            raise InputError(f"edges {edge:g} m wide", where="friction", mend="give a width above 0")
        for edges in (s, d):
            if not np.isfinite(edges).all() or (np.diff(edges) < edge - 1e-9).any():
                raise InputError(
                    f"two edges of the friction are nearer than their width, {edge:g} m",
                    mend="move them apart, or give a smaller 'edge'",
                )
        self.along, self.across = jnp.asarray(s), jnp.asarray(d)
        self.cells, self.edge = jnp.asarray(table), jnp.asarray(edge)

    def at(self, s: Numbers, d: Numbers) -> Numbers:
        """Friction at points of one shape."""
        i, u = self._nearest(self.along, s)
        j, w = self._nearest(self.across, d)
        cells = self.cells.astype(jnp.result_type(s))
        if self.cells.shape == (1, 1):
            return jnp.broadcast_to(cells[0, 0], jnp.shape(s))
        last = (self.cells.shape[0] - 1, self.cells.shape[1] - 1)
        rows = jnp.stack([i, jnp.minimum(i + 1, last[0])], axis=-1)
        columns = jnp.stack([j, jnp.minimum(j + 1, last[1])], axis=-1)
        corner = cells[rows[..., :, None], columns[..., None, :]]
        side = corner[..., 0, :] + u[..., None] * (corner[..., 1, :] - corner[..., 0, :])
        return side[..., 0] + w * (side[..., 1] - side[..., 0])

    def _nearest(self, edges: Any, place: Numbers) -> tuple[Any, Numbers]:
        """The cell before the nearest edge, and how far (0…1) the edge is crossed."""
        if edges.shape[0] == 0:
            return jnp.zeros(jnp.shape(place), jnp.int32), jnp.zeros_like(place)
        edges = edges.astype(jnp.result_type(place))
        middle = 0.5 * (edges[1:] + edges[:-1])
        index = jnp.sum(place[..., None] >= middle, axis=-1, dtype=jnp.int32)
        u = jnp.clip((place - edges[index]) / self.edge.astype(edges.dtype) + 0.5, 0, 1)
        return index, u * u * (3 - 2 * u)


def uniform(friction: float) -> FrictionMap:
    """The same friction everywhere."""
    return FrictionMap([[friction]])


def joint(edges: Sequence[float], frictions: Sequence[float], edge: float = EDGE) -> FrictionMap:
    """Surfaces one after the other.

    Args:
        edges: s at which they meet, m.
        frictions: one more.
        edge: width of the change, m.
    """
    return FrictionMap(np.asarray(frictions, float)[:, None], along=edges, edge=edge)


def split(left: float, right: float, at: float = 0.0, edge: float = EDGE) -> FrictionMap:
    """One friction left of the line d = ``at`` (m), another right of it."""
    return FrictionMap([[right, left]], across=[at], edge=edge)


def chessboard(
    first: float,
    second: float,
    start: float,
    stop: float,
    length: float,
    at: float = 0.0,
    edge: float = EDGE,
) -> FrictionMap:
    """Frictions that change sides every ``length`` metres.

    Args:
        first: of the left side in the first square, and of the road before and after.
        second: of the right side in the first square.
        start, stop: s of the board, m.
        length: of a square, m.
        at: d of the line between the sides, m.
        edge: width of the changes, m.
    """
    count = round((stop - start) / length)
    if not 1 <= count <= _LARGEST:
        raise InputError(f"a chessboard of {count} squares", where="friction", mend="choose the length anew")
    pattern = np.array([[second, first], [first, second]])
    cells = [[first, first], *(pattern[i % 2] for i in range(count)), [first, first]]
    return FrictionMap(cells, along=start + length * np.arange(count + 1), across=[at], edge=edge)


def patches(
    ground: float, rectangles: Sequence[tuple[float, float, float, float, float]], edge: float = EDGE
) -> FrictionMap:
    """Rectangles on a ground of one friction; a later one covers earlier ones.

    Args:
        ground: friction elsewhere.
        rectangles: (from s, to s, right d, left d, friction) each; bounds may be infinite.
        edge: width of the changes, m.

    Raises:
        InputError: an empty rectangle, edges nearer than their width, or a map too large.
    """
    for start, stop, right, left, _ in rectangles:
        if not (start < stop and right < left):
            raise InputError(
                f"a patch from {start:g} to {stop:g} m, {right:g} to {left:g} m is empty",
                where="friction",
                mend="'from' lies before 'to', 'right' below 'left' (d grows to the left)",
            )
    s = _edges([r[:2] for r in rectangles])
    d = _edges([r[2:4] for r in rectangles])
    if (len(s) + 1) * (len(d) + 1) > _LARGEST:
        raise InputError("too many patches", where="friction", mend="make the map coarser")
    cells = np.full((len(s) + 1, len(d) + 1), float(ground))
    for start, stop, right, left, friction in rectangles:
        rows = _cells_between(s, start, stop)
        columns = _cells_between(d, right, left)
        cells[rows, columns] = friction
    return FrictionMap(cells, along=s, across=d, edge=edge)


def _edges(bounds: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    values: NDArray[np.float64] = np.unique(np.asarray(bounds, np.float64).reshape(-1))
    kept: NDArray[np.float64] = values[np.isfinite(values)]
    return kept


def _cells_between(edges: NDArray[np.float64], low: float, high: float) -> slice:
    first = 0 if low == -np.inf else int(np.searchsorted(edges, low)) + 1
    last = len(edges) + 1 if high == np.inf else int(np.searchsorted(edges, high)) + 1
    return slice(first, last)
