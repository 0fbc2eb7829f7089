"""Forces on the axles by torques and accelerometers, without a tire model."""

from __future__ import annotations

import operator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from roadstate.core import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.estimators.axle_forces import AxleForces
from roadstate.estimators.base import Sample
from roadstate.estimators.contact_forces import ForceMeter, ForceMeterState
from roadstate.estimators.intake import ACCEL_X, ACCEL_Y, SPIN, Signals
from roadstate.estimators.load_transfer import Lean
from roadstate.vehicles import Vehicle, load_vehicle

read_of = eqx.filter_jit(ForceMeter.read)

SPEED, STEP = 20.0, 0.01


def read(
    meter: ForceMeter, state: ForceMeterState, sample: Sample, signals: Signals, *about: Array
) -> tuple[ForceMeterState, AxleForces]:
    """Of a car that weighs what its file says."""
    return read_of(meter, state, sample, signals, *about[:-1], jnp.zeros(3), jnp.ones(()), about[-1])


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return load_vehicle("family-car")


def balance(
    vehicle: Vehicle,
    accel: float,
    spin_rate: list[float],
    torque: float,
    slope: float = 0.0,
    gear: float = 0.0,
    lightness: float = 1.0,
) -> AxleForces:
    """At 20 m/s, straight on, each front wheel driven by a torque, or both by an engine's in a gear;
    everything as it has long been."""
    wheels = [f"drive_torque_{w}" for w in WHEELS]
    meter = ForceMeter(vehicle, ["engine_torque", "gear_ratio"] if gear else wheels)
    zero = jnp.zeros(8)
    value = zero.at[ACCEL_X].set(accel).at[SPIN].set(SPEED / vehicle.wheels.radius)
    rate = zero.at[SPIN].set(jnp.asarray(spin_rate) / vehicle.wheels.radius)
    signals = Signals(
        value, zero, jnp.ones(8, bool), value, rate, zero, zero, value, rate, jnp.zeros(2), jnp.zeros(8, bool)
    )
    sample = {c: jnp.asarray(torque if c[-2] == "f" else 0.0) for c in meter.channels}
    if gear:
        sample = {"engine_torque": jnp.asarray(torque), "gear_ratio": jnp.asarray(gear)}
    leaning = Lean(jnp.asarray(accel), jnp.zeros(()), jnp.asarray(accel))
    state = meter.init()._replace(lean=leaning)
    speed, about = jnp.asarray(SPEED), (jnp.asarray(slope), jnp.zeros(3), jnp.asarray(lightness))
    _, forces = read_of(meter, state, sample, signals, speed, jnp.zeros(2), *about, jnp.asarray(STEP))
    return forces


def rolling(vehicle: Vehicle, accel: float = 0.0) -> float:
    """F_x of the idle axle's wheels that turn up as a car on a level road does."""
    return float(balance(vehicle, accel, [accel] * 4, 0.0).now.told[1])


def test_the_noise_of_a_wheels_speed_is_no_force(vehicle: Vehicle) -> None:
    """A wheel's acceleration that is less than its noise makes a hundredth of the force it seems to."""
    noise = vehicle.sensors.wheel_speed.noise / 0.05 * vehicle.wheels.radius
    noisy = float(balance(vehicle, 0.0, [0, 0, 0.3 * noise, 0.0], 0.0).now.told[1])
    seems = vehicle.wheels.inertia * 0.3 * noise / vehicle.wheels.radius**2
    assert abs(noisy - rolling(vehicle)) < 0.02 * seems


def test_a_wheel_that_spins_up_keeps_its_torque(vehicle: Vehicle) -> None:
    """I ω̇ = T − R F_x: at 300 m/s² of its rim nearly all of what turns it up is no force on the road."""
    rims = [300.0, 300.0, 0.0, 0.0]
    told = float(balance(vehicle, 0.0, rims, 1000.0).now.told[0])
    held = float(balance(vehicle, 0.0, [0.0] * 4, 1000.0).now.told[0])
    spent = 2 * vehicle.wheels.inertia * 300.0 / vehicle.wheels.radius**2
    assert held - told == pytest.approx(spent, rel=0.05)


