"""Stability control: brakes single wheels of a car that turns otherwise than it is steered."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.tires.base import as_leaf
from roadstate.tires.smooth import Numbers

_GENTLE = 0.04  # rad/s by which a car may turn otherwise
_GAIN = 8e7  # Pa/(rad/s)
_MOST = 1e7  # Pa
_REAR = 0.6  # of that at a rear wheel
_HOLDS = (1.2, 3.0)  # times the lateral acceleration there is that a road holds, and m/s² that any does
_SLOWEST = 5.0  # m/s below which it does not act


class StabilityControl(eqx.Module):
    """Brakes the outer front wheel where a car turns in too far, the inner rear one where too little.

    The yaw rate that is wanted is that of a steady turn, r = v δ/(l + K v²) (Gillespie, *Fundamentals of
    Vehicle Dynamics*, ch. 6), but no more than goes with 1.2 times the lateral acceleration there is, or with
    3 m/s². It sees the true motion, and is simple and in no way a model of a product.

    Attributes:
        ratio: of the steering.
        wheelbase: l, m.
        understeer: K, s²/m.
    """

    ratio: Numbers = eqx.field(converter=as_leaf)
    wheelbase: Numbers = eqx.field(converter=as_leaf)
    understeer: Numbers = eqx.field(converter=as_leaf)

    def pressure(
        self, speed: Numbers, yaw_rate: Numbers, accel_y: Numbers, steering_wheel: Numbers
    ) -> Float[Array, " 4"]:
        """(4,) line pressure that it asks of each wheel on top of the driver's, Pa.

        Args:
            speed: along x, m/s.
            yaw_rate: rad/s.
            accel_y: m/s².
            steering_wheel: rad.
        """
        moving = jnp.maximum(speed, _SLOWEST)
        wanted = moving * steering_wheel / self.ratio / (self.wheelbase + self.understeer * moving**2)
        most = jnp.maximum(_HOLDS[0] * jnp.abs(accel_y), _HOLDS[1]) / moving
        beyond = yaw_rate - jnp.clip(wanted, -most, most)
        asked = jnp.clip(_GAIN * (jnp.abs(beyond) - _GENTLE), 0.0, _MOST) * (speed > _SLOWEST)
        # to the left: the outer side is the right one
        left, too_far = yaw_rate > 0, beyond * yaw_rate > 0
        front, rear = jnp.where(too_far, asked, 0.0), jnp.where(too_far, 0.0, _REAR * asked)
        zero = jnp.zeros_like(asked)
        return jnp.stack(
            [
                jnp.where(left, zero, front),
                jnp.where(left, front, zero),
                jnp.where(left, rear, zero),
                jnp.where(left, zero, rear),
            ]
        )
