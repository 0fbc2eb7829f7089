"""What keeps particles apart that were one before resampling."""

from __future__ import annotations

from abc import abstractmethod
from math import sqrt

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gaussian


class Jitter(eqx.Module):
    """Noise for particles just resampled. It matters for states that have no process noise, or little."""

    @abstractmethod
    def __call__(
        self, particles: Float[Array, "n N"], before: Gaussian, normal: Float[Array, "n N"]
    ) -> Float[Array, "n N"]:
        """Particles moved apart.

        Args:
            particles: (n, N) after resampling, one a column.
            before: moments of the particles before resampling.
            normal: (n, N) independent standard normal numbers.
        """


class Roughening(Jitter):
    """Independent noise with σ_j = K E_j N^{−1/n}, E_j the range of state j (Gordon, Salmond & Smith 1993).

    Adds to the covariance at every resampling, and so forgets: a state that does not move is found with an
    error that stops shrinking.

    Attributes:
        scale: K.
    """

    scale: float = eqx.field(default=0.2, static=True, kw_only=True)

    def __call__(
        self, particles: Float[Array, "n N"], before: Gaussian, normal: Float[Array, "n N"]
    ) -> Float[Array, "n N"]:
        """Particles moved apart."""
        n, count = particles.shape
        extent = jnp.max(particles, axis=1) - jnp.min(particles, axis=1)
        spread: Float[Array, " n"] = self.scale * count ** (-1 / n) * extent
        return particles + spread[:, None] * normal


class Regularization(Jitter):
    """Draws from a kernel density estimate with the covariance's own shape.

    Gaussian kernel of bandwidth h = c A N^{−1/(n+4)}, A = (4/(n+2))^{1/(n+4)}: for c = 1 the one with the
    least mean integrated squared error if the density is Gaussian (Silverman 1986; Musso, Oudjane & Le Gland
    2001). With ``shrink`` the particles are first drawn to their mean by √(1 − h²), so that mean and
    covariance stay what they were (Liu & West 2001), at the price of filling a gap between separate modes.

    Attributes:
        bandwidth: c.
        shrink: keep the covariance.
    """

    bandwidth: float = eqx.field(default=1.0, static=True, kw_only=True)
    shrink: bool = eqx.field(default=True, static=True, kw_only=True)

    def __call__(
        self, particles: Float[Array, "n N"], before: Gaussian, normal: Float[Array, "n N"]
    ) -> Float[Array, "n N"]:
        """Particles moved apart."""
        n, count = particles.shape
        optimal = float((4 / (n + 2)) ** (1 / (n + 4)) * count ** (-1 / (n + 4)))
        h = min(self.bandwidth * optimal, 1.0)
        if self.shrink:
            mean = before.mean[:, None]
            particles = mean + sqrt(1 - h**2) * (particles - mean)
        return particles + h * (before.factor @ normal)
