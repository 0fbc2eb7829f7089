"""A load that changes while the car stands: passengers, goods, a trailer."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

_STANDS = 0.1  # m/s below which the car stands
_BOARDING = 3.0  # s of standing in which a load may change
_TOLD = 60.0  # s after which one that has changed would have been noticed
_SURE = 3.0  # of their own 1σ by which corrections of the mass have to differ from 0
_LEAST = 0.003  # share of the mass that corrections may differ by for other reasons, besides
_LOAD = 0.15  # 1σ of a load that has changed, as a share of the mass


class Loading(NamedTuple):
    """Whether the mass has changed since the car last stood.

    If all is as a Kalman filter assumes, its corrections of a state are independent of one another and of
    mean 0, and the variance of each is what it takes off the state's variance (K S Kᵀ = P⁻ − P⁺): an estimate
    that knows its σ moves by no more, over a while, than what its σ would have shrunk by. A mass that moves
    farther is another one. By then some of the load has passed for an error of the torques: what was known of
    their gains as the car stood is known of them still.

    Attributes:
        stood: s for which the car has stood.
        since: s since it last stood for long.
        moved: what the mass has been corrected by since then, as a share.
        variance: of that, were the mass the same.
        gains: (3, 2) of the torques of drive and brakes, as the car last stood: mean, variance, and their
            covariance with the mass, which no load changes.
        std: 1σ of what has changed the mass at the last sample; 0 but where that has just been noticed.
    """

    stood: Float[Array, ""]
    since: Float[Array, ""]
    moved: Float[Array, ""]
    variance: Float[Array, ""]
    gains: Float[Array, "3 2"]
    std: Float[Array, ""]

    @classmethod
    def none(cls, gains: Float[Array, "3 2"]) -> Loading:
        """Before the first sample: whatever is loaded is what the vehicle file says, as ``gains`` are."""
        zero = jnp.zeros(())
        return cls(zero, zero + _TOLD, zero, zero, gains, zero)

    @property
    def unsure(self) -> Float[Array, ""]:
        """1σ of a load, as a share of the mass, that may have come at the last stop and not yet shown."""
        return jnp.where(self.since < _TOLD, _LOAD, 0.0)

    def take(
        self,
        predicted: tuple[Float[Array, ""], Float[Array, ""]],
        corrected: tuple[Float[Array, ""], Float[Array, ""]],
        gains: Float[Array, "3 2"],
        speed: Float[Array, ""],
        dt: Float[Array, ""],
    ) -> Loading:
        """A sample later.

        Args:
            predicted: the mass before the sample, as a share, and its variance.
            corrected: both after it.
            gains: after it.
            speed: m/s.
            dt: s.
        """
        stands = jnp.abs(speed) < _STANDS
        stood = jnp.where(stands, self.stood + dt, 0.0)
        boards = stood > _BOARDING
        anew = boards | (self.std > 0)
        since = jnp.where(boards, 0.0, self.since + dt)
        moved = jnp.where(anew, 0.0, self.moved + corrected[0] - predicted[0])
        variance = jnp.where(anew, 0.0, self.variance + jnp.maximum(predicted[1] - corrected[1], 0.0))
        differs = (since < _TOLD) & (moved**2 > _SURE**2 * (variance + _LEAST**2))
        gains = jnp.where(boards, gains, self.gains)
        return Loading(stood, since, moved, variance, gains, jnp.where(differs, _LOAD, 0.0))
