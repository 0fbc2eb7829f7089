"""Loads of a car that leans, against moments and the plant's truth."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.estimators.force_balance import ForceBalance
from roadstate.sim.manoeuvres import KMH, manoeuvre
from roadstate.sim.plant import multibody_plant
from roadstate.sim.run import drive, truth_table
from roadstate.vehicles import Vehicle, load_vehicle


def moment(vehicle: Vehicle, load: np.ndarray) -> np.ndarray:
    """(…, 2) what loads (…, 4) roll each axle by, to the right, N·m."""
    tracks = np.array([vehicle.geometry.track_front, vehicle.geometry.track_rear])
    return 0.5 * tracks * (load[..., 1::2] - load[..., 0::2])


@pytest.mark.parametrize("lean", [0.0, 0.01])
def test_a_body_that_rolls_outward_shifts_more(vehicle: Vehicle, lean: float) -> None:
    """m a h of forces, and m g times how far the centre of gravity has moved aside."""
    car = vehicle.model_copy(update={"body": vehicle.body.model_copy(update={"roll_gradient": lean})})
    load = np.asarray(ForceBalance(car).loads(jnp.asarray(0.0), jnp.asarray(5.0)))
    height = vehicle.geometry.cg_height
    aside = lean * 5.0 * 0.85 * height
    assert load.sum() == pytest.approx(vehicle.mass * GRAVITY)
    assert moment(vehicle, load).sum() == pytest.approx(vehicle.mass * (5.0 * height + GRAVITY * aside))


@pytest.mark.parametrize("name", ["suv", "in-wheel-ev"])
def test_loads_in_a_bend_are_those_of_a_car_on_springs(name: str) -> None:
    """Both axles' moments within 5 %, in a bend up to the limit; of a rigid body whose
    axles share by weight the front axle's was 10 to 13 % too small."""
    vehicle = load_vehicle(name)
    bend = manoeuvre("constant-radius").prepare(vehicle, speed=60 * KMH, friction=0.8)
    truth = truth_table(drive(multibody_plant(vehicle), bend, vehicle))
    balance = ForceBalance(vehicle)
    # the body's own axes have leant, and a part of gravity with them
    across = truth["accel_y"] / (1 + GRAVITY * vehicle.body.roll_gradient)
    felt = jax.vmap(balance.loads)(jnp.asarray(truth["accel_x"]), jnp.asarray(across))
    turns = np.abs(truth["accel_y"]) > 2.0
    assert turns.sum() > 500
    ours, plants = (
        moment(vehicle, load[turns])
        for load in (np.asarray(felt), np.stack([truth[f"ref_load_{w}"] for w in WHEELS], axis=1))
    )
    assert np.sum(ours, axis=0) == pytest.approx(np.sum(plants, axis=0), rel=0.05)
