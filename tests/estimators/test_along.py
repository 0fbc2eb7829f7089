"""Motion along the road: what its wheels tell of the speed while all of them slip."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from numpy.typing import NDArray
from tests.estimators.along_case import NOISE, given

from roadstate.core import Log
from roadstate.core.channels import WHEELS
from roadstate.core.gaussian import Gaussian
from roadstate.estimators import build
from roadstate.estimators.along import BIAS, SLOPE, SPEED, AlongInput, AlongModel
from roadstate.estimators.loading import Loading
from roadstate.estimators.slow_errors import LATE
from roadstate.filters import KF, FilterState
from roadstate.run import batch
from roadstate.vehicles import Vehicle, load_vehicle

DT = 0.01
FORCES = {"drive": 1.1, "brake": 0.3, "rolling": 9.8, "turned": 0.2}
CHANNELS = ("accel_x", *(f"wheel_speed_{w}" for w in WHEELS))


@pytest.fixture(scope="module")
def model() -> AlongModel:
    return AlongModel(load_vehicle("family-car"), CHANNELS, torque_of=None)


def test_a_wheel_tells_speed_slip_and_what_it_slips_beyond(model: AlongModel) -> None:
    x = np.zeros(len(model.states))
    x[SPEED], x[model.place("slip_factor")] = 20.0, 0.5
    told = model.h(jnp.asarray(x), given(20.0, -5.0, -0.03))
    np.testing.assert_allclose(told, 20.0 * (1 - 0.015))
    np.testing.assert_allclose(model.h(jnp.asarray(x), given(20.0, 0.0, 0.0)), 20.0)


def test_a_force_ahead_makes_a_wheel_turn_less_fast_backward(model: AlongModel) -> None:
    """R ω = v + |v| κ: brakes slow a car that backs up by a force ahead, and its wheels turn less."""
    x = np.zeros(len(model.states))
    x[SPEED], x[model.place("slip_factor")] = -5.0, 0.5
    np.testing.assert_allclose(model.h(jnp.asarray(x), given(-5.0, 2.0, 0.03)), -5.0 * (1 - 0.015))


def test_a_load_that_is_noticed_leaves_gains_as_they_were_at_the_stop() -> None:
    """Mean, variance, and covariance with a mass of which all else is new."""
    known = AlongModel(load_vehicle("family-car"), CHANNELS, torque_of="wheels")
    mean, variance, shared = gains = jnp.asarray([[0.02, -0.01], [4e-4, 9e-4], [-3e-4, 2e-4]])
    u, dt, places = given(30.0, 0.0, 0.0), jnp.asarray(0.01), known.place("mass") + np.arange(3)
    u = u._replace(loading=Loading.none(gains)._replace(std=jnp.asarray(0.15)))
    x = jnp.full(len(known.states), 0.1)
    np.testing.assert_allclose(known.f(x, u, dt)[places[1:]], mean)
    assert not jax.jacfwd(known.f)(x, u, dt)[places[1:]].any()
    factor = known.sqrt_Q(u, dt)[places]
    Q = np.asarray(factor @ factor.T)
    np.testing.assert_allclose(Q[0, 0], 0.15**2, rtol=1e-4)
    np.testing.assert_allclose(Q[0, 1:], shared, rtol=1e-6)
    np.testing.assert_allclose(np.diag(Q)[1:], variance, rtol=1e-6)


def test_a_heavier_car_is_moved_less_by_torques_and_by_air() -> None:
    """a = (F_drive − F_brake − F_air − (Θ − m) v̇)/m − f g: an accelerometer tells so much less.

    Wheels and engine are no harder to turn up.
    """
    known = AlongModel(load_vehicle("family-car"), CHANNELS, torque_of="wheels")
    x = np.zeros(len(known.states))
    x[known.place("mass")] = share = 1e-4
    u = given(30.0, 0.0, 0.0)._replace(**{k: jnp.asarray(v) for k, v in FORCES.items()})
    told = known.h(jnp.asarray(x), u)[known.sensors.index("traction")]
    force = FORCES["drive"] - FORCES["brake"] - FORCES["turned"] - float(known.air.drag) * 30.0**2
    assert float(told) == pytest.approx(force / (1 + share) - force, rel=1e-3)


@pytest.mark.parametrize("wind", [0.0, 4.0, -4.0, -40.0])
def test_a_headwind_and_a_larger_area_hold_the_car_back(wind: float) -> None:
    """½ρ c_d A (1 + ε)(v + w)|v + w|/m instead of ½ρ c_d A v²/m; a storm from behind pushes."""
    car = load_vehicle("family-car")
    known = AlongModel(car, CHANNELS, torque_of="wheels")
    x = jnp.zeros(len(known.states)).at[known.place("wind")].set(wind).at[known.place("drag_area")].set(0.1)
    told = known.h(x, given(30.0, 0.0, 0.0))[known.sensors.index("traction")]
    factor = 0.5 * car.aerodynamics.air_density * car.drag_area / car.mass
    more = factor * (1.1 * (30.0 + wind) * abs(30.0 + wind) - 30.0**2)
    assert float(told) == pytest.approx(-more)
    found, row = known.headwind(x, jnp.asarray(30.0))
    assert float(found) == pytest.approx(more)
    np.testing.assert_allclose(row, jax.jacfwd(lambda x: known.headwind(x, jnp.asarray(30.0))[0])(x))


def test_where_no_torque_tells_of_the_wind_it_is_what_it_may_be() -> None:
    known = AlongModel(load_vehicle("family-car"), CHANNELS, torque_of="wheels")
    prior, speed = known.prior(), jnp.asarray(-20.0)
    row = known.headwind(prior.mean, speed)[1]
    assert float(known.air.std(speed)) == pytest.approx(float(jnp.linalg.norm(row @ prior.factor)))


def test_a_car_that_turns_has_another_wind_ahead() -> None:
    car = load_vehicle("family-car")
    known = AlongModel(car, (*CHANNELS, "yaw_rate"), torque_of="wheels")
    place = known.place("wind")
    x, u, dt = jnp.zeros(len(known.states)).at[place].set(3.0), given(20.0, 0.0, 0.0), jnp.asarray(1.0)
    straight, turned = (known.f(x, u._replace(turning=jnp.asarray(r)), dt)[place] for r in (0.0, -0.5))
    assert float(straight) == pytest.approx(3.0, rel=0.01)
    assert float(turned) == pytest.approx(3.0 * np.exp(-0.25), rel=0.01)
    # and as much of it is not known any more
    std = np.linalg.norm(np.asarray(known.prior().factor)[place])
    noise = np.linalg.norm(np.asarray(known.sqrt_Q(u._replace(turning=jnp.asarray(-0.5)), dt))[place])
    assert noise == pytest.approx(std * np.sqrt(1 - np.exp(-0.5)), rel=0.01)
    # and where nobody knows whether it turns, it may have
    blind = AlongModel(car, CHANNELS, torque_of="wheels")
    assert 0.9 < float(blind.f(x, u, dt)[place]) / float(straight) < 0.99


def test_without_an_accelerometer_torques_push_the_car_as_heavy_as_it_is() -> None:
    """v̇ = F/(m (1 + ε_m)) − g sin θ of torques; the accelerometer's bias has no part in it."""
    known = AlongModel(load_vehicle("family-car"), CHANNELS, torque_of="wheels")
    x = np.zeros(len(known.states))
    share = 1e-4
    x[known.place("mass")], x[BIAS], x[SLOPE] = share, 0.3, 0.1
    u = given(30.0, 0.0, 0.0)._replace(**{k: jnp.asarray(v) for k, v in FORCES.items()})
    force = FORCES["drive"] - FORCES["brake"] - FORCES["turned"] - float(known.air.drag) * 30.0**2
    by_torque = u._replace(accel=jnp.asarray(force), by_torque=jnp.asarray(True))
    found = float(known.speeds_up(jnp.asarray(x), by_torque)) - force
    assert found == pytest.approx(force / (1 + share) - force - 0.1, abs=1e-3 * share * abs(force))
    felt = by_torque._replace(by_torque=jnp.asarray(False))
    assert float(known.speeds_up(jnp.asarray(x), felt)) == pytest.approx(force - 0.3 - 0.1)