def test_an_engine_turns_with_the_mean_of_its_wheels(vehicle: Vehicle) -> None:
    """One driven wheel leaves the ground and spins up as the other slows down: no engine takes part in it."""
    gear, radius, line = 3.62, vehicle.wheels.radius, vehicle.driveline
    still, apart, both = (
        np.asarray(balance(vehicle, 0.0, [*rims, 0.0, 0.0], 0.0, gear=gear).told)
        for rims in ((0.0, 0.0), (300.0, -300.0), (300.0, 300.0))
    )
    own = vehicle.wheels.inertia * 300.0 / radius**2
    np.testing.assert_allclose((apart - still)[:2], [-own, own], rtol=0.05)
    turned = line.engine_inertia * (gear * line.final_drive) ** 2 * 300.0 / radius**2
    np.testing.assert_allclose((both - still)[:2], -own - 0.5 * turned, rtol=0.05)


@pytest.mark.parametrize(
    ("slope", "brake", "found"), [(0.0, 0.0, False), (1.0, 0.0, False), (0.0, 1.2, True)]
)
def test_what_turns_up_an_engine_is_no_brake(
    vehicle: Vehicle, slope: float, brake: float, found: bool
) -> None:
    """In first gear a quarter of the torque goes into the engine; nothing tells of brakes."""
    gear, line, radius = 3.62, vehicle.driveline, vehicle.wheels.radius
    meter, zero, accel = ForceMeter(vehicle, ["engine_torque", "gear_ratio"]), jnp.zeros(8), 4.0
    ratio = gear * line.final_drive
    mass = vehicle.effective_mass(0.0) + line.engine_inertia * (ratio / radius) ** 2
    rolling = vehicle.rolling_resistance.coefficient + vehicle.rolling_resistance.speed_coefficient * SPEED**2
    force = mass * accel + vehicle.drag_factor * SPEED**2
    force += vehicle.mass * (slope + GRAVITY * rolling + brake)
    sample = {"engine_torque": force * radius / ratio / line.efficiency, "gear_ratio": gear}
    felt = zero.at[ACCEL_X].set((accel + slope) * (1 + GRAVITY * vehicle.body.pitch_gradient))
    turns = zero.at[SPIN].set(accel / radius)
    signals = Signals(
        felt, zero, jnp.ones(8, bool), felt, turns, zero, zero, felt, turns, jnp.zeros(2), jnp.zeros(8, bool)
    )
    numbers = [jnp.asarray(n) for n in (SPEED, slope, STEP)]
    arrays = {channel: jnp.asarray(value) for channel, value in sample.items()}
    state = meter.init()
    for _ in range(200):
        state, forces = read(meter, state, arrays, signals, numbers[0], jnp.zeros(2), *numbers[1:])
    assert bool(forces.is_brake_unknown) == found


def test_what_a_wheel_gets_of_an_engine_is_less_sure_than_what_is_measured_there(vehicle: Vehicle) -> None:
    engine = balance(vehicle, 0.0, [0.0] * 4, 100.0, gear=3.62)
    share = 0.5 * 100.0 * 3.62 * vehicle.driveline.final_drive * vehicle.driveline.efficiency
    force = share / vehicle.wheels.radius / np.asarray(engine.load)[0]
    wheel = balance(vehicle, 0.0, [0.0] * 4, share)
    more = np.asarray(engine.along_std) ** 2 - np.asarray(wheel.along_std) ** 2
    assert more[0] ** 0.5 == pytest.approx(0.1 * force, rel=0.05)
    assert more[2] == pytest.approx(0.0, abs=1e-6)


def test_wheels_turn_up_with_the_car_and_not_with_the_slope(vehicle: Vehicle) -> None:
    """An idle wheel is turned up by the road: I a/R²; on a slope none."""
    pushed = vehicle.wheels.inertia * 2.0 / vehicle.wheels.radius**2
    # the load moves to the rear as the car gains speed, and rolling resistance with it
    shift = vehicle.rolling_resistance.coefficient * vehicle.mass * 2.0 * vehicle.geometry.cg_height
    shift /= vehicle.geometry.cg_to_front_axle + vehicle.geometry.cg_to_rear_axle
    assert rolling(vehicle, 2.0) - rolling(vehicle) == pytest.approx(-2 * pushed - shift, rel=0.1)
    level, steep = balance(vehicle, 0.0, [0] * 4, 0.0), balance(vehicle, 1.0, [0] * 4, 0.0, slope=1.0)
    assert float(steep.now.told[0]) == pytest.approx(float(level.now.told[0]), abs=10)


