"""The two-stage estimator on a car that is exactly its own model, and its parts against closed forms."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, InputError, Log, Validity, reference
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.estimators.contact import Contact
from roadstate.estimators.force_filter import ForceInput, ForceModel
from roadstate.estimators.friction import normalized_tire
from roadstate.filters import KF, ExtendedHInfinity
from roadstate.run import scan
from roadstate.tires import Dugoff
from roadstate.vehicles import ThreeDof, Vehicle, load_vehicle
from roadstate.vehicles.kinematics import wheel_steer, wheel_velocities

Array = NDArray[np.float64]
FRICTION = 0.6
NOISE = {
    "accel_x": 0.05,
    "accel_y": 0.05,
    "yaw_accel": 0.02,
    "yaw_rate": 0.01,
    "speed": 0.01,
    "velocity_y": 0.01,
    "steer": 5e-4,
}


@pytest.fixture(scope="module")
def truck() -> Vehicle:
    """Whose file says how noisy its sensors are here."""
    truck = load_vehicle("truck")
    noises = {
        "accel": {"noise_density": 0.005, "bias": 0.0},
        "yaw_rate": {"noise": NOISE["yaw_rate"], "bias": 0.0},
        "yaw_accel": {"noise": NOISE["yaw_accel"]},
        "speed": {"noise": NOISE["speed"]},
        "velocity_y": {"noise": NOISE["velocity_y"]},
        "wheel_speed": {"noise": 0.01, "scale": 0.0},
    }
    sensors = {name: getattr(truck.sensors, name).model_copy(update=new) for name, new in noises.items()}
    return truck.model_copy(update={"sensors": truck.sensors.model_copy(update=sensors)})


def drive(
    truck: Vehicle,
    *,
    rate: float = 100.0,
    seconds: float = 12.0,
    steers: bool = True,
    brakes: float = 0.0,
    tire: str = "normalized_dugoff",
    friction: float = FRICTION,
) -> Log:
    """The planar model under rear slip and a weaving steer, by Runge and Kutta, without any noise.

    ``brakes`` is the slip of all wheels instead, every other 0.75 s, from 20 m/s.
    """
    car = ThreeDof.from_vehicle(
        truck,
        normalized_tire(truck, tire),
        friction=friction,
        rolling_resistance=0.0,
        rolling_resistance_speed=0.0,
    )
    count, inner = round(seconds * rate), round(1000 / rate)
    h = 1 / (rate * inner)

    def inputs(t: Any) -> Any:
        steer = (0.06 * jnp.sin(2.0 * t) if steers else 0.0) * jnp.clip(t - 1, 0, 1)
        rear = 0.012 + 0.004 * jnp.sin(1.3 * t)
        if brakes:
            front = rear = -brakes * jnp.clip((t % 1.5 - 0.75) / 0.1, 0, 1)
            return jnp.stack([steer, front, front, front, rear, rear])
        return jnp.stack([steer, 0.0 * t, 0.0 * t, 0.0 * t, rear, rear])

    def step(x: Any, k: Any) -> tuple[Any, Any]:
        def substep(x: Any, j: Any) -> tuple[Any, None]:
            t = (k * inner + j) * h
            a = car.derivative(x, inputs(t))
            b = car.derivative(x + 0.5 * h * a, inputs(t + 0.5 * h))
            c = car.derivative(x + 0.5 * h * b, inputs(t + 0.5 * h))
            d = car.derivative(x + h * c, inputs(t + h))
            return x + h / 6 * (a + 2 * b + 2 * c + d), None

        u = inputs(k * inner * h)
        motion = car.motion(x, u)
        at = wheel_velocities(x[0], x[1], x[2], car.wheel_positions, wheel_steer(u[0]))
        row = {"speed": x[0], "velocity_y": x[1], "yaw_rate": x[2], "steer": u[0]}
        row |= {"accel_x": motion.accel_x, "accel_y": motion.accel_y, "yaw_accel": motion.yaw_accel}
        for i, w in enumerate(WHEELS):
            row[f"wheel_speed_{w}"] = at.x[i] * (1 + u[2 + i]) / truck.wheels.radius
            row |= {f"ref_force_x_{w}": motion.F_x[i], f"ref_force_y_{w}": motion.F_y[i]}
            row[f"ref_friction_{w}"] = jnp.asarray(friction)
        return jax.lax.scan(substep, x, jnp.arange(inner))[0], row

    start = jnp.asarray([20.0 if brakes else 12.0, 0.0, 0.0])
    rows = jax.jit(lambda: jax.lax.scan(step, start, jnp.arange(count))[1])()
    return Log(np.arange(count) / rate, {name: np.asarray(v, float) for name, v in rows.items()})


@pytest.fixture(scope="module")
def exact(truck: Vehicle) -> Log:
    return drive(truck)


def estimates_of(truck: Vehicle, log: Log, **options: Any) -> Any:
    return scan(
        build("two-stage", truck, log.available, **{"direct": True, "relaxes": False, **options}), log
    )


def noisy(log: Log, louder: float = 1.0, seed: int = 0) -> Log:
    random = np.random.default_rng(seed)
    added = {n: log[n] + louder * std * random.standard_normal(len(log)) for n, std in NOISE.items()}
    return log.with_channels(added)


def truth(quantity: str, log: Log) -> Array:
    found = reference(quantity, log.channels)
    assert found is not None
    return found


FORCES = [f"force_{a}_{p}" for a in "xy" for p in (*WHEELS, "front", "rear")]


@pytest.mark.parametrize("quantity", FORCES)
def test_without_the_first_stage_forces_are_the_tire_models(
    truck: Vehicle, exact: Log, quantity: str
) -> None:
    e = estimates_of(truck, exact, smooths=False, known_friction=FRICTION)
    np.testing.assert_allclose(e.values[quantity], truth(quantity, exact), rtol=1e-9, atol=1e-6)


def test_exact_sensors_give_exact_forces_and_friction(truck: Vehicle, exact: Log) -> None:
    e = estimates_of(truck, exact)
    late = exact.time > 4
    for place in ("", "_front", "_rear"):
        assert np.abs(e.values[f"friction_peak{place}"][late] / FRICTION - 1).max() < 0.005
    for quantity in FORCES:
        true = truth(quantity, exact)
        size = np.abs(truth(quantity.replace("_x_", "_y_"), exact)).max()
        assert np.abs(e.values[quantity] - true)[late].max() < 0.02 * size, quantity


def test_noise_is_smoothed_and_does_not_draw_friction_to_zero(truck: Vehicle, exact: Log) -> None:
    log, late = noisy(exact), exact.time > 4
    ours, rival = estimates_of(truck, log), estimates_of(truck, log, smooths=False, known_friction=FRICTION)
    for place in ("front", "rear"):
        error = ours.values[f"friction_peak_{place}"][late] / FRICTION - 1
        assert np.abs(error).mean() < 0.02
        for axis in "xy":
            true = truth(f"force_{axis}_{place}", log)[late]
            rmse, by_model = (
                np.sqrt(np.mean((e.values[f"force_{axis}_{place}"][late] - true) ** 2)) for e in (ours, rival)
            )
            assert rmse < 0.8 * by_model, (axis, place)


def test_the_stated_errors_are_honest(truck: Vehicle, exact: Log) -> None:
    log, late = noisy(exact, seed=1), exact.time > 4
    e = estimates_of(truck, log)
    for quantity in ("friction_peak_front", "friction_peak_rear", *FORCES):
        error = np.abs(e.values[quantity] - truth(quantity, log))[late]
        assert (error < 1.96 * e.std[quantity][late]).mean() > 0.9, quantity


@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_a_real_tires_stiffness_is_not_taken_for_friction(truck: Vehicle, friction: float) -> None:
    """Below its limit its force is that of a stiffness which the road does not change: the error says so."""
    log = noisy(drive(truck, tire="brush", friction=friction))
    e, late = estimates_of(truck, log), log.time > 4
    for place in ("front", "rear"):
        error = e.values[f"friction_peak_{place}"][late] - friction
        assert np.abs(error).mean() > 0.1 * friction  # which is why
        assert (np.abs(error) < 1.96 * e.std[f"friction_peak_{place}"][late]).mean() > 0.9
    assert set(e.validity[late]) == {int(Validity.LOW_EXCITATION)}


def test_steering_without_an_offset_tells_more(truck: Vehicle, exact: Log) -> None:
    log, late = noisy(exact), exact.time > 4
    white = (NOISE["steer"], NOISE["steer"])
    usual, better = (estimates_of(truck, log, **o) for o in ({}, {"steer_std": white}))
    for e in (usual, better):
        assert np.abs(e.values["friction_peak_front"][late] / FRICTION - 1).mean() < 0.03
    assert better.std["force_y_front"][late].mean() < usual.std["force_y_front"][late].mean()


def test_as_printed_is_eight_scalar_filters(truck: Vehicle, exact: Log) -> None:
    """Simon's recursion, written out: 1/P⁺ = 1/P⁻ − θ + 1/R, x⁺ = x⁻ + P⁺/R (z − x⁻)."""
    log, gamma = noisy(exact), 10.0
    options = {"as_printed": True, "known_friction": 1.0}
    direct = estimates_of(truck, log, smooths=False, **options)
    ours = estimates_of(truck, log, gamma=gamma, **options)
    for axis, R in (("x", 10.0), ("y", 1.0)):
        for wheel in WHEELS:
            x, P = 0.0, 1.0  # the start is forgotten in 2 s
            for k, z in enumerate(direct.values[f"force_{axis}_{wheel}"]):
                P += 0.01 if k else 0.0
                P = 1 / (1 / P - 1 / gamma**2 + 1 / R)
                x += P / R * (z - x)
                if k > 1000:
                    assert ours.values[f"force_{axis}_{wheel}"][k] == pytest.approx(x, rel=1e-6, abs=1e-3)