def test_what_all_wheels_seem_to_slip_is_as_uncertain_as_radius_and_speed_together() -> None:
    """κ = R ω/v − 1: with δR/R and δv of covariance P its variance is r P rᵀ, r = (1, −1/v)."""
    known = AlongModel(load_vehicle("family-car"), (*CHANNELS, "speed"), torque_of=None)
    place = known.place("wheel_radius")
    P = np.eye(len(known.states))
    P[np.ix_([SPEED, place], [SPEED, place])] = [[0.04, 0.0015], [0.0015, 1e-4]]
    mean = jnp.zeros(len(P)).at[place].set(0.012)
    radius, std = known.rolling(Gaussian(mean, jnp.linalg.cholesky(jnp.asarray(P))), jnp.asarray(20.0))
    assert float(radius) == pytest.approx(0.012)
    assert float(std) == pytest.approx(np.sqrt(1e-4 + 0.04 / 400 - 2 * 0.0015 / 20))
    # where wheels alone tell the speed, their radius is the one it goes by
    blind = AlongModel(load_vehicle("family-car"), CHANNELS, torque_of=None)
    factor = jnp.eye(len(blind.states)).at[SPEED, SPEED].set(0.2)
    radius, std = blind.rolling(Gaussian(jnp.ones(len(factor)), factor), jnp.asarray(20.0))
    assert float(radius) == 0.0
    assert float(std) == pytest.approx(0.01)


