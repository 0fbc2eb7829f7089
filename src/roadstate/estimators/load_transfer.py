"""How an acceleration comes to the wheels as load: by way of the springs, as the body pitches."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

_FREQUENCY = 1.35  # Hz: at which the body of a car pitches
_DAMPING = 0.35  # of it, as a share of the critical one
_DIRECT = 0.15  # share that the links take at once: anti-dive and anti-squat
_NATURAL = 2 * np.pi * _FREQUENCY
_DAMPED = _NATURAL * float(np.sqrt(1 - _DAMPING**2))


class Lean(NamedTuple):
    """How far the body has come to lean.

    Attributes:
        accel: the acceleration at which it would lean like that for good, m/s².
        rate: of it, m/s³.
    """

    accel: Float[Array, ""]
    rate: Float[Array, ""]

    @classmethod
    def upright(cls) -> Lean:
        """Nothing accelerates the car."""
        return cls(jnp.zeros(()), jnp.zeros(()))

    def after(self, accel: Float[Array, ""], dt: Float[Array, ""]) -> Lean:
        """Under an acceleration (m/s²) that is held for ``dt`` (s): a damped oscillator's exact solution."""
        fades = jnp.exp(-_DAMPING * _NATURAL * dt)
        sine, cosine = jnp.sin(_DAMPED * dt) / _DAMPED, jnp.cos(_DAMPED * dt)
        short = self.accel - accel
        away = (cosine + _DAMPING * _NATURAL * sine) * short + sine * self.rate
        rate = (cosine - _DAMPING * _NATURAL * sine) * self.rate - _NATURAL**2 * sine * short
        return Lean(accel + fades * away, fades * rate)

    def transferred(self, accel: Float[Array, ""]) -> Float[Array, ""]:
        """The lasting acceleration that would shift as much load from axle to axle as this one does now.

        A car that brakes harder takes a third of a second until its body has dived, and only then do springs
        and dampers press the front wheels as a steady deceleration would. Between anti-lock control's cycles
        that is a tenth of an axle's load. (How bodies bounce and pitch: Gillespie, *Fundamentals of Vehicle
        Dynamics*, ch. 5; the figures are of cars, and of no one in particular.)

        Args:
            accel: at this instant, m/s².
        """
        springs = self.accel + 2 * _DAMPING / _NATURAL * self.rate
        return _DIRECT * accel + (1 - _DIRECT) * springs
