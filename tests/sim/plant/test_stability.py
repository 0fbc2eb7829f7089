"""Stability control: which wheel it brakes, and that it keeps a car from spinning."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.plant import multibody_plant
from roadstate.sim.plant.stability import StabilityControl
from roadstate.sim.run import drive
from roadstate.vehicles import load_vehicle

CONTROL = StabilityControl(ratio=jnp.asarray(15.0), wheelbase=jnp.asarray(2.7), understeer=jnp.asarray(0.003))
SPEED, STEERED = 20.0, 0.5


def steady() -> float:
    """Yaw rate of a steady turn."""
    return SPEED * STEERED / 15.0 / (2.7 + 0.003 * SPEED**2)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("more", "wheel"), [(0.1, 1), (-0.1, 2)])
def test_the_wheel_that_turns_it_back_is_braked(side: float, more: float, wheel: int) -> None:
    """To the left the right front wheel of a car that turns in too far, or the left rear one."""
    turns = side * (steady() + more)
    asked = np.asarray(CONTROL.pressure(SPEED, turns, turns * SPEED, side * STEERED))
    wheel = wheel if side > 0 else wheel ^ 1
    assert asked[wheel] > 1e6
    assert np.count_nonzero(asked) == 1


@pytest.mark.parametrize("speed", [4.9, -20.0])
def test_it_leaves_alone_who_crawls_or_backs_up(speed: float) -> None:
    assert not np.asarray(CONTROL.pressure(speed, 0.5, 0.0, 0.0)).any()


def test_it_leaves_alone_who_turns_as_steered() -> None:
    assert not np.asarray(CONTROL.pressure(SPEED, steady(), steady() * SPEED, STEERED)).any()


def test_it_knows_what_a_road_holds() -> None:
    """On ice the driver steers for more than there is: a car that turns by that is not made to turn in."""
    turns = 3.0 / SPEED
    assert not np.asarray(CONTROL.pressure(SPEED, turns, 1.0, 3.0)).any()


def test_it_keeps_a_car_from_spinning() -> None:
    """Sine with dwell at 80 km/h on half of a dry road's friction."""
    vehicle, sideslip = load_vehicle("family-car"), []
    script = manoeuvre("sine-with-dwell").prepare(vehicle, friction=0.5)
    for on in (False, True):
        plant = multibody_plant(vehicle, anti_lock=True, stability_control=on)
        velocity = np.asarray(drive(plant, script, vehicle, rate=100.0).truth.planar_velocity)
        sideslip.append(np.degrees(np.abs(np.arctan2(velocity[:, 1], velocity[:, 0])).max()))
    assert sideslip[0] > 40
    assert sideslip[1] < 15