class TestBraking:
    """A second and a half at 6 m/s²; every wheel slips 1.6 times what its force makes it."""

    BEYOND = 0.6
    SLIP = -0.035

    def braked(self, model: AlongModel, told: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Error of the speed and its 1σ at the end of 40 recordings; the filter is told the slip ``told``."""
        brakes = np.arange(450) >= 300
        speed = 25.0 + np.cumsum(np.where(brakes, -6.0, 0.0)) * DT
        wheels = speed * (1 + self.BEYOND * self.SLIP * brakes)
        z = wheels[:, None, None] + NOISE * np.random.default_rng(5).normal(size=(450, 40, 4))
        filt = KF()
        inputs = jax.vmap(given)(*map(jnp.asarray, (speed, -6.0 * brakes, told * brakes)))

        def step(states: FilterState, sample: tuple[AlongInput, Array]) -> tuple[FilterState, None]:
            u, z = sample
            return jax.vmap(lambda s, z: filt.step(model, s, u, z, jnp.asarray(DT))[0])(states, z), None

        start = jax.vmap(lambda _: filt.init(model))(jnp.arange(40))
        last = jax.jit(lambda: jax.lax.scan(step, start, (inputs, jnp.asarray(z)))[0])()
        std = np.linalg.norm(np.asarray(last.gaussian.factor)[:, SPEED], axis=-1)
        return np.asarray(last.gaussian.mean)[:, SPEED] - speed[-1], std

    def test_the_speed_is_known_as_well_as_it_says(self, model: AlongModel) -> None:
        errors, stds = self.braked(model, self.SLIP)
        assert np.mean(np.abs(errors) < 1.96 * stds) >= 0.9
        assert np.abs(errors).mean() < 0.2  # the wheels are .34 m/s too slow

    def test_wheels_that_are_taken_at_their_word_mislead_it(self, model: AlongModel) -> None:
        errors, stds = self.braked(model, 0.0)
        assert np.mean(np.abs(errors) < 1.96 * stds) < 0.1


def test_a_receiver_tells_a_speed_that_has_been() -> None:
    known = AlongModel(load_vehicle("family-car"), (*CHANNELS, "speed"), torque_of=None)
    x = np.zeros(len(known.states))
    x[SPEED], x[known.place("speed_lag")] = 20.0, 0.03
    told = known.h(jnp.asarray(x), given(20.0, -5.0, 0.0))
    assert float(told[known.sensors.index("speed")]) == pytest.approx(20.0 + (LATE[0] + 0.03) * 5.0)


@pytest.mark.usefixtures("optimised")
@pytest.mark.parametrize(("bias", "least", "most"), [(40.0, 0.6, 1.2), (0.0, 1.3, 5.0)])
def test_torque_sensors_that_tell_of_torque_where_there_is_none(
    vehicle: Vehicle, drive: Callable[..., Log], bias: float, least: float, most: float
) -> None:
    """A minute uphill: nothing tells their constant error of 40 N·m from grade; who denies it is too sure."""
    count, seeds = 6000, 12
    time = np.arange(count) / 100
    rng = np.random.default_rng(0)
    clean = drive(15 + np.sin(2 * np.pi * time / 20), np.full(count, 0.03))
    own, prior = vehicle.sensors, vehicle.prior.model_copy(update={"rolling_resistance_std": 0.0005})
    torque = own.wheel_torque.model_copy(update={"bias": bias})
    known = own.model_copy(update={"wheel_torque": torque})
    car = vehicle.model_copy(update={"sensors": known, "prior": prior})
    logs = []
    for _ in range(seeds):
        channels = {
            c: clean[c] + 40.0 * rng.standard_normal() for c in ("drive_torque_fl", "drive_torque_fr")
        }
        vibration = own.accel.noise_density * 10 * rng.standard_normal(count)
        channels["accel_x"] = clean["accel_x"] + own.accel.bias * rng.standard_normal() + vibration
        logs.append(clean.with_channels(channels))
    said = batch([build("joint", car, logs[0].available)] * seeds, logs)
    z = np.array([(e.values["grade"][-1] - 0.03) / e.std["grade"][-1] for e in said])
    assert least < np.sqrt(np.mean(z**2)) < most
