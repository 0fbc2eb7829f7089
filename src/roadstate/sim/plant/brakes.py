"""Hydraulic brakes, and simple anti-lock and traction control."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.sim.plant.base import Controls
from roadstate.tires.base import as_leaf
from roadstate.tires.smooth import Numbers

# slip beyond which a control takes away, below which it gives back; and how fast, 1/s
_AWAY, _BACK = 0.15, 0.07
_TAKING, _GIVING = 12.0, 4.0
# m/s below which neither acts
_SLOWEST = 1.5


class BrakeState(NamedTuple):
    """(4,) each.

    Attributes:
        pressure: at the wheels, Pa.
        anti_lock: share of the asked pressure that anti-lock control leaves.
        traction: share of the asked drive torque that traction control leaves.
    """

    pressure: Float[Array, " 4"]
    anti_lock: Float[Array, " 4"]
    traction: Float[Array, " 4"]


class Brakes(eqx.Module):
    """Pressure follows the pedal with a lag; torque is proportional to it.

    The controls see the true speed of the car, as no real one does, and take pressure or torque away beyond
    15 % of slip and give it back below 7 %: simple, and in no way a model of a product.

    Attributes:
        gain: (4,) torque per pressure, N·m/Pa.
        largest_pressure: at full pedal, Pa.
        lag: s.
        radius: (4,) of the wheels, m, as the controls know it.
        anti_lock, traction: 1 where the control is on, else 0.
    """

    gain: Numbers = eqx.field(converter=as_leaf)
    largest_pressure: Numbers = eqx.field(converter=as_leaf)
    lag: Numbers = eqx.field(converter=as_leaf)
    radius: Numbers = eqx.field(converter=as_leaf)
    anti_lock: Numbers = eqx.field(converter=as_leaf, default=0.0)
    traction: Numbers = eqx.field(converter=as_leaf, default=0.0)

    def advance(
        self, state: BrakeState, controls: Controls, speed: Numbers, wheel_speed: Numbers, dt: Numbers
    ) -> BrakeState:
        """The state a step later.

        Args:
            state: now.
            controls: the driver's.
            speed: of the car, m/s.
            wheel_speed: (4,) rad/s.
            dt: s.
        """
        direction = jnp.where(speed < 0, -1.0, 1.0)
        slip = direction * (self.radius * wheel_speed - speed) / jnp.maximum(jnp.abs(speed), _SLOWEST)
        moving = jnp.abs(speed) > _SLOWEST
        anti_lock = _held(state.anti_lock, -slip, moving, self.anti_lock, dt)
        traction = _held(state.traction, slip, moving | (slip > 0), self.traction, dt)
        asked = controls.brake * self.largest_pressure + controls.brake_pressure
        asked = jnp.maximum(asked, 0) * anti_lock
        pressure = state.pressure + (asked - state.pressure) * -jnp.expm1(-dt / self.lag)
        return BrakeState(pressure, anti_lock, traction)


def _held(share: Numbers, slip: Numbers, moving: Numbers, on: Numbers, dt: Numbers) -> Numbers:
    rate = jnp.where(slip > _AWAY, -_TAKING, jnp.where(slip < _BACK, _GIVING, 0.0))
    moved = jnp.clip(share + dt * jnp.where(moving, rate, _GIVING), 0.0, 1.0)
    return jnp.where(on > 0, moved, jnp.ones_like(share))