def test_without_theta_it_is_a_kalman_filter() -> None:
    model = ForceModel(("force", "force_rate"), ("force",), jnp.asarray(0.5), jnp.asarray([1e3, 1e3]))
    weight = jnp.asarray([1.0, 0.0])
    infinity, kalman = ExtendedHInfinity(theta=0.0, weight=weight), KF()
    u, dt = ForceInput(*(jnp.asarray(v) for v in (100.0, 3e3, 5.0, 40.0))), jnp.asarray(0.01)

    @jax.jit
    def both(a: Any, b: Any, z: Any) -> tuple[Any, Any]:
        return infinity.step(model, a, u, z, dt)[0], kalman.step(model, b, u, z, dt)[0]

    a, b = infinity.init(model), kalman.init(model)
    for k in range(50):
        a, b = both(a, b, np.array([1e3 * np.sin(k / 10)]))
    np.testing.assert_allclose(a.kalman.gaussian.mean, b.gaussian.mean, rtol=1e-9)
    np.testing.assert_allclose(a.kalman.gaussian.cov, b.gaussian.cov, rtol=1e-9)


@pytest.mark.parametrize("louder", [1.0, 3.0])
def test_learns_how_noisy_the_sensors_are(truck: Vehicle, exact: Log, louder: float) -> None:
    """With three times the noise the variance of what a sample says is nine times as large."""
    log = noisy(exact, louder)
    estimator = build("two-stage", truck, log.available, direct=True, relaxes=False)
    samples = {c: jnp.asarray(log[c]) for c in estimator.channels}
    dt = jnp.asarray(np.diff(log.time, prepend=0.0))

    @eqx.filter_jit
    def last(estimator: Any) -> Any:
        def body(state: Any, row: Any) -> tuple[Any, None]:
            return estimator.step(state, *row)[0], None

        return jax.lax.scan(body, estimator.init(), (samples, dt))[0]

    along, across, _ = np.asarray(estimator.filter.noise_scale(last(estimator).friction))
    assert 0.6 * louder**2 < along < 1.5 * louder**2
    assert 0.6 * louder**2 < across < 1.5 * louder**2