def test_without_lag_and_with_it_forces_that_last_are_the_same(vehicle: Vehicle) -> None:
    forces = balance(vehicle, 1.0, [1.0] * 4, 300.0)
    along = np.asarray(forces.along).reshape(2, 2).sum(axis=1)
    np.testing.assert_allclose(np.asarray(forces.now.along), along, rtol=1e-9)
    np.testing.assert_allclose(np.asarray(forces.now.across), np.asarray(forces.across), atol=1e-9)


def leans(vehicle: Vehicle, kinds: tuple[str, ...], lasting: float = 0.0) -> np.ndarray:
    """(600,) the lean over 6 s in which a rough road shakes the accelerometer, at constant torque, m/s².

    Args:
        vehicle: with a driven front axle.
        kinds: of torques that are measured.
        lasting: what the accelerometer tells beside the shaking, m/s².
    """
    meter = ForceMeter(vehicle, [f"{kind}_{w}" for kind in kinds for w in WHEELS])
    sample = {c: jnp.asarray(200.0 if c.startswith("drive_torque_f") else 0.0) for c in meter.channels}

    def step(state: ForceMeterState, accel: Array) -> tuple[ForceMeterState, Array]:
        value = jnp.zeros(8).at[ACCEL_X].set(accel).at[SPIN].set(SPEED / vehicle.wheels.radius)
        zero = jnp.zeros(8)
        signals = Signals(
            value,
            zero,
            jnp.ones(8, bool),
            value,
            zero,
            zero,
            zero,
            value,
            zero,
            jnp.zeros(2),
            jnp.zeros(8, bool),
        )
        speed, still = jnp.asarray(SPEED), jnp.zeros(())
        state, forces = read(meter, state, sample, signals, speed, jnp.zeros(2), still, jnp.asarray(STEP))
        return state, forces.lean.accel

    shaken = lasting + 1.5 * np.sin(2 * np.pi * 1.5 * STEP * np.arange(600))
    return np.asarray(jax.lax.scan(step, meter.init(), jnp.asarray(shaken))[1])


def test_a_body_leans_by_torques_where_all_are_measured(vehicle: Vehicle) -> None:
    push = 400.0 / vehicle.wheels.radius / vehicle.mass
    lasting = 0.75 * push  # less air and rolling resistance
    by_torque = leans(vehicle, ("drive_torque", "brake_torque"), lasting)[300:]
    by_accel = leans(vehicle, ("drive_torque",), lasting)[300:]
    assert np.ptp(by_torque) < 0.15  # what turns the wheels up
    assert by_torque.mean() == pytest.approx(lasting, rel=0.05)
    assert np.ptp(by_accel) > 3.0


def test_a_body_does_not_lean_by_torques_that_lie(vehicle: Vehicle) -> None:
    """The accelerometer says for seconds that the car brakes, and torques that it is driven."""
    lying = leans(vehicle, ("drive_torque", "brake_torque"), lasting=-4.0)[300:]
    assert lying.mean() == pytest.approx(-4.0, abs=0.2)


@pytest.mark.parametrize("load", [-0.2, 0.0, 0.7])
def test_what_turns_up_an_engine_is_told_by_its_torque(vehicle: Vehicle, load: float) -> None:
    """(Θ − m) v̇ of Θ' v̇ = F − c v² − f m g − m g sin θ with the mass loaded; no matter what is felt."""
    line, slope, torque = vehicle.driveline, 0.3, 120.0
    ratio, mass = 3.62 * line.final_drive, vehicle.mass * (1 + load)
    rotating = vehicle.effective_mass(ratio) - vehicle.mass
    told = [
        balance(vehicle, felt, [0.0] * 4, torque, slope, gear=3.62, lightness=1 / (1 + load))
        for felt in (0.0, 2.0)
    ]
    car = ForceMeter(vehicle, ["engine_torque", "gear_ratio"]).balance.car
    force = torque * ratio * line.efficiency / vehicle.wheels.radius - float(car.drag(SPEED))
    gains = (force / mass - GRAVITY * float(car.rolling_coefficient(SPEED)) - slope) / (1 + rotating / mass)
    for forces in told:
        assert float(forces.turned) == pytest.approx(rotating / vehicle.mass * gains, rel=1e-6)


