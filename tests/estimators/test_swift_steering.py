"""Who steers and brakes swiftly shakes a car both ways for a moment, as a rough road does for long."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from roadstate.estimators.contact_forces import ForceMeter
from roadstate.estimators.intake import ACCEL_Y, SPIN, Signals
from roadstate.estimators.shaking import Shaking
from roadstate.vehicles import load_vehicle

SPEED, STEP = 20.0, 0.01
BEGINS, TAKES, MOST = 2.0, 0.3, 7.0  # s, s and m/s²


def test_lateral_forces_follow_at_once() -> None:
    """Straight ahead, then within .3 s into 7 m/s²: as both accelerometers would be shaken that felt it."""
    vehicle = load_vehicle("family-car")
    meter, read = ForceMeter(vehicle, []), eqx.filter_jit(ForceMeter.read)
    zero, still = jnp.zeros(8), jnp.zeros(())
    state, told = meter.init(), []
    time = np.arange(0, 3, STEP)
    accel = MOST * np.clip((time - BEGINS) / TAKES, 0, 1)
    shaking, take, both = Shaking.still(2), eqx.filter_jit(Shaking.take), jnp.ones(2, bool)
    for across in accel:
        shaking = take(shaking, jnp.full(2, across), both, ~both, jnp.full(2, STEP))
        value = zero.at[ACCEL_Y].set(across).at[SPIN].set(SPEED / vehicle.wheels.radius)
        signals = Signals(
            value, zero, jnp.ones(8, bool), value, zero, zero, zero, value, zero,
            shaking.size, jnp.zeros(8, bool),
        )  # fmt: skip
        about = jnp.asarray(SPEED), jnp.zeros(2), still, jnp.zeros(2), jnp.ones(()), jnp.asarray(STEP)
        state, forces = read(meter, state, {}, signals, *about)
        told.append(float(jnp.sum(forces.now.across)) / vehicle.mass)
    off = np.abs(np.array(told) - accel)
    assert off[time > BEGINS + 0.1].max() < 0.1 * MOST
    assert off[time > BEGINS + TAKES + 0.1].max() < 0.03 * MOST
