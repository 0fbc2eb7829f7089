"""Force at the wheels against hand calculations, for every source of it."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.estimators.traction_case import DT, ENGINE, NAN, SPEEDS, changed, once, take

from roadstate.core import WHEELS, InputError
from roadstate.estimators.traction import Traction, TractionMeter
from roadstate.vehicles import Vehicle, load_vehicle


@pytest.fixture(scope="module")
def R(vehicle: Vehicle) -> float:
    return vehicle.wheels.radius


class TestWheelTorques:
    def test_their_sum_over_the_radius(self, vehicle: Vehicle, R: float) -> None:
        meter = TractionMeter(vehicle, {"drive_torque_fl", "drive_torque_fr"})
        assert meter.source == "wheels"
        traction = once(meter, drive_torque_fl=310.0, drive_torque_fr=300.0)
        assert float(traction.force) == float(traction.drive_force) == pytest.approx(610 / R)
        assert float(traction.torque_std) == pytest.approx(
            vehicle.sensors.wheel_torque.noise * np.sqrt(2) / R
        )
        assert float(traction.inertia) == pytest.approx(vehicle.mass + 4 * vehicle.wheels.inertia / R**2)
        assert not traction.is_shifting
        assert traction.age == 0

    def test_the_oldest_torque_counts(self, vehicle: Vehicle) -> None:
        meter = TractionMeter(vehicle, {"drive_torque_fl", "drive_torque_fr"})
        state = meter.init()
        for k in range(3):
            sample = {"drive_torque_fl": 1.0, "drive_torque_fr": 1.0 if k == 0 else NAN}
            state, traction = take(meter, state, **sample)
        assert float(traction.age) == pytest.approx(2 * DT)

    def test_half_of_a_driven_axle_is_not_the_force(self, vehicle: Vehicle) -> None:
        """With one side's torque only, the engine's is used; without that it is refused."""
        assert TractionMeter(vehicle, {"drive_torque_fl", *ENGINE}).source == "gear"
        with pytest.raises(
            InputError, match=r"driven: front: no drive torque: drive_torque_fr is missing and"
        ):
            TractionMeter(vehicle, {"drive_torque_fl"})
        with pytest.raises(InputError, match="drive_torque_fl is missing"):
            TractionMeter(vehicle, {"drive_torque_rl", "drive_torque_rr"})
        all_driven = changed(vehicle, driven="all")
        with pytest.raises(InputError, match=r"drive_torque_rl is missing .* map 'engine_torque' or"):
            TractionMeter(all_driven, {"drive_torque_fl", "drive_torque_fr"})
        four = TractionMeter(all_driven, {f"drive_torque_{w}" for w in WHEELS})
        assert float(once(four, **dict.fromkeys(four.channels, 100.0)).force) == pytest.approx(
            400 / vehicle.wheels.radius
        )


class TestEngineAndGear:
    @pytest.fixture
    def meter(self, vehicle: Vehicle) -> TractionMeter:
        return TractionMeter(vehicle, ENGINE)

    @pytest.mark.parametrize(
        ("torque", "gear", "speed", "drives"),
        [
            (100, 1.95, 15, True),
            (-30, 1.95, 15, False),  # overrun: the losses add to the drag
            (100, -3.5, -2, True),  # reverse gear
            (-20, -3.5, -2, False),  # rolling backward, engine dragging
            (100, 3.62, 0, True),  # pulling away
            (100, -3.5, 0, True),
            (-100, 3.62, -2, True),  # an electric motor turning backward
        ],
    )
    def test_efficiency_goes_with_the_power(
        self, meter: TractionMeter, vehicle: Vehicle, torque: float, gear: float, speed: float, drives: bool
    ) -> None:
        eta = vehicle.driveline.efficiency
        total = gear * vehicle.driveline.final_drive
        traction = once(meter, speed, engine_torque=torque, gear_ratio=gear)
        expected = torque * total / vehicle.wheels.radius * (eta if drives else 1 / eta)
        assert float(traction.force) == pytest.approx(expected)
        assert float(traction.inertia) == pytest.approx(vehicle.effective_mass(total))
        assert float(traction.torque_std) > 0

    def test_in_neutral_nothing_drives(self, meter: TractionMeter, vehicle: Vehicle) -> None:
        traction = once(meter, engine_torque=50.0, gear_ratio=0.0)
        assert float(traction.force) == 0
        assert float(traction.inertia) == pytest.approx(vehicle.effective_mass(0))
        assert traction.is_shifting

    def test_a_change_of_gear_is_flagged_for_a_while(self, meter: TractionMeter) -> None:
        state, flags = meter.init(), []
        for k in range(400):
            gear = 1.95 if k < 200 else 1.28 * (1 + 0.01 * np.sin(k))  # a ratio given with noise
            state, traction = take(meter, state, engine_torque=80.0, gear_ratio=gear)
            flags.append(bool(traction.is_shifting))
        shifted = np.flatnonzero(flags)
        assert set(range(200, 269)) <= set(shifted)
        assert not set(range(100, 200)) & set(shifted)
        assert not set(range(272, 400)) & set(shifted)

    def test_the_gear_is_held_while_it_is_silent(self, meter: TractionMeter) -> None:
        state, first = take(meter, meter.init(), engine_torque=80.0, gear_ratio=1.28)
        state, second = take(meter, state, engine_torque=80.0)
        assert float(first.force) == float(second.force)
        _, third = take(meter, state, gear_ratio=1.28)
        assert float(third.age) == pytest.approx(DT)

    def test_before_any_torque_nothing_is_known(self, meter: TractionMeter) -> None:
        assert float(once(meter, gear_ratio=1.28).age) > 1e5


class TestEngineSpeed:
    @pytest.fixture
    def meter(self, vehicle: Vehicle) -> TractionMeter:
        return TractionMeter(vehicle, SPEEDS)

    def drive(self, meter: TractionMeter, samples: list[tuple[float, float]]) -> list[Traction]:
        """Over (speed, engine speed) at 100 Hz."""
        state, out = meter.init(), []
        for speed, engine_speed in samples:
            state, traction = take(meter, state, speed, engine_torque=80.0, engine_speed=engine_speed)
            out.append(traction)
        return out

    def test_the_quotient_of_the_speeds_is_the_ratio(
        self, meter: TractionMeter, vehicle: Vehicle, R: float
    ) -> None:
        assert meter.source == "speeds"
        total = 1.28 * vehicle.driveline.final_drive
        last = self.drive(meter, [(15.0, 15.0 / R * total)] * 80)[-1]
        assert float(last.force) == pytest.approx(80 * total / R * vehicle.driveline.efficiency)
        assert float(last.inertia) == pytest.approx(vehicle.effective_mass(total))
        assert not last.is_shifting

    def test_power_is_what_counts(self, meter: TractionMeter, vehicle: Vehicle) -> None:
        """F v = η T ω in any gear, known or not."""
        for engine_speed in (150.0, 300.0):
            force = float(once(meter, 15.0, engine_torque=80.0, engine_speed=engine_speed).force)
            assert force * 15 == pytest.approx(vehicle.driveline.efficiency * 80 * engine_speed)

    def test_reverse(self, meter: TractionMeter, vehicle: Vehicle, R: float) -> None:
        """Engine forward, car backward: a force backward. A motor turning backward pushes backward too."""
        engine_speed = 4.0 / R * 3.5 * vehicle.driveline.final_drive
        for sign in (1, -1):
            traction = once(meter, -4.0, engine_torque=80.0 * sign, engine_speed=engine_speed * sign)
            assert float(traction.force) * -4 == pytest.approx(
                vehicle.driveline.efficiency * 80 * engine_speed
            )

    def test_a_shift_is_flagged_and_a_slow_drift_is_not(self, meter: TractionMeter, R: float) -> None:
        up = [(15.0, 15 / R * 7.9)] * 120 + [(15.0, 15 / R * 5.2)] * 120
        flags = [bool(t.is_shifting) for t in self.drive(meter, up)]
        assert all(flags[120:189])
        assert not any(flags[75:120])
        assert not any(flags[193:])
        drift = [(15.0, 15 / R * 6 * (1 + 0.1 * k * DT)) for k in range(240)]  # a converter, 10 % a second
        assert not any(bool(t.is_shifting) for t in self.drive(meter, drift)[75:])

    @pytest.mark.parametrize("takes", [0.1, 0.3, 0.6])
    def test_a_clutch_that_slips_from_gear_to_gear_is_no_gear(
        self, meter: TractionMeter, R: float, takes: float
    ) -> None:
        """At 100 Hz no sample differs much from the one before, but from what the ratio was lately."""
        noise = 1 + 0.005 * np.random.default_rng(1).standard_normal(400)
        ratio = np.interp(np.arange(400) * DT, [1.5, 1.5 + takes], [7.9, 5.2]) * noise
        flags = [bool(t.is_shifting) for t in self.drive(meter, [(15.0, 15 / R * r) for r in ratio])]
        assert not any(flags[75:150])
        # from half of the way on, until it has long closed
        assert all(flags[150 + round(50 * takes) : 150 + round(100 * takes) + 69])
        assert not any(flags[-100:])

    @pytest.mark.parametrize(
        ("speed", "engine_speed"),
        [(15.0, 80.0), (15.0, 1500.0), (1.9, 100.0), (0.0, 80.0), (-1.9, 80.0), (15.0, 0.0)],
    )
    def test_without_a_gear_in_mesh_it_is_open(
        self, meter: TractionMeter, speed: float, engine_speed: float
    ) -> None:
        """Idling, racing or too slow to tell: flagged, and the ratio stays one the car has."""
        for traction in self.drive(meter, [(speed, engine_speed)] * 100)[-20:]:
            assert traction.is_shifting
            assert np.isfinite(float(traction.force))
            assert float(traction.inertia) < 4 * 1500

    def test_wheels_that_spin_turn_the_engine_and_are_no_shift(
        self, meter: TractionMeter, vehicle: Vehicle, R: float
    ) -> None:
        """On ice a car at 5 m/s spins its wheels up to 15 m/s in half a second."""
        rims = jnp.asarray(np.interp(np.arange(200), [100, 150], [5.0, 15.0]))
        total, state = 2.0 * vehicle.driveline.final_drive, meter.init()
        for k, rim in enumerate(rims):
            sample = {"engine_torque": jnp.asarray(80.0), "engine_speed": rim / R * total}
            state, told = meter.read(state, sample, jnp.asarray(5.0), jnp.asarray(DT), rim)
            assert k < 75 or not told.is_shifting
        assert float(told.force) == pytest.approx(80 * total / R * vehicle.driveline.efficiency)

    def test_wheels_that_hop_over_a_bump_are_no_shift(self, meter: TractionMeter, R: float) -> None:
        """Their rims swing by 8 % within a tenth of a second, and the engine does not."""
        swing = 0.08 * np.sin(np.arange(10) * 0.2 * np.pi)
        state, total = meter.init(), 6.0
        for k in range(200):
            rim = 15.0 * (1 + (swing[k - 120] if 120 <= k < 130 else 0.0))
            sample = {"engine_torque": jnp.asarray(80.0), "engine_speed": jnp.asarray(15.0 / R * total)}
            state, told = meter.read(state, sample, jnp.asarray(15.0), jnp.asarray(DT), jnp.asarray(rim))
            assert k < 75 or not told.is_shifting

    def test_between_samples_the_gear_stays(self, meter: TractionMeter, R: float) -> None:
        """Engine speed at 2 Hz, as by OBD: the ratio is held and its natural drift is no shift."""
        state, flags, forces = meter.init(), [], []
        for k in range(600):
            sample = {"engine_torque": 80.0}
            if k % 50 == 0:
                sample["engine_speed"] = 15 / R * 6 * (1 + 0.05 * (k // 50 % 2))
            state, traction = take(meter, state, **sample)
            flags.append(bool(traction.is_shifting))
            forces.append(float(traction.force))
        assert not any(flags[100:])
        assert len(set(forces[100:])) == 2


class TestSingleRatio:
    def test_one_gear_needs_no_gear_signal(self, vehicle: Vehicle, R: float) -> None:
        """The one ratio counts, whether it is called a gear or a final drive."""
        for driveline in (
            {"gear_ratios": (), "final_drive": 9.1},
            {"gear_ratios": (9.1,), "final_drive": 1.0},
            {"gear_ratios": (2.6,), "final_drive": 3.5},
        ):
            # nor does it need to be measured, by speeds that say nothing at a walking pace
            for more in ((), ("engine_speed",)):
                meter = TractionMeter(changed(vehicle, **driveline), {"engine_torque", *more})
                assert meter.source == "single"
            force = float(once(meter, engine_torque=100.0).force)
            assert force == pytest.approx(910 / R * vehicle.driveline.efficiency)

    def test_several_gears_do(self, vehicle: Vehicle) -> None:
        message = "several gears; map 'gear_ratio' or 'engine_speed'"
        with pytest.raises(InputError, match=message) as refusal:
            TractionMeter(vehicle, {"engine_torque"})
        assert refusal.value.where == "vehicle 'family-car'"

    def test_in_wheel_motors(self) -> None:
        ev = load_vehicle("in-wheel-ev")
        available = {f"drive_torque_{w}" for w in WHEELS}
        assert TractionMeter(ev, available).source == "wheels"


class TestBrakes:
    def brakes(self, vehicle: Vehicle, speed: float = 15.0, **sample: float) -> Traction:
        meter = TractionMeter(vehicle, {"drive_torque_fl", "drive_torque_fr", *sample})
        assert meter.knows_brakes
        return once(meter, speed, drive_torque_fl=0.0, drive_torque_fr=0.0, **sample)

    @pytest.mark.parametrize(("speed", "sign"), [(15.0, -1), (-3.0, 1), (0.0, 0)])
    def test_torques_act_against_the_motion(
        self, vehicle: Vehicle, R: float, speed: float, sign: int
    ) -> None:
        traction = self.brakes(vehicle, speed, **{f"brake_torque_{w}": 200.0 for w in WHEELS})
        assert float(traction.force) == pytest.approx(sign * 800 / R)
        assert float(traction.drive_force) == 0
        assert float(traction.brake_std) == pytest.approx(0.2 * 800 / R)
        assert traction.is_braking
        assert not traction.is_brake_unknown

    def test_pressures_by_the_vehicles_gains(self, vehicle: Vehicle, R: float) -> None:
        traction = self.brakes(vehicle, **{f"brake_pressure_{w}": 2e6 for w in WHEELS})
        assert float(traction.force) == pytest.approx(-2 * (400 + 200) / R)
        assert traction.is_braking
        assert not traction.is_brake_unknown

    def test_pressures_without_gains_say_only_that_they_act(self, vehicle: Vehicle) -> None:
        bare = vehicle.model_copy(update={"brakes": None})
        traction = self.brakes(bare, **{f"brake_pressure_{w}": 2e6 for w in WHEELS})
        assert float(traction.force) == 0
        assert traction.is_braking
        assert traction.is_brake_unknown

    @pytest.mark.parametrize(("brake", "acts"), [(0.0, False), (1.0, True), (0.02, True), (NAN, False)])
    def test_a_pedal_says_that_they_act(self, vehicle: Vehicle, brake: float, acts: bool) -> None:
        traction = self.brakes(vehicle, brake=brake)
        assert bool(traction.is_braking) is acts
        assert bool(traction.is_brake_unknown) is acts
        assert float(traction.force) == 0

    def test_a_trace_of_pressure_or_torque_is_no_braking(self, vehicle: Vehicle) -> None:
        assert not self.brakes(vehicle, brake_pressure_fl=5e4).is_braking
        assert not self.brakes(vehicle, brake_torque_fl=10.0).is_braking

    def test_torque_is_preferred_to_pressure(self, vehicle: Vehicle) -> None:
        traction = self.brakes(vehicle, brake_torque_fl=500.0, brake_pressure_fl=1e7)
        assert float(traction.brake_torque[0]) == 500

    def test_the_sign_of_a_brake_torque_does_not_matter(self, vehicle: Vehicle, R: float) -> None:
        told = {f"brake_torque_{w}": -500.0 for w in WHEELS}
        assert float(self.brakes(vehicle, **told).force) == pytest.approx(-2000 / R)

    @pytest.mark.parametrize(
        ("told", "torques"),
        [
            ({"brake_pressure_fl": 4e6}, [800, 800, 400, 400]),  # a master cylinder's, mapped once
            ({"brake_pressure_rr": 4e6}, [800, 800, 400, 400]),
            ({"brake_torque_fl": 600.0, "brake_torque_fr": 1000.0}, [600, 1000, 400, 400]),
            ({"brake_torque_fl": 600.0, "brake_torque_rl": 50.0}, [600, 600, 50, 50]),
        ],
    )
    def test_wheels_of_which_nothing_is_told_brake_as_the_others(
        self, vehicle: Vehicle, told: dict[str, float], torques: list[float]
    ) -> None:
        """The other side as this one; the other axle as the same pressure makes it: half of the front's."""
        traction = self.brakes(vehicle, **told)
        np.testing.assert_allclose(traction.brake_torque, torques)
        assert not traction.is_brake_unknown

    def test_half_a_cars_brakes_are_unknown_ones_where_no_file_shares_them(self, vehicle: Vehicle) -> None:
        bare = vehicle.model_copy(update={"brakes": None})
        traction = self.brakes(bare, brake_torque_fl=500.0, brake_torque_fr=500.0)
        assert traction.is_braking
        assert traction.is_brake_unknown
        assert not self.brakes(bare, brake_torque_fl=10.0, brake_torque_fr=10.0).is_brake_unknown

    def test_without_a_channel_nothing_is_known(self, vehicle: Vehicle) -> None:
        meter = TractionMeter(vehicle, {"drive_torque_fl", "drive_torque_fr"})
        assert not meter.knows_brakes


