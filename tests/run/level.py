"""An estimator that is a linear model and a Kalman filter and nothing else."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from roadstate.core import Validity
from roadstate.core.gaussian import Gaussian, Info
from roadstate.estimators import Estimate, Estimator, Need
from roadstate.estimators.base import Smoothable
from roadstate.filters import KF, FilterState, GateRule
from roadstate.statespace import StateSpaceModel
from roadstate.vehicles import Vehicle

WHITE, ALTITUDE_STD, CLIMB_STD = 0.5, 0.3, 2.0


class Climb(StateSpaceModel):
    """x = [h, ḣ], ḧ white; the input is a known acceleration."""

    states: tuple[str, ...] = eqx.field(default=("altitude", "climb"), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("altitude", "vertical_speed"), static=True)

    def f(self, x: Any, u: Any, dt: Any) -> Any:
        return jnp.stack([x[0] + x[1] * dt, x[1] + u * dt])

    def h(self, x: Any, u: Any) -> Any:
        return x

    def sqrt_Q(self, u: Any, dt: Any) -> Any:
        return jnp.diag(WHITE * jnp.sqrt(dt) * jnp.asarray([0.2, 1.0]))

    def sqrt_R(self, u: Any) -> Any:
        return jnp.diag(jnp.asarray([ALTITUDE_STD, CLIMB_STD]))

    def prior(self) -> Gaussian:
        return Gaussian(jnp.zeros(2), jnp.diag(jnp.asarray([5.0, 2.0])))


class LevelState(NamedTuple):
    level: FilterState
    steps: Any


class Level(Estimator[LevelState]):
    """Altitude, smoothed; ``speed`` counts the steps and is not."""

    name: ClassVar[str] = "level"
    summary: ClassVar[str] = "altitude"
    needs: ClassVar[tuple[Need, ...]] = (Need("an altitude", (("altitude",),)),)
    smoothable: ClassVar[Smoothable | None] = Smoothable("filter", "level", ("altitude", "mass"))
    channels: tuple[str, ...] = eqx.field(default=("altitude", "vertical_speed", "accel_z"), static=True)
    sensors: tuple[str, ...] = eqx.field(default=("altitude", "vertical_speed"), static=True)
    filter: KF = eqx.field(default_factory=lambda: KF(gate=None))
    model: Climb = eqx.field(default_factory=Climb)

    @classmethod
    def build(cls, vehicle: Vehicle, available: Collection[str], **options: Any) -> Level:
        return cls(filter=KF(gate=GateRule()))

    def init(self) -> LevelState:
        return LevelState(self.filter.init(self.model), jnp.zeros(()))

    def step(self, state: LevelState, sample: Any, dt: Any) -> tuple[LevelState, Info]:
        z = jnp.stack([sample["altitude"], sample["vertical_speed"]])
        new, info = self.filter.step(self.model, state.level, sample["accel_z"], z, dt)
        return LevelState(new, state.steps + 1), info

    def estimate(self, state: LevelState) -> Estimate:
        mean, std = state.level.gaussian.mean, state.level.gaussian.std
        return Estimate(
            {"altitude": mean[0], "speed": state.steps},
            {"altitude": std[0], "speed": state.steps},
            jnp.asarray(int(Validity.EXCITED)),
        )
