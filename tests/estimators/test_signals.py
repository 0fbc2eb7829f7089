"""Held signals, and the speed that wheels tell, against the geometry of a turning car."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadstate.core import WHEELS, InputError
from roadstate.estimators.signals import Held, SpeedMeter, random_walk_growth, signed_direction
from roadstate.vehicles import Vehicle

NAN = np.nan
ALL = tuple(f"wheel_speed_{w}" for w in WHEELS)


class TestHeld:
    def test_a_sample_is_held_and_grows_old(self) -> None:
        held = Held.empty()
        assert held.age >= 1e6
        seen = []
        for sample in (NAN, 3.0, NAN, NAN, -1.0):
            held = held.take(jnp.asarray(sample), jnp.asarray(0.1))
            seen.append((float(held.value), round(float(held.age), 9)))
        assert seen[1:] == [(3.0, 0.0), (3.0, 0.1), (3.0, 0.2), (-1.0, 0.0)]
        assert seen[0][0] == 0
        assert seen[0][1] > 1e5

    @pytest.mark.parametrize("rubbish", [np.inf, -np.inf])
    def test_an_infinite_sample_is_none(self, rubbish: float) -> None:
        held = Held.empty().take(jnp.asarray(2.0), jnp.asarray(0.0))
        held = held.take(jnp.asarray(rubbish), jnp.asarray(0.5))
        assert (float(held.value), float(held.age)) == (2.0, 0.5)


@given(st.floats(0, 5), st.lists(st.floats(0.001, 2), min_size=1, max_size=6))
def test_random_walk_growth_does_not_depend_on_the_cut(age: float, steps: list[float]) -> None:
    total, at = 0.0, age
    for step in steps:
        total += float(random_walk_growth(np.asarray(at), np.asarray(step)))
        at += step
    assert total == pytest.approx((at**3 - age**3) / 3, rel=1e-9)


def test_a_reverse_gear_turns_an_unsigned_speed() -> None:
    assert [float(signed_direction(jnp.asarray(g))) for g in (-3.5, 0.0, 3.6, NAN)] == [-1, 1, 1, 1]


def turning_car(vehicle: Vehicle, speed: float, radius: float) -> dict[str, float]:
    """Samples of a car that rolls without slip about a point on its rear axle's line, at a signed radius.

    The rear axle's centre goes at v_x; every wheel's plane is square to its ray from the turning point, so
    it rolls at yaw rate × distance.
    """
    geometry, R = vehicle.geometry, vehicle.wheels.radius
    yaw_rate = speed / radius
    halves = {"f": geometry.track_front / 2, "r": geometry.track_rear / 2}
    sample = {"yaw_rate": yaw_rate, "steer": float(np.arctan(vehicle.wheelbase / radius))}
    for wheel in WHEELS:
        side = radius - halves[wheel[0]] * (1 if wheel[1] == "l" else -1)
        ahead = vehicle.wheelbase if wheel[0] == "f" else 0.0
        sample[f"wheel_speed_{wheel}"] = abs(yaw_rate) * np.hypot(side, ahead) * np.sign(speed) / R
    sample["steering_wheel"] = sample["steer"] * vehicle.steering.ratio  # type: ignore[union-attr]
    return sample


def read(
    meter: SpeedMeter, sample: dict[str, float], direction: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    arrays = {c: jnp.asarray(sample.get(c, NAN)) for c in meter.channels}
    steer = jnp.nan_to_num(meter.steer(arrays))
    yaw_rate = jnp.asarray(sample.get("yaw_rate", 0.0))
    speeds, std = meter.read(arrays, yaw_rate, steer, jnp.asarray(direction))
    return np.asarray(speeds), np.asarray(std)


class TestSpeedMeter:
    @pytest.mark.parametrize("speed", [15.0, -4.0])
    @pytest.mark.parametrize("radius", [6.0, -6.0, 40.0, -1e6])
    @pytest.mark.parametrize("steering", ["steer", "steering_wheel"])
    def test_a_turning_car_without_slip(
        self, vehicle: Vehicle, speed: float, radius: float, steering: str
    ) -> None:
        meter = SpeedMeter(vehicle, {*ALL, steering})
        assert meter.channels == (*ALL, steering)
        assert meter.sensors == ("wheel_speed_front", "wheel_speed_rear")
        speeds, _ = read(meter, turning_car(vehicle, speed, radius))
        assert speeds[1] == pytest.approx(speed, rel=1e-12)
        # the mean angle stands for both front wheels: exact to second order in track over radius
        half = vehicle.geometry.track_front / 2
        assert speeds[0] == pytest.approx(speed, rel=(half * vehicle.wheelbase / radius**2) ** 2 + 1e-9)

    @pytest.mark.parametrize("missing", [("rl",), ("rr",), ("fl", "rr"), ("fr", "rl")])
    def test_one_wheel_does_for_its_axle(self, vehicle: Vehicle, missing: tuple[str, ...]) -> None:
        """Gone for a sample or never mapped: the other wheel, freed of its own yaw part, is enough."""
        sample = turning_car(vehicle, 10.0, 30.0)
        gone = {f"wheel_speed_{w}" for w in missing}
        for meter, samples in (
            (SpeedMeter(vehicle, {*ALL, "steer"}), {**sample, **dict.fromkeys(gone, NAN)}),
            (SpeedMeter(vehicle, ({*ALL} - gone) | {"steer"}), sample),
        ):
            speeds, _ = read(meter, samples)
            np.testing.assert_allclose(speeds, 10.0, rtol=2e-3)
            assert speeds[1] == pytest.approx(10.0, rel=1e-12)

    def test_an_axle_without_a_sample_is_missing(self, vehicle: Vehicle) -> None:
        meter = SpeedMeter(vehicle, ALL)
        sample = {
            "wheel_speed_fl": NAN,
            "wheel_speed_fr": np.inf,
            "wheel_speed_rl": 10.0,
            "wheel_speed_rr": 12.0,
        }
        speeds, std = read(meter, sample)
        np.testing.assert_allclose(speeds, [NAN, 11.0 * vehicle.wheels.radius])
        assert np.isfinite(std).all()

    def test_only_one_axle(self, vehicle: Vehicle) -> None:
        meter = SpeedMeter(vehicle, {"wheel_speed_rl", "wheel_speed_rr", "speed"})
        assert meter.sensors == ("wheel_speed_rear",)
        assert "speed" not in meter.channels  # the wheels tell more

    @pytest.mark.parametrize("available", [ALL, ("speed",)])
    def test_reverse(self, vehicle: Vehicle, available: Collection[str]) -> None:
        """An unsigned sensor takes its sign from the gear; a signed one knows it."""
        meter = SpeedMeter(vehicle, {*available, "gear_ratio"})
        assert "gear_ratio" in meter.channels
        per_speed = 1.0 if available == ("speed",) else 1 / vehicle.wheels.radius
        for reading, direction, expected in ((3, 1, 3), (3, -1, -3), (-3, 1, -3), (-3, -1, -3), (0, -1, 0)):
            speeds, _ = read(meter, dict.fromkeys(available, reading * per_speed), direction)
            np.testing.assert_allclose(speeds, expected, atol=1e-12)

    def test_reverse_in_a_turn(self, vehicle: Vehicle) -> None:
        sample = turning_car(vehicle, -4.0, 12.0)
        unsigned = {n: abs(v) if n in ALL else v for n, v in sample.items()}
        speeds, _ = read(SpeedMeter(vehicle, {*ALL, "steer"}), unsigned, direction=-1.0)
        np.testing.assert_allclose(speeds, -4.0, rtol=2e-3)

    def test_mirrored_left_and_right_tell_the_same(self, vehicle: Vehicle) -> None:
        meter = SpeedMeter(vehicle, {*ALL, "steer"})
        rng = np.random.default_rng(0)
        sample = {c: float(rng.uniform(20, 40)) for c in ALL} | {"yaw_rate": 0.3, "steer": 0.1}
        swap = {"fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl"}
        mirrored = {f"wheel_speed_{swap[w]}": sample[f"wheel_speed_{w}"] for w in WHEELS}
        mirrored |= {"yaw_rate": -0.3, "steer": -0.1}
        np.testing.assert_array_equal(read(meter, sample), read(meter, mirrored))

    def test_noise(self, vehicle: Vehicle) -> None:
        noise = vehicle.wheels.radius * vehicle.sensors.wheel_speed.noise
        _, std = read(SpeedMeter(vehicle, ALL), dict.fromkeys(ALL, 30.0))
        assert std[0] > std[1] == pytest.approx(noise)  # the driven front axle slips
        both_driven = vehicle.model_copy(
            update={"driveline": vehicle.driveline.model_copy(update={"driven": "all"})}
        )
        _, std = read(SpeedMeter(both_driven, ALL), dict.fromkeys(ALL, 30.0))
        assert std[0] == std[1]
        _, std = read(SpeedMeter(vehicle, {"speed"}), {"speed": 9.0})
        assert std == pytest.approx([vehicle.sensors.speed.noise])

    @pytest.mark.parametrize("speed", [0.0, 0.5, -0.5])
    def test_near_standstill_a_tooth_sensor_may_read_anything_down_to_zero(
        self, vehicle: Vehicle, speed: float
    ) -> None:
        _, std = read(SpeedMeter(vehicle, {"speed"}), {"speed": speed})
        assert std[0] == pytest.approx(np.hypot(vehicle.sensors.speed.noise, 0.25))
        _, std = read(SpeedMeter(vehicle, {"speed"}), {"speed": 0.71})
        assert std[0] == pytest.approx(vehicle.sensors.speed.noise)

    def test_steering(self, vehicle: Vehicle) -> None:
        wheel = SpeedMeter(vehicle, {*ALL, "steering_wheel"})
        ratio = vehicle.steering.ratio  # type: ignore[union-attr]
        assert float(wheel.steer({"steering_wheel": jnp.asarray(0.5)})) == pytest.approx(0.5 / ratio)
        assert np.isnan(wheel.steer({"steering_wheel": jnp.asarray(NAN)}))
        assert np.isnan(SpeedMeter(vehicle, ALL).steer({}))
        without = vehicle.model_copy(update={"steering": None})
        assert "steering_wheel" not in SpeedMeter(without, {*ALL, "steering_wheel"}).channels
        both = SpeedMeter(vehicle, {*ALL, "steer", "steering_wheel"})
        assert "steering_wheel" not in both.channels  # the road-wheel angle needs no ratio

    def test_no_speed_is_refused(self, vehicle: Vehicle) -> None:
        with pytest.raises(InputError, match=r"no speed; map 'speed' or 'wheel_speed_\*'"):
            SpeedMeter(vehicle, {"accel_x"})

    def test_missing_samples_do_not_spoil_derivatives(self, vehicle: Vehicle) -> None:
        meter = SpeedMeter(vehicle, {*ALL, "steering_wheel"})
        sample = {c: jnp.asarray(30.0) for c in ALL} | {"wheel_speed_fl": jnp.asarray(NAN)}
        sample["steering_wheel"] = jnp.asarray(NAN)

        def value(meter: Any) -> Any:
            steer = jnp.nan_to_num(meter.steer(sample))
            speeds, std = meter.read(sample, jnp.asarray(0.1), steer, jnp.asarray(1.0))
            return jnp.sum(speeds) + jnp.sum(std)

        gradient = jax.grad(value)(meter)
        for leaf in jax.tree.leaves(gradient):
            assert np.isfinite(leaf).all()
        assert float(gradient._radius) == pytest.approx(60.0)
