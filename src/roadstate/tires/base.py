"""The contract of a tire model."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Literal, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike

from roadstate.tires.smooth import Numbers

# Ratio of the load to the nominal one under which stiffnesses no longer fall: their power of the load keeps
# a finite slope at zero.
_LOWEST_LOAD_RATIO = 1e-3


Fit = Literal["positive", "not_negative", "free"]
"""How a fit may move a parameter: above zero only, down to zero, or anywhere."""


class TireForce(NamedTuple):
    """Force of the road on the tire in the wheel frame (x forward, y left), N, any shape."""

    F_x: Numbers
    F_y: Numbers


def as_leaf(value: Any) -> Numbers:
    """A number or array as a parameter leaf; a plain number follows the precision of what it meets."""
    if isinstance(value, (int, float, np.integer, np.floating)):
        return jnp.asarray(float(value))
    array = jnp.asarray(value)
    return array if jnp.issubdtype(array.dtype, jnp.inexact) else array.astype(jnp.result_type(float))


def parameter(default: float) -> Any:
    """A field that is an array leaf: it can be batched, differentiated, estimated, and never recompiles."""
    return eqx.field(default=default, converter=as_leaf)


class TireModel(eqx.Module):
    """A tire: slip, load and friction in, force out; pure, and any shapes that broadcast together.

    Attributes:
        name: as chosen on the command line and in a vehicle file.
        summary: one line.
        fitted: the parameters that :func:`roadstate.tires.fit.fit_tire` moves, and how far.
        within_friction_circle: |F| ≤ μ·F_z holds for every input.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    fitted: ClassVar[Mapping[str, Fit]]
    within_friction_circle: ClassVar[bool] = True

    @abstractmethod
    def forces(
        self, slip: ArrayLike, slip_angle: ArrayLike, load: ArrayLike, friction: ArrayLike, speed: ArrayLike
    ) -> TireForce:
        """The steady force.

        Args:
            slip: practical slip κ = (R_w ω − v_x)/|v_x|; −1 is a locked wheel (forwards).
            slip_angle: α, rad; positive gives a force to the left.
            load: vertical load F_z, N; nothing is carried at zero and below.
            friction: peak friction coefficient μ of tire and road.
            speed: v_x of the wheel centre, m/s; its sign tells braking from driving in reverse, where a
                locked wheel has κ = +1. Given |v_x|, the wheel is taken to travel forwards.
        """

    @classmethod
    def default(cls) -> Self:
        """A typical passenger-car tire, the same on both sides of the car."""
        return cls()


class ElasticTire(TireModel):
    """What the models made of two slip stiffnesses share.

    C(F_z) = C₀ (F_z/F_z0)ⁿ: n = 0 is the textbooks' constant, n = 1 proportional to load; real tires lie
    near 1 for C_κ and between 0.3 and 0.8 for C_α around their rated load.

    Attributes:
        slip_stiffness: C_κ at the nominal load, N.
        cornering_stiffness: C_α at the nominal load, N/rad.
        nominal_load: F_z0, N; of no effect where the exponent is 0.
        slip_load_exponent: n of C_κ.
        cornering_load_exponent: n of C_α.
    """

    fitted: ClassVar[Mapping[str, Fit]] = {
        "slip_stiffness": "positive",
        "cornering_stiffness": "positive",
        "slip_load_exponent": "free",
        "cornering_load_exponent": "free",
    }

    slip_stiffness: Numbers = parameter(87e3)
    cornering_stiffness: Numbers = parameter(53e3)
    nominal_load: Numbers = parameter(4e3)
    slip_load_exponent: Numbers = parameter(0.0)
    cornering_load_exponent: Numbers = parameter(0.0)

    def stiffnesses(self, load: Numbers) -> tuple[Numbers, Numbers]:
        """C_κ (N) and C_α (N/rad) at a load (N)."""
        ratio = jnp.maximum(load / self.nominal_load, _LOWEST_LOAD_RATIO)
        return (
            self.slip_stiffness * ratio**self.slip_load_exponent,
            self.cornering_stiffness * ratio**self.cornering_load_exponent,
        )