def test_what_stirs_up_an_axle_is_remembered_for_a_moment(vehicle: Vehicle) -> None:
    """A jolt of one sample leads the low pass by the force it is, and by 1/e of that .15 s later."""
    meter = ForceMeter(vehicle, [])
    zero, state, stir = jnp.zeros(8), meter.init(), []
    for now in (0.0, -2.0, *[0.0] * 15):
        sharp = zero.at[ACCEL_X].set(now)
        signals = Signals(
            zero,
            zero,
            jnp.ones(8, bool),
            zero,
            zero,
            zero,
            zero,
            sharp,
            zero,
            jnp.zeros(2),
            jnp.zeros(8, bool),
        )
        speed, still = jnp.asarray(SPEED), jnp.zeros(())
        state, forces = read(meter, state, {}, signals, speed, jnp.zeros(2), still, jnp.asarray(STEP))
        stir.append(np.asarray(forces.stir))
    assert stir[0].max() == 0
    assert stir[1][0].sum() == pytest.approx(2.0 * vehicle.mass, rel=0.05)  # more, where a body pitches
    assert stir[1][1].max() == 0
    np.testing.assert_allclose(stir[16], stir[1] * np.exp(-1), rtol=1e-5)


def untold(vehicle: Vehicle, accel: float, speed: float) -> AxleForces:
    """What an accelerometer alone tells, straight on, wheels that turn as the car does."""
    meter, zero = ForceMeter(vehicle, ()), jnp.zeros(8)
    value = zero.at[ACCEL_X].set(accel).at[SPIN].set(speed / vehicle.wheels.radius)
    rate = zero.at[SPIN].set(accel / vehicle.wheels.radius)
    signals = Signals(
        value, zero, jnp.ones(8, bool), value, rate, zero, zero, value, rate, jnp.zeros(2), jnp.zeros(8, bool)
    )
    state = meter.init()._replace(lean=Lean(jnp.asarray(accel), jnp.zeros(()), jnp.asarray(accel)))
    still = jnp.zeros(())
    return read(meter, state, {}, signals, jnp.asarray(speed), jnp.zeros(2), still, jnp.asarray(STEP))[1]


def test_wheels_that_nothing_drives_need_no_torque_to_be_told(vehicle: Vehicle) -> None:
    """They roll and are spun up; the front ones push for that, too."""
    accel = 1.2
    along = np.asarray(untold(vehicle, accel, SPEED).along)
    rolling = vehicle.rolling_resistance
    load = np.asarray(untold(vehicle, accel, SPEED).load)
    bears = (rolling.coefficient + rolling.speed_coefficient * SPEED**2) * load[2:]
    spins = 2 * vehicle.wheels.inertia * accel / vehicle.wheels.radius**2
    assert along[2:].sum() == pytest.approx(-bears.sum() - spins, rel=0.02)
    drag = 0.5 * vehicle.aerodynamics.air_density * vehicle.drag_area * SPEED**2
    assert along.sum() == pytest.approx(vehicle.mass * accel + drag, rel=0.01)


def test_brakes_that_no_channel_tells_of_are_shared_as_the_file_says(vehicle: Vehicle) -> None:
    assert vehicle.brakes is not None
    told = untold(vehicle, -4.0, SPEED)
    along, std = np.asarray(told.along), np.asarray(told.along_std * told.load)
    ratio = vehicle.brakes.torque_per_pressure_front / vehicle.brakes.torque_per_pressure_rear
    assert along[:2].sum() / along[2:].sum() == pytest.approx(ratio, rel=0.15)
    # a wheel that is not braked at all lies within two and a half σ
    assert (std[2:] > np.abs(along[2:]) / 2.5).all()


def test_a_car_that_stands_uphill_is_not_held_by_its_drive_alone(vehicle: Vehicle) -> None:
    along = np.asarray(untold(vehicle, 0.8, 0.0).along)
    assert along[2:].sum() > 0.25 * along.sum() > 0


