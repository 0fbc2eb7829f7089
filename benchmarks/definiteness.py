"""Whether a covariance stays one: ``python -m benchmarks.definiteness`` runs every filter a million steps.

In single and double precision, through what breaks covariance forms: a prior that is singular to seven
digits, a state without noise, a sensor a million times better than the others, samples that come and go,
driving and then standing still.
"""

from __future__ import annotations

import argparse
import time
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from roadstate.core.gaussian import Gaussian
from roadstate.filters import Filter, all_filters
from roadstate.statespace import StateSpaceModel

_NOISE = np.array([1e-6, 1.0, 1.0])
_SENSORS = np.array([[1.0, 0, 0, 0.5], [0, 1, 0, 0], [1, 1, 1, 1]])
_PRIOR = np.array([[1.0, 0, 0, 0], [1, 1e-7, 0, 0], [1, 0, 1e-7, 0], [1, 0, 0, 1e-7]])
_PROCESS = np.array([[0.0, 0], [1e-3, 0], [0, 1e-4], [0, 0]])
_DT = 0.01


class Fragile(StateSpaceModel):
    """Position, speed, acceleration and a constant; a little curved, and driving or standing as u says."""

    states: tuple[str, ...] = eqx.field(default=("position", "speed", "acceleration", "offset"), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("fine", "speed", "sum"), static=True)
    dtype: Any = eqx.field(default=jnp.float64, static=True)

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        """Integrate while driving."""
        return x + u * dt * jnp.stack([x[1], x[2], -0.1 * jnp.sin(x[2]), jnp.zeros_like(x[3])])

    def h(self, x: Any, u: Any) -> Any:
        """Sums of the states, the last one bent."""
        seen = jnp.asarray(_SENSORS, self.dtype) @ x
        return seen.at[2].add(0.01 * x[1] * x[2])

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        """Two states have no noise."""
        return jnp.asarray(_PROCESS, self.dtype) * jnp.where(dt > 0, jnp.sqrt(dt), 0)

    def sqrt_R(self, u: Any) -> Any:
        """One sensor is a million times better."""
        return jnp.diag(jnp.asarray(_NOISE, self.dtype))

    def prior(self) -> Gaussian:
        """All but singular."""
        return Gaussian(jnp.zeros(4, self.dtype), jnp.asarray(_PRIOR, self.dtype))


class Study(NamedTuple):
    """What became of one filter.

    Attributes:
        finite: steps whose posterior was finite and whose ``Info.ok`` was true, as a share of all.
        definite: whether every state that is not known exactly kept a positive deviation.
        std: (n,) standard deviations at the end.
    """

    finite: Any
    definite: Any
    std: Any


@eqx.filter_jit
def study(method: Filter[Any], dtype: Any, steps: int) -> Study:
    """Run one filter: the first half of the steps driving, the second standing.

    Args:
        method: any filter.
        dtype: float32 or float64.
        steps: how many, static.
    """
    model = Fragile(dtype=dtype)

    def body(carry: Any, k: Any) -> tuple[Any, None]:
        state, finite, definite = carry
        drives = (k < steps // 2).astype(dtype)
        noise = jnp.asarray(_NOISE, dtype) * jnp.sin(jnp.asarray([1.0, 2.0, 3.0], dtype) * k)
        z = jnp.where(k % jnp.asarray([3, 2, 5]) == 0, noise, jnp.nan)
        state, info = method.step(model, state, drives, z, drives * jnp.asarray(_DT, dtype))
        posterior = method.posterior(state)
        sound = jnp.all(jnp.isfinite(posterior.mean)) & jnp.all(jnp.isfinite(posterior.factor)) & info.ok
        variance = jnp.sum(posterior.factor**2, axis=1)
        return (state, finite + sound, definite & jnp.all(variance > 0)), None

    start = method.init(model), jnp.zeros((), jnp.int32), jnp.asarray(True)
    (state, finite, definite), _ = jax.lax.scan(body, start, jnp.arange(steps))
    return Study(finite / steps, definite, method.posterior(state).std)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--filter", action="append", help="only this one; may be given again")
    arguments = parser.parse_args()
    print("| filter | finite and ok, float32 | definite | std float32 / float64 | seconds float32 |")
    print("|---|---|---|---|---|")
    for name in arguments.filter or all_filters():
        method = all_filters()[name]()
        start = time.perf_counter()
        single = jax.block_until_ready(study(method, jnp.float32, arguments.steps))
        took = time.perf_counter() - start
        double = study(method, jnp.float64, arguments.steps)
        ratio = np.asarray(single.std) / np.asarray(double.std)
        share, definite = float(single.finite), bool(single.definite)
        print(f"| {name} | {share:.4%} | {definite} | {ratio.min():.3f} to {ratio.max():.3f} | {took:.0f} |")


if __name__ == "__main__":
    main()
