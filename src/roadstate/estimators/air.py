"""How air holds a car back, and how far that is known before the drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.estimators.base import leaf
from roadstate.linalg import rss

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle


class Air(eqx.Module):
    """Air that flows past a car at v + w, with w from ahead, takes d (v + w)|v + w| of its acceleration.

    Attributes:
        drag: d = ½ρ c_d A/m by the vehicle file, 1/m.
        area_std: 1σ of it, as a share of it.
        wind_std: 1σ of w, m/s.
    """

    drag: Float[Array, ""]
    area_std: Float[Array, ""]
    wind_std: Float[Array, ""]

    def __init__(self, vehicle: Vehicle) -> None:
        prior = vehicle.prior
        self.drag = leaf(vehicle.drag_factor / vehicle.mass)
        self.area_std, self.wind_std = leaf(prior.drag_relative), leaf(prior.wind_std)

    def resists(self, speed: Float[Array, ""]) -> Float[Array, ""]:
        """Specific force, m/s², of air that flows past at ``speed``, m/s."""
        return self.drag * speed * jnp.abs(speed)

    def std(self, speed: Float[Array, ""]) -> Float[Array, ""]:
        """1σ of it for a car of that speed, m/s²."""
        return rss(self.area_std * self.resists(speed), 2 * self.drag * speed * self.wind_std)
