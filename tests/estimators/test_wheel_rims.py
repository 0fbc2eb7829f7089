"""Which wheels tell the car's speed: 10 m/s, of which the torques and accelerometer know."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.estimators.contact_forces import ForceMeter
from roadstate.estimators.intake import SPIN, Signals
from roadstate.estimators.signals import NEVER
from roadstate.estimators.wheel_rims import Motion, Rims, RimState
from roadstate.vehicles import Vehicle


def read(
    vehicle: Vehicle,
    spin: list[float],
    gains: list[float],
    state: RimState | None = None,
    bears: float = 0.0,
    spread: float = 0.05,
) -> tuple[RimState, np.ndarray]:
    """The state after a sample, and (4,) 1σ of what wheels tell.

    Args:
        vehicle: the car.
        spin: of the wheels, as speeds, m/s.
        gains: their rates, m/s².
        state: before; of wheels that have agreed if none.
        bears: F_x of the tires over their loads.
        spread: 1σ of the car's speed, m/s.
    """
    rims, forces = Rims(vehicle), ForceMeter(vehicle, ()).nothing()
    forces = forces._replace(along=bears * forces.load)
    radius, zero = vehicle.wheels.radius, jnp.zeros(8)
    seen = Signals(
        value=zero.at[SPIN].set(jnp.asarray(spin) / radius),
        age=zero,
        is_fresh=jnp.ones(8, bool),
        smooth=zero.at[SPIN].set(jnp.asarray(spin) / radius),
        rate=zero.at[SPIN].set(jnp.asarray(gains) / radius),
        lag=zero,
        noise=zero,
        now=zero,
        now_rate=zero,
        shaken=jnp.zeros(2),
        is_faulty=jnp.zeros(8, bool),
    )
    none = jnp.zeros(())
    before = rims.init()._replace(proof=none + NEVER) if state is None else state
    car = Motion(jnp.asarray(10.0), jnp.asarray(spread), none, none, none)
    after, _, std = rims.read(before, seen, forces, car, jnp.full(4, 0.01), jnp.asarray(0.01))
    return after, np.asarray(std)


def test_a_wheel_that_spins_up_is_mistrusted_before_it_is_far(vehicle: Vehicle) -> None:
    rolls = read(vehicle, [10.0] * 4, [0.0] * 4)[1]
    spins = read(vehicle, [10.1, 10, 10, 10], [12.0, 0, 0, 0])[1]
    assert spins[0] > 100 * rolls[0]
    # only all together can such a small gain be anything but noise
    all_spin = read(vehicle, [10.05] * 4, [4.0] * 4)[1]
    assert (all_spin > 50 * rolls).all()
    assert read(vehicle, [10.05, 10, 10, 10], [4.0, 0, 0, 0])[1][0] == pytest.approx(rolls[0])


def test_wheels_that_long_agree_are_believed_again(vehicle: Vehicle) -> None:
    state, std = read(vehicle, [14.0] * 4, [0.0] * 4)
    assert (std > 10).all()
    for _ in range(150):
        state, std = read(vehicle, [14.0] * 4, [0.0] * 4, state)
    assert (std < 0.2).all()
    # but locked wheels agree as well
    state, std = read(vehicle, [0.0] * 4, [0.0] * 4)
    for _ in range(200):
        state, std = read(vehicle, [0.0] * 4, [0.0] * 4, state)
    assert (std > 10).all()


def test_a_wheel_that_comes_back_from_locking_bounds_the_speed(vehicle: Vehicle) -> None:
    """It is no faster than the car while brakes act; if it reads so by more than its swing, the car is."""
    raced = Rims(vehicle).init()._replace(proof=jnp.asarray(NEVER), racing=jnp.full(4, 20.0))
    # freed of the slip of its force, which counts for a fifth as it is let go
    slip = float(Rims(vehicle).slips(jnp.asarray(-0.3), jnp.asarray(1.0))) / 5
    spin = [(10 + more) * (1 + slip) for more in (0.3, 0.05, -0.3, -2.0)]
    std = read(vehicle, spin, [30.0] * 4, raced, -0.3)[1]
    assert std[0] < 0.015 * std[1:].min()
    # the sooner it comes back, the more of that may be its swing
    assert read(vehicle, spin, [60.0] * 4, raced, -0.3)[1][0] > 1.4 * std[0]
    # under drive it may spin as fast
    assert read(vehicle, spin, [30.0] * 4, raced, 0.3)[1][0] > 20 * std[0]


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_wheel_that_slips_evenly_is_mistrusted_once_another_has_reached_the_speed(
    vehicle: Vehicle, way: float
) -> None:
    """On ice anti-lock brakes may hold it in its slip for seconds, as near to the speed as that is known."""
    even = 10 + 0.9 * way
    swings = 10 + 1.5 * way
    sample = {"bears": 0.04 * way, "spread": 0.3}
    gains = [0.0, 0.0, 0.0, 0.0]
    reached, _ = read(vehicle, [even, even, 10, 10], gains, **sample)
    state, std = read(vehicle, [even, even, swings, swings], gains, reached, **sample)
    assert (std[:2] > 3).all()
    # it is let go of, as it is not known how the car has slowed down since
    for _ in range(400):
        state, std = read(vehicle, [even, even, swings, swings], gains, state, **sample)
    assert (std[:2] < 1).all()
    # nothing makes wheels slip evenly that bear nothing
    _, std = read(vehicle, [even, even, swings, swings], gains, reached, spread=0.3)
    assert (std[:2] < 1).all()