def test_says_so_of_an_axle_on_which_nothing_acts(truck: Vehicle) -> None:
    """Straight on, under rear drive: of the front axle it knows what both have in common, and no more."""
    log = noisy(drive(truck, steers=False))
    e = estimates_of(truck, log)
    front, rear = (e.std[f"friction_peak_{p}"][-1] for p in ("front", "rear"))
    assert front > 0.1  # of each axle's own part, the prior
    assert rear < 0.95 * front  # as far as a tire's stiffness tells its friction, which is little
    for bound, sign in (("lower", -1), ("upper", 1)):
        away = sign * (e.values[f"friction_peak_front_{bound}"] - e.values["friction_peak_front"])[-1]
        assert away == pytest.approx(1.6449 * front)


@pytest.mark.parametrize("friction", [0.2, 0.5, 0.8])
def test_near_the_limit_it_is_certain_and_right(truck: Vehicle, friction: float) -> None:
    """Brakes at a slip that asks for more than there is; the same at a fifth of it is no proof."""
    log = noisy(drive(truck, seconds=1.8 / friction, steers=False, brakes=0.3, friction=friction))
    assert np.abs(log["accel_x"]).max() / GRAVITY > 0.95 * friction
    e = estimates_of(truck, log)
    certain = e.validity == int(Validity.EXCITED)
    assert certain.mean() > 0.03
    error = np.abs(e.values["friction_peak"] - friction)[certain]
    assert error.mean() < 0.08 * friction
    assert (error < 1.6449 * e.std["friction_peak"][certain]).mean() > 0.9
    gentle = drive(truck, seconds=1.8 / friction, steers=False, brakes=0.02, friction=friction)
    assert not (estimates_of(truck, noisy(gentle)).validity == int(Validity.EXCITED)).any()


