"""An estimator so simple that its results are known."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from roadstate.core import Validity
from roadstate.core.gaussian import Gate, Info, Reason
from roadstate.estimators import Estimate, Estimator, Need
from roadstate.vehicles import Vehicle


class Counts(NamedTuple):
    distance: Any
    steps: Any


class Odometer(Estimator[Counts]):
    """Adds up speed × time; takes a negative speed for one that a gate refused, zero for one not tested."""

    name: ClassVar[str] = "odometer"
    summary: ClassVar[str] = "distance by speed"
    needs: ClassVar[tuple[Need, ...]] = (Need("a speed", (("speed",),)),)
    channels: tuple[str, ...] = eqx.field(default=("speed", "yaw_rate"), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("speed",), static=True)
    gain: Any = eqx.field(default_factory=lambda: jnp.asarray(1.0))

    @classmethod
    def build(cls, vehicle: Vehicle, available: Collection[str], **options: Any) -> Odometer:
        return cls()

    def init(self) -> Counts:
        return Counts(jnp.zeros(()), jnp.zeros((), jnp.int32))

    def step(self, state: Counts, sample: Any, dt: Any) -> tuple[Counts, Info]:
        speed = sample["speed"]
        seen = jnp.isfinite(speed)
        distance = state.distance + jnp.where(seen, speed, 0.0) * dt * self.gain
        used = seen & (speed > 0)
        gate = jnp.where(seen, jnp.where(speed < 0, Gate.REJECTED, Gate.PASSED), Gate.NOT_TESTED)
        info = Info(
            innovation=speed[None],
            S=jnp.full((1, 1), 4.0),
            nis=jnp.where(used, speed**2, 0.0),
            log_likelihood=jnp.zeros(()),
            gate=gate[None],
            ok=jnp.asarray(True),
            reason=jnp.where(used, Reason.OK, Reason.NO_MEASUREMENT),
        )
        return Counts(distance, state.steps + 1), info

    def estimate(self, state: Counts) -> Estimate:
        validity = jnp.asarray(int(Validity.EXCITED))
        return Estimate({"altitude": state.distance}, {"altitude": 1.0 + state.steps}, validity)
