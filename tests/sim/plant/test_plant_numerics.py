"""The integration: order, symmetry, repeatability, batches, precision."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.sim.plant.conftest import Plane, drive, samples

from roadstate.sim.plant import Controls, multibody_plant
from roadstate.sim.plant.multibody import MultibodyPlant, State
from roadstate.sim.plant.rollout import start
from roadstate.vehicles import load_vehicle


@eqx.filter_jit
def many(
    plant: MultibodyPlant, road: Plane, state: State, controls: Controls, dt: float, count: int
) -> State:
    """``count`` steps of ``dt``; both are traced, so that every length runs the same program."""
    return jax.lax.fori_loop(0, count, lambda _, now: plant.inner(road, now, controls, dt), state)


def test_order_of_convergence() -> None:
    """Errors fall with the square of the step."""
    plant, road = multibody_plant(load_vehicle("in-wheel-ev")), Plane(0.03, 0.01)
    controls = Controls.make(steering_wheel=0.4, wheel_torque=np.full(4, 80.0))
    # half a second in, when what a held steering wheel's jump set off is smooth at any step
    state = many(plant, road, start(plant, road, 20.0), controls, jnp.asarray(2e-4), jnp.asarray(2500))

    def after(dt: float) -> np.ndarray:
        end = many(plant, road, state, controls, jnp.asarray(dt), jnp.asarray(round(0.4 / dt)))
        m = end.motion
        return np.concatenate([m.position, m.attitude, 0.05 * m.velocity, m.rate, m.travel, 0.01 * m.spin])

    fine = after(5e-5)
    errors = [np.abs(after(dt) - fine).max() for dt in (4e-3, 2e-3, 1e-3)]
    assert errors[2] < 2e-5
    assert errors[0] / errors[1] > 3.0
    assert errors[1] / errors[2] > 3.0


def test_mirror_symmetry(car: MultibodyPlant) -> None:
    """The same drive to the other side is the mirror image."""
    road, t = Plane(), samples(4.0)
    wheel = 1.2 * np.sin(3 * t)

    def run(sign: float) -> dict[str, np.ndarray]:
        controls = Controls.make(steering_wheel=sign * wheel, throttle=0.5, brake=np.where(t > 3, 0.8, 0))
        return drive(car, road, start(car, road, 15.0), controls)[1]._asdict()

    left, right = run(1.0), run(-1.0)
    swap = [1, 0, 3, 2]
    assert np.abs(left["velocity"][:, 1]).max() > 0.2
    for name in ("load", "force_x", "wheel_speed", "slip", "travel", "brake_torque"):
        np.testing.assert_allclose(right[name][:, swap], left[name], rtol=1e-6, atol=1e-6, err_msg=name)
    for name in ("force_y", "slip_angle", "camber", "steer"):
        np.testing.assert_allclose(-right[name][:, swap], left[name], rtol=1e-6, atol=1e-6, err_msg=name)
    for name, signs in (("velocity", [1, -1, 1]), ("angular_rate", [-1, 1, -1]), ("attitude", [-1, 1, -1])):
        np.testing.assert_allclose(right[name] * signs, left[name], atol=1e-8, err_msg=name)


def test_same_input_same_output_bit_for_bit(car: MultibodyPlant) -> None:
    road, t = Plane(), samples(2.0)
    controls = Controls.make(steering_wheel=np.sin(t), throttle=0.4)
    first, second = (drive(car, road, start(car, road, 18.0), controls)[1] for _ in range(2))
    for name, values in first._asdict().items():
        np.testing.assert_array_equal(values, getattr(second, name), err_msg=name)


def test_a_batch_of_frictions_is_what_each_is_alone(car: MultibodyPlant) -> None:
    frictions = jnp.asarray([0.3, 0.6, 0.9])
    roads = Plane(jnp.zeros(3), jnp.zeros(3), frictions, frictions, jnp.zeros(3))
    controls = Controls.make(steering_wheel=1.5, throttle=0.3)

    def run(plant: MultibodyPlant, road: Plane) -> State:
        state = plant.init(road, 16.0)
        return jax.lax.fori_loop(0, 800, lambda _, now: plant.inner(road, now, controls, 0.001), state)

    batch = eqx.filter_jit(eqx.filter_vmap(run, in_axes=(None, 0)))(car, roads)
    alone = eqx.filter_jit(run)
    for i in range(3):
        one = alone(car, jax.tree.map(lambda a, i=i: a[i], roads))
        for ours, theirs in zip(jax.tree.leaves(batch), jax.tree.leaves(one), strict=True):
            np.testing.assert_allclose(ours[i], theirs, rtol=1e-6, atol=1e-7)
    assert np.ptp(batch.motion.velocity[:, 1]) > 0.05


def test_a_batch_of_cars(car: MultibodyPlant) -> None:
    """Every parameter is a leaf: two cars of different mass run at once."""
    heavy = eqx.tree_at(lambda p: p.chassis.masses, car, car.chassis.masses * jnp.asarray([1.3, 1, 1, 1, 1]))
    both = jax.tree.map(lambda a, b: jnp.stack([a, b]), *(eqx.filter(p, eqx.is_array) for p in (car, heavy)))
    truth = eqx.filter_jit(
        eqx.filter_vmap(lambda p: p.truth(Plane(), p.init(Plane(), 0.0), Controls.make(brake=1.0)))
    )(eqx.combine(both, car))
    weight = np.asarray(truth.load).sum(axis=1)
    assert weight[1] / weight[0] == pytest.approx(float(heavy.chassis.mass / car.chassis.mass), rel=1e-6)


def test_float32_in_float32_out(car: MultibodyPlant) -> None:
    single = jax.tree.map(lambda a: a.astype(jnp.float32) if eqx.is_inexact_array(a) else a, (car, Plane()))
    plant, road = single
    state = start(car, Plane(), 20.0)
    state = jax.tree.map(lambda a: a.astype(jnp.float32), state)
    controls = jax.tree.map(lambda a: a.astype(jnp.float32), Controls.make(steering_wheel=0.5))
    end = many(plant, road, state, controls, jnp.asarray(1e-3, jnp.float32), jnp.asarray(500))
    assert {leaf.dtype for leaf in jax.tree.leaves(end)} == {jnp.dtype(jnp.float32)}
    double = many(
        car,
        Plane(),
        start(car, Plane(), 20.0),
        Controls.make(steering_wheel=0.5),
        jnp.asarray(1e-3),
        jnp.asarray(500),
    )
    np.testing.assert_allclose(end.motion.velocity, double.motion.velocity, rtol=2e-3, atol=2e-3)


def test_dt_must_be_a_multiple_of_the_inner_step(car: MultibodyPlant) -> None:
    state = eqx.filter_eval_shape(car.init, Plane(), 10.0)
    with pytest.raises(ValueError, match="no multiple"):
        car.step(Plane(), state, Controls.make(), 0.0015)


@pytest.mark.parametrize(("name", "friction"), [("truck", 0.9), ("compact-car", 0.1)])
def test_violent_driving_stays_finite_and_within_friction(name: str, friction: float) -> None:
    """Pedals, wheel and gears thrown about; the truck lifts wheels, no force exceeds what the road has.

    The tires' peaks are friction times load at the nominal load; at small loads they have a little more.
    """
    random = np.random.default_rng(1)
    plant, road, t = multibody_plant(load_vehicle(name)), Plane(0.0, 0.0, friction, friction), samples(16.0)

    def thrown(low: float, high: float) -> np.ndarray:
        return np.repeat(random.uniform(low, high, 16), 100)

    controls = Controls.make(
        steering_wheel=thrown(-4, 4),
        throttle=thrown(0, 1),
        brake=np.where(thrown(0, 1) > 0.7, thrown(0, 1), 0.0),
        gear=np.where(thrown(0, 1) > 0.85, -1.0, 100.0),
    )
    assert len(t) == 1600
    _, truth = drive(plant, road, start(plant, road, 28.0), controls)
    for field, values in truth._asdict().items():
        assert np.isfinite(values).all(), field
    used = np.hypot(truth.force_x, truth.force_y)[truth.load > 200] / truth.load[truth.load > 200]
    peaks = np.maximum(*(np.asarray(p) for p in plant.tires.model.peak_friction(truth.load, friction)))
    assert 0.7 * friction < used.max() <= 1.001 * peaks[truth.load > 200].max()
    assert truth.load.min() >= 0
    if name == "truck":
        assert truth.load.min() == 0
