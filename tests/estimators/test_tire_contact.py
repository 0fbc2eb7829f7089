"""How the tires touch the road while a car turns in: what lags, and what the body's roll leaves behind."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from roadstate.core.constants import GRAVITY
from roadstate.estimators.contact_forces import ForceMeter
from roadstate.estimators.intake import ACCEL_Y, SMOOTHING, SPIN, STEER, WHEEL_SPEEDS, YAW_RATE, Signals
from roadstate.estimators.sideways import SLIP_ERROR, Touch
from roadstate.estimators.tire_contact import TireContact
from roadstate.vehicles import Vehicle

DT, SPEED = 0.01, 7.0  # s, m/s: in a roundabout
AGE = 0.005  # s by which signals are late when they come


def turns_in(time: Float[Array, " t"], body: float, places: Float[Array, " 2"]) -> Float[Array, "t 4"]:
    """v_y, a_y, yaw rate and steering angle of a car whose tires follow where they point, all the while.

    From one bend into the other within a second. Tires are left behind the body by ``body`` m per m/s²: on
    the road they move across by v_y + body da_y/dt.
    """
    turning = 0.35 * jnp.tanh(4 * (time - 3))
    arm = -places[1]
    # v_y = arm r - body da_y/dt, where a_y is nearly v r + arm dr/dt
    rate = jnp.gradient(turning, time)
    lateral = SPEED * turning + arm * rate
    across = arm * turning - body * jnp.gradient(lateral, time)
    accel = jnp.gradient(across, time) + SPEED * turning
    steer = (across + body * jnp.gradient(accel, time) + places[0] * turning) / SPEED
    return jnp.stack([across, accel, turning, steer], axis=1)


def touched(
    contact: TireContact,
    vehicle: Vehicle,
    motion: Float[Array, "t 4"],
    slip: Float[Array, "t 4"] | None = None,
    noise: float = 0.0,
    slope: float = 0.0,
) -> Touch:
    """Of samples of that, and of wheels that slip, on a slope of this sine: (t, ...)."""
    forces = ForceMeter(vehicle, (*WHEEL_SPEEDS, "accel_x", "accel_y", "yaw_rate", "steer")).nothing()
    known = forces._replace(along_std=jnp.zeros(4), across_std=jnp.zeros(2))
    keep = -jnp.expm1(-DT / SMOOTHING)
    still, zero = jnp.zeros(8), jnp.zeros(())
    rows = jnp.asarray([ACCEL_Y, YAW_RATE, STEER])
    slip = jnp.zeros((len(motion), 4)) if slip is None else slip
    spins = (1 + slip) * SPEED / contact.radius

    def step(state: tuple, now: tuple[Array, Array]) -> tuple[tuple, Touch]:
        memory, smooth = state
        value = still.at[rows].set(now[0][1:]).at[SPIN].set(now[1])
        new = smooth + keep * (value - smooth)
        seen = Signals(
            value=value, age=still, is_fresh=jnp.ones(8, bool), smooth=new, rate=(new - smooth) / DT,
            lag=still + DT * (1 / keep - 1), noise=still + noise, now=value, now_rate=still,
            shaken=jnp.zeros(2), is_faulty=jnp.zeros(8, bool),
        )  # fmt: skip
        memory, touch = contact.touch(
            memory, seen, known, jnp.asarray(SPEED), (zero, zero), zero, jnp.asarray(slope),
            jnp.zeros(2), jnp.zeros((), bool), jnp.asarray(DT),
        )  # fmt: skip
        return (memory, new), touch

    first = contact.init(), still.at[rows].set(motion[0, 1:]).at[SPIN].set(spins[0])
    return jax.lax.scan(step, first, (motion, spins))[1]


@pytest.mark.parametrize("leans", [False, True], ids=["stiff", "soft"])
def test_tires_that_follow_where_they_point_slip_nowhere(vehicle: Vehicle, leans: bool) -> None:
    """While v_y changes by a metre per second within half of one, and whatever lags."""
    gradient = 0.01 if leans else 0.0
    car = vehicle.model_copy(update={"body": vehicle.body.model_copy(update={"roll_gradient": gradient})})
    contact = TireContact(car)
    assert (float(contact.sway) > 0.004) == leans
    time = jnp.arange(0, 6, DT)
    motion = turns_in(time, float(contact.sway), contact.places)
    late = turns_in(time - AGE, float(contact.sway), contact.places)
    touch = touched(contact, car, late)
    across, swing = motion[:, 0], np.abs(np.gradient(motion[:, 0], DT)).max()
    assert swing > 2.0
    slips = touch.angle - ((across - touch.lag * touch.lateral) / SPEED)[:, None]
    begun = np.asarray(time) > 1.0
    # the lag alone would be .25 m/s of v_y: 40 mrad
    assert np.abs(np.asarray(slips)[begun]).max() < 1.5e-3


def climbs(vehicle: Vehicle, slope: float, radius: float) -> tuple[float, float]:
    """v_y of the centre of gravity and yaw rate, both in the body's axes, of a car whose rear axle rolls up a
    helix of this slope (sine) at :data:`SPEED`: by differences of where it is."""
    level = np.sqrt(1 - slope**2)
    turning = SPEED * level / radius  # about the vertical

    def pose(t: float) -> tuple[np.ndarray, np.ndarray]:
        cos, sin = np.cos(turning * t), np.sin(turning * t)
        ahead = np.array([level * cos, level * sin, slope])
        left = np.array([-sin, cos, 0.0])
        up = np.cross(ahead, left)
        axle = np.array([radius * sin, -radius * cos, SPEED * slope * t])
        geometry = vehicle.geometry
        return axle + geometry.cg_to_rear_axle * ahead + geometry.cg_height * up, np.stack([ahead, left, up])

    step = 1e-4
    (before, was), (after, will) = pose(-step), pose(step)
    _, axes = pose(0.0)
    spin = (will - was) / (2 * step)
    return float((after - before) @ axes[1] / (2 * step)), float(spin[0] @ axes[1])


@pytest.mark.parametrize("radius", [12.0, -12.0])
@pytest.mark.parametrize("slope", [0.1, -0.1, 0.0])
def test_a_rear_axle_that_rolls_up_a_helix_does_not_slip(
    vehicle: Vehicle, slope: float, radius: float
) -> None:
    """A car that turns about the vertical on a slope rolls about its own axis, too, and the centre of gravity
    above the road moves aside by that: 3 cm/s of it here."""
    across, turning = climbs(vehicle, slope, radius)
    assert turning == pytest.approx(SPEED * (1 - slope**2) / radius, rel=1e-6)
    motion = jnp.tile(jnp.asarray([across, SPEED * turning, turning, 0.0]), (300, 1))
    touch = touched(TireContact(vehicle), vehicle, motion, slope=slope)
    slips = float(touch.angle[-1, 1]) - across / SPEED
    assert abs(slips) < 2e-4
    assert abs(across / SPEED - vehicle.geometry.cg_to_rear_axle * turning / SPEED) > 0.045 * abs(
        slope / radius
    )


@pytest.mark.parametrize("amplitude", [0.2, 0.03])
def test_a_wheel_that_hops_is_unsure_of_its_slip_where_that_turns_as_well(
    vehicle: Vehicle, amplitude: float
) -> None:
    """At 12 Hz for a quarter of a second: what lags is wrong by most where it changes fastest, and at the
    turning points by what it has just been. Not one that swings no more than on a road that begins."""
    time = jnp.arange(0, 2, DT)
    hops = (time > 1.0) & (time < 1.25)
    swings = jnp.where(hops, amplitude * jnp.sin(2 * np.pi * 12 * (time - 1)), 0.0)
    slip = swings[:, None] * jnp.asarray([1.0, 0, 0, 0])
    touch = touched(TireContact(vehicle), vehicle, jnp.zeros((len(time), 4)), slip)
    unsure = np.asarray(touch.slip_std)
    within = unsure[np.asarray((time > 1.05) & (time < 1.25)), 0]
    assert within.max() > 3 * SLIP_ERROR
    assert (within.min() > 0.5 * within.max()) == (amplitude > 0.1)
    # and is sure again soon after, as the others were all the while
    np.testing.assert_allclose(unsure[np.asarray(time < 1.0)], SLIP_ERROR, rtol=1e-6)
    np.testing.assert_allclose(unsure[np.asarray(time > 1.7), 0], SLIP_ERROR, rtol=0.01)
    np.testing.assert_allclose(unsure[:, 1:], SLIP_ERROR, rtol=1e-6)


def test_what_few_samples_leave_of_noise_is_in_the_force(vehicle: Vehicle) -> None:
    """At 100 Hz the low pass leaves σ²/(2 T f) of a sample's σ²; of one that it keeps whole, all."""
    contact = TireContact(vehicle)
    motion = jnp.zeros((1, 4))
    still = np.asarray(touched(contact, vehicle, motion).shaken)
    density = vehicle.sensors.accel.noise_density / GRAVITY
    many = np.asarray(touched(contact, vehicle, motion, noise=0.0997).shaken)
    few = np.asarray(touched(contact, vehicle, motion, noise=1.0).shaken)
    np.testing.assert_allclose(still, 0.0, atol=1e-12)
    np.testing.assert_allclose(many[0], [0.0, density / (2 * SMOOTHING) ** 0.5], rtol=1e-6)
    np.testing.assert_allclose(few[0], [0.0, density * 100**0.5], rtol=0.01)
