"""Noise of sensors is no force on the tires, and what pushes a car does so at once."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from roadstate.calibration.parameters import with_value
from roadstate.core import WHEELS
from roadstate.estimators.axle_forces import AxleForces
from roadstate.estimators.contact_forces import ForceMeter, ForceMeterState
from roadstate.estimators.intake import ACCEL_Y, SPIN, Signals
from roadstate.vehicles import Vehicle

SPEED, STEP = 20.0, 0.01


def forces_of(vehicle: Vehicle, across: Array, torques: Array) -> AxleForces:
    """At 20 m/s, straight on, by an accelerometer (T,) whose slow readings are 0, and the torque of each
    front wheel (T, 2)."""
    meter = ForceMeter(vehicle, [f"drive_torque_{w}" for w in WHEELS])
    zero, still, one = jnp.zeros(8), jnp.zeros(()), jnp.ones(())
    rolls = zero.at[SPIN].set(SPEED / vehicle.wheels.radius)
    fresh = jnp.ones(8, bool)

    def step(state: ForceMeterState, told: tuple[Array, Array]) -> tuple[ForceMeterState, AxleForces]:
        now = rolls.at[ACCEL_Y].set(told[0])
        signals = Signals(now, zero, fresh, rolls, zero, zero, zero, now, zero, jnp.zeros(2), ~fresh)
        sample = dict.fromkeys(meter.channels, still)
        sample |= {f"drive_torque_{w}": told[1][i] for i, w in enumerate(("fl", "fr"))}
        about = jnp.asarray(SPEED), jnp.zeros(2), still, jnp.zeros(3), one, jnp.asarray(STEP)
        return meter.read(state, sample, signals, *about)

    forces: AxleForces = jax.lax.scan(step, meter.init(), (jnp.asarray(across), jnp.asarray(torques)))[1]
    return forces


def test_noise_of_torques_is_no_force_and_a_jump_of_them_is_one_at_once(vehicle: Vehicle) -> None:
    """White noise of 10 N·m at each driven wheel, that makes 46 N on the axle, and then 800 N·m more."""
    torques = 100.0 + np.random.default_rng(0).normal(0.0, 10.0, (400, 2))
    torques[300:] += 800.0
    told = np.asarray(forces_of(vehicle, np.zeros(400), torques).now.told)[:, 0]
    raw = torques.sum(axis=1) / vehicle.wheels.radius
    assert np.std(told[50:300]) < 0.6 * np.std(raw[50:300])
    np.testing.assert_allclose(np.diff(told)[299], np.diff(raw)[299], rtol=0.02)


@pytest.mark.parametrize("noisier", [0.3, 1.0, 3.0])
def test_noise_of_a_lateral_accelerometer_is_no_force_and_a_swerve_is_one_at_once(
    vehicle: Vehicle, noisier: float
) -> None:
    """White noise of 3.3 Hz½ times the density that the vehicle file has, and then a swerve of twenty
    times as much. A file with a third of the density keeps more of it."""
    density = vehicle.sensors.accel.noise_density
    std = 3.3 * noisier * density
    across = np.random.default_rng(1).normal(0.0, std, 400)
    across[300:] += 20 * std
    kept = {}
    for stated in (noisier, noisier / 3):
        car = with_value(vehicle, ("sensors", "accel", "noise_density"), stated * density)
        pushes = np.asarray(forces_of(car, across, np.zeros((400, 2))).now.across).sum(axis=1)
        kept[stated] = np.std(pushes[50:300]) / (vehicle.mass * std)
        assert np.diff(pushes)[299] == pytest.approx(vehicle.mass * np.diff(across)[299], rel=0.02)
    assert kept[noisier] < 0.6 < 0.8 < kept[noisier / 3]
