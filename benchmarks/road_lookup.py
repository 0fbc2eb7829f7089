"""Cost of looking up a road at four wheels inside a compiled loop.

    python benchmarks/road_lookup.py

Prints the processor time of ``Road.at`` for four points, in µs: a loop with it minus one without.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp

from roadstate.sim.roads import Bend, Road, chessboard, joint, make_road, rough_surface, uniform

_STEPS = 100_000
_ROUNDS = 5
_PLAN = [Bend(300.0), Bend(50.0, 0.0, 0.01), Bend(300.0, 0.01)]


def roads() -> Mapping[str, Road]:
    """From the plainest to the most laborious."""
    rough = rough_surface("B", 1, 500.0)
    board = chessboard(0.3, 0.8, 20.0, 400.0, 10.0)
    return {
        "one friction, even": make_road(_PLAN, friction=uniform(0.8)),
        "friction joint, even": make_road(_PLAN, friction=joint([25.0], [0.2, 0.8])),
        "chessboard of 38 squares, rough": make_road(_PLAN, friction=board, surface=rough),
    }


@eqx.filter_jit
def loop(road: Road | None, s: jax.Array, d: jax.Array) -> jax.Array:
    """The last of many places, each a little further; what is looked up is used."""

    def step(s: jax.Array, _: None) -> tuple[jax.Array, None]:
        seen = d if road is None else sum(road.at(s, d))
        return s + 0.01 + 1e-12 * seen, None

    return jax.lax.scan(step, s, None, length=_STEPS)[0]


def cost(road: Road | None) -> float:
    """Processor time of a step, µs, the least of several rounds."""
    s, d = jnp.array([2.7, 2.7, 0.0, 0.0]), jnp.array([0.8, -0.8, 0.8, -0.8])
    loop(road, s, d).block_until_ready()
    times = []
    for _ in range(_ROUNDS):
        begun = time.process_time()
        loop(road, s, d).block_until_ready()
        times.append(time.process_time() - begun)
    return 1e6 * min(times) / _STEPS


def main() -> None:
    """Print a line for each road."""
    empty = cost(None)
    for name, road in roads().items():
        print(f"{name:32} {cost(road) - empty:6.2f} µs")


if __name__ == "__main__":
    main()
