"""A body that leans as the car accelerates and turns."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from roadstate.core import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.estimators.load_transfer import Lean, LoadShift
from roadstate.sim.manoeuvres import KMH, manoeuvre
from roadstate.sim.plant import multibody_plant
from roadstate.sim.run import drive, truth_table
from roadstate.vehicles import SevenDofForces, Vehicle, load_vehicle


def followed(accel: np.ndarray, dt: float) -> np.ndarray:
    """What has come over of accelerations that are held for ``dt`` each, at the end of each."""
    lean, out = Lean.upright(), []
    for a in accel:
        lean = lean.after(jnp.asarray(a), jnp.asarray(dt))
        out.append(float(lean.transferred()))
    return np.array(out)


def test_it_is_a_body_on_springs_and_dampers() -> None:
    """Against the equation of motion ψ̈ = ω²(a − ψ) − 2ζω ψ̇ itself."""
    natural, damping, dt = 2 * np.pi * 1.5, 0.35, 0.05
    accel = np.random.default_rng(0).normal(0.0, 4.0, 40)
    x, expected = np.zeros(2), []
    for a in accel:

        def slope(_: float, x: np.ndarray, a: float = a) -> list[float]:
            return [x[1], natural**2 * (a - x[0]) - 2 * damping * natural * x[1]]

        x = solve_ivp(slope, (0.0, dt), x, rtol=1e-9, atol=1e-9).y[:, -1]
        expected.append(x[0] + 2 * damping / natural * x[1])
    np.testing.assert_allclose(followed(accel, dt), expected, atol=1e-6)


def test_a_lasting_acceleration_shifts_the_load_of_a_rigid_body() -> None:
    assert followed(np.full(300, -6.0), 0.01)[-1] == pytest.approx(-6.0, rel=1e-3)
    # however long the step, and after any gap
    assert followed(np.array([3.0, -6.0]), 60.0)[-1] == pytest.approx(-6.0)


def test_at_first_hardly_anything_presses_the_wheels() -> None:
    """Brakes that bite within a thousandth of a second find no more load on the front wheels, but soon do."""
    assert 0 < followed(np.array([-8.0]), 0.001)[-1] / -8.0 < 0.01
    assert np.max(followed(np.full(100, -8.0), 0.01) / -8.0) > 1.1


def test_a_low_pass_is_undone_to_the_digit() -> None:
    """The lean under a low-passed acceleration, taken ahead, is that under the acceleration itself."""
    dt, lag = 1e-4, 0.05
    accel = np.repeat(np.random.default_rng(1).normal(0.0, 3.0, 8), 2500)
    slow, late, exact = 0.0, Lean.upright(), Lean.upright()
    step = jax.jit(Lean.after)
    for a in accel:
        slow += -np.expm1(-dt / lag) * (a - slow)
        late, exact = step(late, slow, dt), step(exact, a, dt)
    assert float(late.ahead(lag).accel) == pytest.approx(float(exact.accel), abs=2e-3)
    assert abs(float(late.accel) - float(exact.accel)) > 0.1


def test_an_accelerometer_is_freed_of_the_pitch_there_is() -> None:
    """It reads the specific force, and gravity by as much as the body has pitched."""
    gradient, force, lean = 0.0045, -6.0, Lean.upright()._replace(accel=jnp.asarray(-4.0))
    share = jnp.asarray(GRAVITY * gradient)
    reading = force + GRAVITY * gradient * -4.0
    assert float(lean.freed(jnp.asarray(reading) / (1 + share), share)) == pytest.approx(force)


def moment(vehicle: Vehicle, load: np.ndarray) -> np.ndarray:
    """(…, 2) what loads (…, 4) roll each axle by, to the right, N·m."""
    tracks = np.array([vehicle.geometry.track_front, vehicle.geometry.track_rear])
    return 0.5 * tracks * (load[..., 1::2] - load[..., 0::2])


@pytest.mark.parametrize("lean", [0.0, 0.01])
def test_a_body_that_rolls_outward_shifts_more(vehicle: Vehicle, lean: float) -> None:
    """m a h of forces, and m g times how far the centre of gravity has moved aside."""
    car = vehicle.model_copy(update={"body": vehicle.body.model_copy(update={"roll_gradient": lean})})
    shift = LoadShift.of(car, SevenDofForces.from_vehicle(car))
    load = np.asarray(shift.loads(jnp.asarray(0.0), jnp.asarray(5.0)))
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
    shift = LoadShift.of(vehicle, SevenDofForces.from_vehicle(vehicle))
    # the body's own axes have leant, and a part of gravity with them
    across = truth["accel_y"] / (1 + GRAVITY * vehicle.body.roll_gradient)
    felt = jax.vmap(shift.loads)(jnp.asarray(truth["accel_x"]), jnp.asarray(across))
    turns = np.abs(truth["accel_y"]) > 2.0
    assert turns.sum() > 500
    ours, plants = (
        moment(vehicle, load[turns])
        for load in (np.asarray(felt), np.stack([truth[f"ref_load_{w}"] for w in WHEELS], axis=1))
    )
    assert np.sum(ours, axis=0) == pytest.approx(np.sum(plants, axis=0), rel=0.05)