@pytest.mark.parametrize("channels", [ENGINE, SPEEDS, ("drive_torque_fl", "drive_torque_fr")])
@pytest.mark.parametrize("speed", [0.0, 15.0, -3.0])
def test_derivatives_are_finite(vehicle: Vehicle, channels: tuple[str, ...], speed: float) -> None:
    """At the first sample, without one, in neutral, at standstill."""
    meter = TractionMeter(vehicle, {*channels, "brake_pressure_fl"})

    def value(meter: TractionMeter, sample: Any) -> Any:
        _, traction = meter.read(meter.init(), sample, jnp.asarray(speed), jnp.asarray(0.0))
        return traction.force + traction.torque_std + traction.brake_std + traction.inertia

    gradient = jax.jit(jax.grad(value))
    for fill in (0.0, 100.0, NAN):
        slopes = gradient(meter, {c: jnp.asarray(fill) for c in meter.channels})
        for leaf in jax.tree.leaves(slopes):
            assert np.isfinite(leaf).all()


class TestEachWheel:
    def test_torques_of_each_wheel_sum_to_the_force(self, vehicle: Vehicle, R: float) -> None:
        channels = {"drive_torque_fl", "drive_torque_fr", *(f"brake_torque_{w}" for w in WHEELS)}
        brakes = {f"brake_torque_{w}": 100.0 * (i + 1) for i, w in enumerate(WHEELS)}
        traction = once(
            TractionMeter(vehicle, channels), drive_torque_fl=310.0, drive_torque_fr=300.0, **brakes
        )
        np.testing.assert_array_equal(traction.drive_torque, [310, 300, 0, 0])
        np.testing.assert_array_equal(traction.brake_torque, [100, 200, 300, 400])
        assert float(traction.force) == pytest.approx((610 - 1000) / R)

    def test_an_engines_torque_is_shared_by_the_driven_wheels(self, vehicle: Vehicle, R: float) -> None:
        traction = once(TractionMeter(vehicle, set(ENGINE)), engine_torque=100.0, gear_ratio=1.28)
        shares = np.asarray(traction.drive_torque)
        assert shares[0] == shares[1] > 0
        assert (shares[2:] == 0).all()
        assert shares.sum() == pytest.approx(float(traction.drive_force) * R)

    def test_a_torque_sensor_on_a_wheel_that_is_not_driven_is_not_read(self, vehicle: Vehicle) -> None:
        meter = TractionMeter(vehicle, {f"drive_torque_{w}" for w in WHEELS})
        assert set(meter.channels) == {"drive_torque_fl", "drive_torque_fr"}

    @pytest.mark.parametrize(("pedal", "counts"), [(None, False), (0.0, False), (1.0, True)])
    def test_brake_torques_as_small_as_noise_count_while_the_pedal_says_so(
        self, vehicle: Vehicle, pedal: float | None, counts: bool
    ) -> None:
        """Noise of magnitudes has a mean: four wheels' worth of 8 N·m would be 0.7 % of grade."""
        sample = {f"brake_torque_{w}": 8.0 for w in WHEELS} | ({} if pedal is None else {"brake": pedal})
        meter = TractionMeter(vehicle, {"drive_torque_fl", "drive_torque_fr", *sample})
        traction = once(meter, drive_torque_fl=0.0, drive_torque_fr=0.0, **sample)
        assert float(traction.brake_torque.sum()) == (32.0 if counts else 0.0)