def test_a_car_that_brakes_hold_keeps_what_its_tires_stopped_with(vehicle: Vehicle) -> None:
    """Braked at 3 m/s² to a stop uphill: front and rear go on pulling against each other."""
    meter = ForceMeter(vehicle, [f"{kind}_torque_{w}" for kind in ("drive", "brake") for w in WHEELS])
    radius, zero, state = vehicle.wheels.radius, jnp.zeros(8), meter.init()
    braked = {"f": 0.35 * vehicle.mass * 3.0 * radius, "r": 0.15 * vehicle.mass * 3.0 * radius}
    apart, total = [], []
    for speed, accel, share in [(1.0, -3.0, 1.0)] * 60 + [(0.0, 1.0, 1.0)] * 60 + [(0.0, 1.0, 0.0)] * 60:
        value = zero.at[ACCEL_X].set(accel).at[SPIN].set(speed / radius)
        rate = zero.at[SPIN].set(accel / radius) if speed else zero
        signals = Signals(
            value,
            zero,
            jnp.ones(8, bool),
            value,
            rate,
            zero,
            zero,
            value,
            rate,
            jnp.zeros(2),
            jnp.zeros(8, bool),
        )
        sample = {c: jnp.asarray(share * braked[c[-2]] if "brake" in c else 0.0) for c in meter.channels}
        slope, step = jnp.asarray(0.0 if speed else 1.0), jnp.asarray(STEP)
        state, forces = read(meter, state, sample, signals, jnp.asarray(speed), jnp.zeros(2), slope, step)
        front, rear = np.asarray(forces.now.along)
        apart.append(front - rear)
        total.append(front + rear)
    moves, stands, let_go = apart[50], apart[119], apart[179]
    assert total[119] == pytest.approx(vehicle.mass * 1.0, rel=0.05)
    assert moves == pytest.approx(-0.4 * vehicle.mass * 3.0, rel=0.1)
    assert stands == pytest.approx(moves, rel=0.1)
    assert let_go == pytest.approx(vehicle.mass * 1.0, rel=0.05)  # what is left to hold it is the drive


@pytest.mark.parametrize(("shaken", "left"), [((0.5, 0.5), 0.2), ((0.0, 0.5), 0.87)])
def test_what_a_rough_road_shakes_is_no_lateral_force(
    vehicle: Vehicle, shaken: tuple[float, float], left: float
) -> None:
    """.4 m/s² at 5 Hz, on 2 m/s² that last; where only the body's side is shaken, somebody steers
    swiftly, of which sensors' noise takes an eighth."""
    meter, zero, state, told = ForceMeter(vehicle, []), jnp.zeros(8), None, []
    for k in range(200):
        accel = 2.0 + 0.4 * np.sin(2 * np.pi * 5.0 * k * STEP)
        value = zero.at[ACCEL_Y].set(accel).at[SPIN].set(SPEED / vehicle.wheels.radius)
        shaking, fresh = jnp.asarray(shaken), jnp.ones(8, bool)
        signals = Signals(
            value, zero, fresh, value, zero, zero, zero, value, zero, shaking, jnp.zeros(8, bool)
        )
        now = meter.init() if state is None else state
        speed, still = jnp.asarray(SPEED), jnp.zeros(())
        state, forces = read(meter, now, {}, signals, speed, jnp.zeros(2), still, jnp.asarray(STEP))
        told.append(float(jnp.sum(forces.now.across)) / vehicle.mass)
    last = np.array(told[100:])
    assert last.mean() == pytest.approx(2.0, rel=0.03)
    assert last.std() / (0.4 / 2**0.5) == pytest.approx(left, abs=0.05)


@pytest.mark.parametrize("speed", [SPEED, -SPEED])
def test_a_lateral_force_acts_a_trail_behind_its_axle_as_the_car_moves(
    vehicle: Vehicle, speed: float
) -> None:
    """A steady bend, no force along: two levers, of which that of the axle ahead is the longer one."""
    meter, accel = ForceMeter(vehicle, ()), 2.0
    resists = operator.attrgetter("balance.car.rolling_resistance", "balance.car.rolling_resistance_speed")
    meter = eqx.tree_at(resists, meter, [jnp.zeros_like(x) for x in resists(meter)])
    zero = jnp.zeros(8)
    value = zero.at[ACCEL_Y].set(accel).at[SPIN].set(speed / vehicle.wheels.radius)
    signals = Signals(
        value, zero, jnp.ones(8, bool), value, zero, zero, zero, value, zero, jnp.zeros(2), jnp.zeros(8, bool)
    )
    still = jnp.zeros(())
    told = read(meter, meter.init(), {}, signals, jnp.asarray(speed), jnp.zeros(2), still, jnp.asarray(STEP))[
        1
    ]
    geometry, trail = vehicle.geometry, 0.03 * (1 - abs(accel) / GRAVITY) * np.sign(speed)
    levers = np.array([geometry.cg_to_rear_axle + trail, geometry.cg_to_front_axle - trail])
    share = levers / vehicle.wheelbase
    np.testing.assert_allclose(np.asarray(told.across), share * vehicle.mass * accel, rtol=2e-3)
