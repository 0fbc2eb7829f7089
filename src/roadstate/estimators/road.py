"""How a road's grade changes along it: the prior that the grade estimators share."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.linalg import root


class GradePrior(eqx.Module):
    """The grade as a once-differentiable Gauss–Markov process of the distance travelled (Matérn 3/2).

    With y = (θ, dθ/ds): d²θ/ds² = −λ² θ − 2λ dθ/ds + w, λ = √3/ℓ; stationary standard deviations σ and λσ;
    correlation (1 + λ|Δs|) e^(−λ|Δs|). Roads are built of vertical curves, so their grade is continuous with
    a bounded rate; and grade belongs to the road, not to the clock: a standing car's keeps, a fast car's
    changes fast, and after a long gap the variance is σ², not infinity. (A random walk in time, the common
    choice, is right at one speed only, and lags on every transition.)

    Attributes:
        std: σ of the road's grade, in the unit of the state it drives.
        length: ℓ in m.
    """

    std: Float[Array, ""]
    length: Float[Array, ""]

    @property
    def stationary_std(self) -> Float[Array, " 2"]:
        """Standard deviations of θ and dθ/ds where nothing is known."""
        return self.std * jnp.stack([jnp.ones(()), jnp.sqrt(3.0) / self.length])

    def transition(self, distance: Float[Array, ""]) -> Float[Array, "2 2"]:
        """A(d) of y(s+d) = A y(s) + w, exact for any d in m, negative of a car that backs up."""
        rate = jnp.sqrt(3.0) / self.length
        x = rate * jnp.abs(distance)
        rows = [[1 + x, distance], [-(rate**2) * distance, 1 - x]]
        return jnp.exp(-x) * jnp.stack([jnp.stack(row) for row in rows])

    def sqrt_Q(self, distance: Float[Array, ""]) -> Float[Array, "2 2"]:
        """Lower-triangular factor of the covariance of w(d): P∞ − A P∞ Aᵀ in closed form.

        With x = λ|d| the entries are σ²(1 − e⁻²ˣ(1 + 2x + 2x²)), 2σ²λx²e⁻²ˣ and σ²λ²(1 − e⁻²ˣ(1 − 2x + 2x²)),
        the second with the sign of d.
        The first is O(x³), so for small x it is summed as a series: the difference would be noise.
        """
        rate = jnp.sqrt(3.0) / self.length
        x = rate * jnp.abs(distance)
        decay = jnp.exp(-2 * x)
        series = x**3 * (4 / 3 + x * (-2 + x * (8 / 5 - x * (8 / 9 - x * (8 / 21)))))
        a = jnp.where(x < 0.05, series, 1 - decay * (1 + 2 * x + 2 * x**2))
        b = 2 * x**2 * decay
        c = -jnp.expm1(-2 * x) + 2 * x * decay * (1 - x)
        first = root(a)
        cross = b / first
        last = root(c - cross**2)
        rows = [[first, jnp.zeros_like(x)], [rate * jnp.sign(distance) * cross, rate * last]]
        return self.std * jnp.stack([jnp.stack(row) for row in rows])
