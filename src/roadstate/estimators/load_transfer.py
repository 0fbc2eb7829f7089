"""How the body comes to pitch under an acceleration, which then reaches wheels and accelerometer."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

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
