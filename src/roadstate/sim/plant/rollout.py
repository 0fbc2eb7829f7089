"""A drive with given controls, compiled as one loop."""

from __future__ import annotations

from typing import Any

import jax
from jaxtyping import Array, ArrayLike

from roadstate.core.numerics import jit_loop
from roadstate.sim.plant.base import Controls, Plant, Road, Truth
from roadstate.tires.base import as_leaf


def start(plant: Plant, road: Road, speed: ArrayLike, s: ArrayLike = 0.0, d: ArrayLike = 0.0) -> Any:
    """:meth:`roadstate.sim.plant.base.Plant.init`, compiled once for all speeds and places."""
    return _start(plant, road, as_leaf(speed), as_leaf(s), as_leaf(d))


@jit_loop
def _start(plant: Plant, road: Road, speed: Array, s: Array, d: Array) -> Any:
    return plant.init(road, speed, s, d)


@jit_loop
def open_loop(
    plant: Plant, road: Road, state: Any, controls: Controls, dt: float = 0.01
) -> tuple[Any, Truth]:
    """Drive with given controls.

    Args:
        plant: the car.
        road: under it.
        state: at the first sample.
        controls: (T,) and (T, 4), each held for ``dt``.
        dt: between samples, s.

    Returns:
        The state at the end of the last interval, and the truth at the start of each, (T, …).
    """

    def one(now: Any, held: Controls) -> tuple[Any, Truth]:
        return plant.step(road, now, held, dt), plant.truth(road, now, held)

    result: tuple[Any, Truth] = jax.lax.scan(one, state, controls)
    return result
