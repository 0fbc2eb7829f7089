"""What goes into the motion along the road at one instant."""

from __future__ import annotations

import jax.numpy as jnp

from roadstate.estimators.along import AlongInput
from roadstate.estimators.loading import Loading
from roadstate.estimators.pitch import Pitching
from roadstate.estimators.undulation import Undulation
from roadstate.tires.smooth import Numbers

NOISE = 0.05  # m/s: of a wheel's speed


def given(speed: Numbers, accel: Numbers, slip: Numbers) -> AlongInput:
    """Straight on, with forces that make each wheel slip as said."""
    zero = jnp.zeros(())
    return AlongInput(
        accel=zero + accel, by_torque=zero > 0, gaining=zero + accel, lean=zero + accel,
        lasting=zero + accel, drive=zero, brake=zero, rolling=zero, lever=zero, turned=zero,
        speed=zero + speed, passing=zero + speed, intensity=zero + 0.02, smooth_across=zero,
        turning=zero, pitching=Pitching(zero, zero), slip=jnp.full(4, slip),
        loading=Loading.none(jnp.zeros((3, 2))), undulation=Undulation.none(),
        tilting=jnp.zeros(2), sensor_std=jnp.full(4, NOISE),
    )  # fmt: skip
