"""How the body leans under an acceleration, which then reaches wheels and accelerometer."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.constants import GRAVITY
from roadstate.estimators.base import leaf

if TYPE_CHECKING:
    from roadstate.vehicles import SevenDofForces, Vehicle

SWAY_ARM = 0.85
"""Of the centre of gravity over the axis that the body rolls about, over its height."""
_FRONT_MORE = 0.03  # by which the front axle's share of the roll moment exceeds that of the weight
_FREQUENCY = 1.5  # Hz: at which the body of a car pitches
_DAMPING = 0.35  # of it, as a share of the critical one
_LASTS = 0.5  # s for which an acceleration lasts that is none of a rough road's
_NATURAL = 2 * np.pi * _FREQUENCY
_DAMPED = _NATURAL * float(np.sqrt(1 - _DAMPING**2))


class Lean(NamedTuple):
    """How far the body has come to lean.

    Attributes:
        accel: the acceleration at which it would lean like that for good, m/s².
        rate: of it, m/s³.
        lasting: what of the acceleration itself lasts for half a second, m/s².
    """

    accel: Float[Array, ""]
    rate: Float[Array, ""]
    lasting: Float[Array, ""]

    @classmethod
    def upright(cls) -> Lean:
        """Nothing accelerates the car."""
        return cls(jnp.zeros(()), jnp.zeros(()), jnp.zeros(()))

    def after(self, accel: Float[Array, ""], dt: Float[Array, ""]) -> Lean:
        """Under an acceleration (m/s²) that is held for ``dt`` (s): a damped oscillator's exact solution."""
        fades = jnp.exp(-_DAMPING * _NATURAL * dt)
        sine, cosine = jnp.sin(_DAMPED * dt) / _DAMPED, jnp.cos(_DAMPED * dt)
        short = self.accel - accel
        away = (cosine + _DAMPING * _NATURAL * sine) * short + sine * self.rate
        rate = (cosine - _DAMPING * _NATURAL * sine) * self.rate - _NATURAL**2 * sine * short
        lasting = self.lasting - jnp.expm1(-dt / _LASTS) * (accel - self.lasting)
        return Lean(accel + fades * away, fades * rate, lasting)

    def ahead(self, lag: float) -> Lean:
        """What it is of the acceleration itself, which had been low-passed by a first order of ``lag`` s."""
        return self._replace(accel=self.accel + lag * self.rate)

    def transferred(self) -> Float[Array, ""]:
        """The lasting acceleration that would shift as much load from axle to axle, m/s².

        A car that brakes harder takes a third of a second until its body has dived, and only then do springs
        and dampers press the front wheels as a steady deceleration would. Between anti-lock control's cycles
        that is a tenth of an axle's load. (How bodies bounce and pitch: Gillespie, *Fundamentals of Vehicle
        Dynamics*, ch. 5; the figures are of cars, and of no one in particular.)
        """
        return self.accel + 2 * _DAMPING / _NATURAL * self.rate

    def freed(self, accel: Float[Array, ""], share: Float[Array, ""]) -> Float[Array, ""]:
        """A specific force (m/s²) that was freed of a lasting pitch, freed of the body's own instead.

        Args:
            accel: what an accelerometer reads, over 1 + ``share``, m/s².
            share: g times the pitch gradient: what a body that leans for good adds, as a share.
        """
        return accel + share * (accel - self.accel)


class LoadShift(eqx.Module):
    """Loads of the wheels of a car whose body leans.

    In a bend the body rolls outward, and its centre of gravity with it: g times the roll gradient times the
    height over the roll axis comes to 7 % of what the centrifugal force shifts. And bars and springs give the
    front axle more than its share of the weight, without which a car would oversteer. (How a roll moment is
    shared: Gillespie, *Fundamentals of Vehicle Dynamics*, ch. 6.)

    Attributes:
        car: with the front's share of the roll moment.
        tips: the roll moment of a body that leans, over that of one that does not.
    """

    car: SevenDofForces
    tips: Float[Array, ""]

    @classmethod
    def of(cls, vehicle: Vehicle, car: SevenDofForces) -> Self:
        """For the body of a vehicle file, and a car without one."""
        share = jnp.clip(car.front_roll_share + _FRONT_MORE, 0.0, 1.0)
        stiffer = eqx.tree_at(lambda c: c.front_roll_share, car, share)
        return cls(stiffer, leaf(1 + GRAVITY * SWAY_ARM * vehicle.body.roll_gradient))

    def loads(self, along: Float[Array, ""], across: Float[Array, ""]) -> Float[Array, " 4"]:
        """Of a car of the file's mass, N, under specific forces in m/s²."""
        return self.car.wheel_loads(along, self.tips * across)
