"""The fading factor of the strong tracking filter."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from roadstate.filters.averages import Average, AverageState, Forgetting
from roadstate.linalg import product, solve_lower, tria


class StrongTracking(eqx.Module):
    """Inflates P⁻ when innovations are larger than it explains (Zhou & Frank 1996).

    s = max(1, tr N / tr M), N = V − βR, M = H P⁻ Hᵀ, with V the actual covariance of the innovations. Each
    sensor counts in units of its own R, so that the traces may be taken over unlike sensors.

    What is scaled is not all of P⁻ but the part of it that the sample is about to remove:
    P⁻ + (s − 1) K S Kᵀ. With s P⁻, directions that no sensor sees would grow by s each time another
    direction surprises, and nothing would ever shrink them again.

    Attributes:
        average: how V is averaged. Zhou and Frank's V ← (ρV + ννᵀ)/(1 + ρ) is ``Forgetting(ρ/(1 + ρ))``, all
            but the last two samples' worth of which is noise.
        softening: β ≥ 1; larger reacts later and less often to what is only noise.
        largest: bound of s.
    """

    average: Average = eqx.field(default=Forgetting(0.8), kw_only=True)
    softening: float = eqx.field(default=2.0, static=True, kw_only=True)
    largest: float = eqx.field(default=100.0, static=True, kw_only=True)

    def init(self, sensors: int, dtype: Any) -> AverageState:
        """Nothing seen."""
        return self.average.init((sensors,), dtype)

    def learn(
        self, state: AverageState, squared: Float[Array, " m"], fresh: Bool[Array, " m"]
    ) -> AverageState:
        """Take one sample's ν²/R per sensor, where ``fresh``."""
        return self.average.add(state, squared, fresh)

    def factor(
        self,
        state: AverageState,
        predicted: Float[Array, " m"],
        noise: Float[Array, " m"],
        fresh: Bool[Array, " m"],
    ) -> Float[Array, ""]:
        """s for this sample.

        Args:
            state: with this sample's innovations already taken.
            predicted: (m,) diagonal of H P⁻ Hᵀ, in units of the nominal R.
            noise: (m,) diagonal of the R in use, in units of the nominal R.
            fresh: (m,) sensors with a sample.
        """
        excess = jnp.sum(jnp.where(fresh, self.average.mean(state) - self.softening * noise, 0))
        explained = jnp.sum(jnp.where(fresh, predicted, 0))
        ratio = excess / jnp.where(explained > 0, explained, 1)
        return jnp.where((explained > 0) & jnp.isfinite(ratio), jnp.clip(ratio, 1, self.largest), 1)


def removable(
    factor: Float[Array, "n n"],
    sensor_rows: Float[Array, "m n"],
    sqrt_R: Float[Array, "m m"],
    used: Bool[Array, " m"],
) -> Float[Array, "n m"]:
    """Columns C with C Cᵀ = K S Kᵀ: what a sample of the sensors ``used`` will remove from P.

    Args:
        factor: (n, n) of P.
        sensor_rows: (m, n) H times that factor.
        sqrt_R: (m, m) any factor of R.
        used: (m,) sensors with a sample.
    """
    keep = used[:, None]
    rows = jnp.where(keep, sensor_rows, 0)
    skipped = jnp.diag((~used).astype(rows.dtype))
    sqrt_S = tria(jnp.concatenate([jnp.where(keep, sqrt_R, 0), skipped, rows], axis=1))
    return jax.vmap(solve_lower, (None, 0))(sqrt_S, product(factor, rows.T))
