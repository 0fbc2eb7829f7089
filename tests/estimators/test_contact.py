"""What is known of the four contacts at a sample."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import WHEELS, InputError
from roadstate.core.constants import GRAVITY
from roadstate.estimators.contact import Contact, ContactMeter
from roadstate.vehicles import Vehicle

WHEEL_SPEEDS = {f"wheel_speed_{w}": 50.0 for w in WHEELS}
SAMPLE = {
    **WHEEL_SPEEDS,
    "speed": 15.0,
    "velocity_y": 0.2,
    "accel_x": 1.0,
    "accel_y": 2.0,
    "yaw_rate": 0.1,
    "steer": 0.02,
    "steering_wheel": 0.32,
}


def read(meter: ContactMeter, samples: list[dict[str, float]], dt: float = 0.01) -> Contact:
    state, contact, step = meter.init(), None, eqx.filter_jit(meter.read)
    for sample in samples:
        given = {c: jnp.asarray(sample.get(c, np.nan)) for c in meter.channels}
        state, contact = step(state, given, jnp.asarray(dt))
    assert contact is not None
    return contact


def test_direct_takes_what_is_measured(vehicle: Vehicle) -> None:
    contact = read(ContactMeter(vehicle, SAMPLE, direct=True), [SAMPLE])
    np.testing.assert_allclose(contact.velocity, [15.0, 0.2, 0.1])
    np.testing.assert_allclose(contact.accel, [1.0, 2.0])
    np.testing.assert_allclose(contact.wheel_speed, 50.0)


def test_pitch_and_roll_are_taken_out_of_the_accelerations(vehicle: Vehicle) -> None:
    """A body that leans by k a feels g sin(k a) more."""
    contact = read(ContactMeter(vehicle, SAMPLE), [SAMPLE])
    body = vehicle.body
    expected = [1 / (1 + GRAVITY * body.pitch_gradient), 2 / (1 + GRAVITY * body.roll_gradient)]
    np.testing.assert_allclose(contact.accel, expected)


def test_samples_are_held_and_age(vehicle: Vehicle) -> None:
    meter = ContactMeter(vehicle, SAMPLE, direct=True)
    contact = read(meter, [SAMPLE, {**SAMPLE, "steer": np.nan, "yaw_rate": 0.2}, {"yaw_rate": 0.3}])
    assert float(contact.steer) == pytest.approx(0.02)
    assert float(contact.velocity[2]) == pytest.approx(0.3)
    assert float(contact.age) == pytest.approx(0.02)


def test_a_steering_wheel_needs_a_ratio(vehicle: Vehicle) -> None:
    channels = {c for c in SAMPLE if c != "steer"}
    contact = read(ContactMeter(vehicle, channels), [SAMPLE])
    assert vehicle.steering is not None
    assert float(contact.steer) == pytest.approx(0.32 / vehicle.steering.ratio)
    with pytest.raises(InputError, match="without a steering ratio"):
        ContactMeter(vehicle.model_copy(update={"steering": None}), channels)


def test_without_wheel_speeds_wheels_roll_freely(vehicle: Vehicle) -> None:
    contact = read(ContactMeter(vehicle, {"speed", "accel_x", "accel_y", "yaw_rate", "steer"}), [SAMPLE] * 3)
    half = vehicle.geometry.track_rear / 2
    rear = (float(contact.velocity[0]) + np.array([-1, 1]) * 0.1 * half) / vehicle.wheels.radius
    np.testing.assert_allclose(contact.wheel_speed[2:], rear, rtol=1e-6)
    assert (contact.std[3:] > 0.04 * contact.wheel_speed).all()  # and how fast they turn is a guess


def test_the_spread_of_wheel_speeds_grows_with_them(vehicle: Vehicle) -> None:
    slow = read(ContactMeter(vehicle, SAMPLE, direct=True), [SAMPLE])
    fast = {**SAMPLE, **dict.fromkeys(WHEEL_SPEEDS, 120.0)}
    quick = read(ContactMeter(vehicle, SAMPLE, direct=True), [fast])
    assert (quick.std[3:] >= slow.std[3:]).all()
    assert (slow.std > 0).all()