@pytest.mark.parametrize("offset", [0.004, -0.004])
def test_errors_of_forces_do_not_draw_friction_to_zero_through_the_yaw_rate(
    truck: Vehicle, offset: float
) -> None:
    """Straight on, a steering offset feigns a force at the front that turns nothing: that is no friction."""
    log = noisy(drive(truck, steers=False))
    log = log.with_channels({"steer": log["steer"] + offset})
    e = estimates_of(truck, log.select([c for c in log.channels if c != "yaw_accel"]))
    late = log.time > 4
    for place in ("front", "rear"):
        error = np.abs(e.values[f"friction_peak_{place}"][late] - FRICTION)
        assert error.mean() < 0.3 * FRICTION, place
        assert (error < 1.6449 * e.std[f"friction_peak_{place}"][late]).mean() > 0.95, place


def test_lateral_forces_come_after_the_relaxation_length(truck: Vehicle, exact: Log) -> None:
    """At a constant slip angle 1 − e⁻ˢ of the force is there after s lengths; without one, all of it."""
    for relaxes in (True, False):
        forces = build(
            "two-stage", truck, exact.available, direct=True, smooths=False, relaxes=relaxes
        ).forces
        still = Contact(
            velocity=jnp.asarray([10.0, 0.0, 0.0]),
            steer=jnp.asarray(0.02),
            wheel_speed=jnp.full(4, 10.0 / truck.wheels.radius),
            accel=jnp.zeros(2),
            std=jnp.full(7, 0.01),
            age=jnp.zeros(()),
        )
        state, dt, step = forces.init(), jnp.asarray(0.006), eqx.filter_jit(forces.step)
        for _ in range(10):  # 0.6 m
            _, state, *_ = step(state, still, None, jnp.full(4, FRICTION), dt)
        steady = eqx.filter_jit(forces.direct)(still, jnp.full(4, FRICTION)).force
        built = 1 - np.exp(-0.6 / truck.tires.relaxation_length) if relaxes else 1.0
        np.testing.assert_allclose(forces.forces(state)[4:6], built * steady[4:6], rtol=1e-6)
        assert abs(steady[4]) > 1e3


def test_the_rate_of_the_log_does_not_matter(truck: Vehicle, exact: Log) -> None:
    fast = estimates_of(truck, drive(truck, rate=200.0))
    usual = estimates_of(truck, exact)
    for quantity in ("friction_peak_front", "friction_peak_rear", "force_y_front", "force_x_rear"):
        scale = np.abs(usual.values[quantity]).max()
        away = np.abs(fast.values[quantity][::2] - usual.values[quantity])[exact.time > 2]
        assert away.max() < 0.02 * scale, quantity


def test_below_its_limit_a_textbook_tire_tells_nothing_of_friction(truck: Vehicle, exact: Log) -> None:
    """Dugoff's force does not depend on friction there, so that the prior is all there is."""
    soft = Dugoff(slip_stiffness=3e4, cornering_stiffness=3e4)
    e = estimates_of(truck, exact, tire=soft, shared_walk=0.0, own_walk=0.0)
    assert e.std["friction_peak"][-1] > 0.9 * e.std["friction_peak"][0]


@pytest.mark.parametrize(
    ("grouping", "places"),
    [("one", ()), ("front_rear", ("front", "rear")), ("left_right", ("left", "right")), ("four", WHEELS)],
)
def test_every_grouping_finds_the_friction_of_the_car(
    truck: Vehicle, exact: Log, grouping: str, places: tuple[str, ...]
) -> None:
    e = estimates_of(truck, exact, grouping=grouping)
    assert {f"friction_peak_{p}" for p in places} <= set(e.values)
    assert e.values["friction_peak"][-1] == pytest.approx(FRICTION, rel=0.02)


def test_an_unknown_setting_is_refused(truck: Vehicle, exact: Log) -> None:
    with pytest.raises(InputError, match=r"no setting is called 'gama'.*gamma"):
        build("two-stage", truck, exact.available, gama=1.0)
