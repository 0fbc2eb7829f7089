"""Wheels whose rolling radii differ: worn tires, a new one, a spare."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.core import WHEELS, Estimates, Log
from roadstate.core.constants import GRAVITY
from roadstate.estimators import build
from roadstate.estimators.intake import ACCEL_Y, SPIN, WHEEL_SPEEDS, YAW_RATE, Signals
from roadstate.estimators.radii import Radii, RadiiState
from roadstate.estimators.signals import NEVER
from roadstate.run import batch
from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]
DT = 0.01
CASES = {
    "alike": np.zeros(4),
    "rear smaller": np.array([-0.01, -0.01, 0.01, 0.01]),
    "one worn": np.array([0.0, 0.0, 0.02, 0.0]),
    "another size": np.array([0.04, 0.0, 0.0, 0.0]),
}
FASTER = np.array([0.0, 0.01, -0.02, 0.03])


def signals(
    radii: Radii,
    rim: Array,
    *,
    across: float = 0.0,
    steer: float = 0.0,
    age: float = 0.0,
    blind: bool = False,
) -> Signals:
    """Of wheels that roll at so many m/s each, as the file's radius has it; ``blind``: of nothing else."""
    smooth = np.zeros(8)
    smooth[ACCEL_Y], smooth[SPIN] = across, rim / float(radii.radius)
    now, zero = jnp.asarray(smooth), jnp.zeros(8)
    others = zero.at[np.array([ACCEL_Y, YAW_RATE])].set(NEVER if blind else 0.0)
    return Signals(
        value=now, age=age + others, is_fresh=jnp.ones(8, bool), smooth=now, rate=zero, lag=zero, noise=zero,
        now=now, now_rate=zero, shaken=jnp.zeros(2), is_faulty=jnp.zeros(8, bool),
    )  # fmt: skip


def learned(
    radii: Radii,
    rim: Array,
    seconds: float,
    slip: float = 0.0,
    turning: float = 0.0,
    noise: float = 0.0,
    **other: float,
) -> RadiiState:
    """After that long at one speed."""
    return jax.tree.map(lambda path: path[-1], driven(radii, rim, seconds, slip, turning, noise, **other))


def driven(
    radii: Radii, rim: Array, seconds: float, slip: float, turning: float, noise: float, **other: float
) -> RadiiState:
    """The state after each sample of it."""
    seen, slips, turns = signals(radii, rim, **other), jnp.full(4, slip), jnp.asarray(turning)
    smooth = jnp.zeros(4), jnp.full(4, noise)

    def step(state: RadiiState, _: None) -> tuple[RadiiState, RadiiState]:
        new = radii.learn(
            state, radii.even(state, seen), slips, jnp.zeros(()), turns, *smooth, jnp.asarray(DT)
        )
        return new, new

    return jax.lax.scan(step, radii.init(), None, length=round(seconds / DT))[1]


def test_wheels_that_roll_freely_are_told_apart(vehicle: Vehicle) -> None:
    radii = Radii(vehicle, WHEEL_SPEEDS)
    state = learned(radii, 20 * (1 + FASTER), 5.0)
    assert bool(radii.is_known(state))
    middle = (1 + FASTER) / (1 + np.sort(FASTER)[1:3].mean())
    np.testing.assert_allclose(1 + np.asarray(state.faster), middle, atol=5e-4)
    even = np.asarray(radii.even(state, signals(radii, 20 * (1 + FASTER))).value[SPIN])
    np.testing.assert_allclose(even, even.mean(), rtol=5e-4)


def test_the_longer_they_roll_the_more_is_known(vehicle: Vehicle) -> None:
    radii = Radii(vehicle, WHEEL_SPEEDS)
    some, more = (learned(radii, np.full(4, 20.0), seconds).known for seconds in (1.0, 30.0))
    assert (np.asarray(more) > 10 * np.asarray(some)).all()


def test_noise_tells_less_and_upsets_nothing(vehicle: Vehicle) -> None:
    """Of white noise an average over so long has left little; until then nothing is taken for wrong."""
    radii = Radii(vehicle, WHEEL_SPEEDS)
    sure, unsure = (driven(radii, 10 * (1 + FASTER), 1.0, 0.0, 0.0, noise) for noise in (0.0, 0.5))
    assert (np.asarray(unsure.known[-1]) < 0.3 * np.asarray(sure.known[-1])).all()
    moved = [np.asarray(jax.vmap(radii.has_moved)(states)) for states in (sure, unsure)]
    assert moved[0].any()
    assert not moved[1].any()


def test_a_bend_is_no_difference(vehicle: Vehicle) -> None:
    """The wheels' tracks differ by r T, which the yaw rate tells."""
    radii = Radii(vehicle, WHEEL_SPEEDS)
    turning, speed = 0.1, 15.0
    rim = speed - np.asarray(radii.half_track) * turning
    np.testing.assert_allclose(
        np.asarray(learned(radii, rim, 10.0, turning=turning, across=1.5).faster), 0.0, atol=1e-6
    )


@pytest.mark.parametrize("rear", [0.0, 0.01])
def test_nor_is_one_that_only_wheels_tell(vehicle: Vehicle, rear: float) -> None:
    """What differs from side to side is a bend then; from axle to axle it is a radius all the same."""
    radii = Radii(vehicle, WHEEL_SPEEDS)
    rim = 15.0 * (1 + np.array([0.0, 0.0, rear, rear]))
    straight, bend = (
        np.asarray(learned(radii, rim - np.asarray(radii.half_track) * turning, 20.0, blind=True).faster)
        for turning in (0.0, 0.12)
    )
    np.testing.assert_allclose(bend, straight, atol=1e-4)
    np.testing.assert_allclose(bend[2:] - bend[:2], rear, atol=5e-4)


@pytest.mark.parametrize(
    "how",
    [{"slip": 0.02}, {"across": 4.0}, {"age": 1.0}],
    ids=["under drive", "in a sharp bend", "silent"],
)
def test_what_tells_nothing(vehicle: Vehicle, how: dict[str, float]) -> None:
    radii = Radii(vehicle, WHEEL_SPEEDS)
    state = learned(radii, 20 * (1 + FASTER), 5.0, **how)
    np.testing.assert_array_equal(np.asarray(state.faster), 0.0)
    assert not bool(radii.is_known(state))


@pytest.mark.parametrize("speed", [5.0, 8.0, 20.0])
@pytest.mark.parametrize("across", [0.5, 0.8, 1.5])
def test_a_yaw_rate_that_lies_makes_no_difference(vehicle: Vehicle, speed: float, across: float) -> None:
    """One whose sign is wrong, or that is stuck at none: else its witnesses would soon agree with it."""
    radii = Radii(vehicle, WHEEL_SPEEDS)
    rim = speed - np.array(vehicle.geometry.half_tracks) * across / speed
    for lie in (-1.0, 0.0 if across > 0.8 else -1.0):
        state = learned(radii, rim, 2.0, turning=lie * across / speed, across=across)
        assert np.max(np.abs(state.faster)) == 0.0
    right = learned(radii, rim, 2.0, turning=across / speed, across=across)
    assert float(right.known.min()) > 5e4


@pytest.mark.parametrize("rim", [[2.0, 2.1, 2.0, 2.0], [20.0, 26.0, 20.0, 20.0]], ids=["slow", "spinning"])
def test_wheels_that_may_slip(vehicle: Vehicle, rim: list[float]) -> None:
    radii = Radii(vehicle, WHEEL_SPEEDS)
    np.testing.assert_array_equal(np.asarray(learned(radii, np.array(rim), 5.0).faster), 0.0)


def test_one_wheel_alone_has_none_to_differ_from(vehicle: Vehicle) -> None:
    radii = Radii(vehicle, ["wheel_speed_rl"])
    assert bool(radii.is_known(radii.init()))


@pytest.fixture(scope="module")
def log(vehicle: Vehicle, drive: Callable[..., Log]) -> Log:
    """Up and down a hill, faster and slower, with tires that slip in proportion to their forces."""
    time = np.arange(0, 60, DT)
    grade = 0.03 * np.sin(time / 7)
    log = drive(17 + 6 * np.cos(time / 5), grade)
    rng = np.random.default_rng(0)
    noise = {"accel_x": 0.05, "accel_y": 0.05, "yaw_rate": 0.002, "steer": 0.001, "pitch_rate": 0.003}
    channels = {name: rng.normal(0, std, len(time)) for name, std in noise.items()}
    channels["accel_x"] += log["accel_x"]
    channels["pitch_rate"] -= np.gradient(grade, time)
    per_force = 4 / (vehicle.wheels.radius * vehicle.tires.slip_stiffness * vehicle.mass * GRAVITY)
    wheels = {}
    for w in WHEELS:
        drives = log[f"drive_torque_{w}"] if w in ("fl", "fr") else 0.0
        slip = per_force * (drives - log[f"brake_torque_{w}"])
        wheels[f"wheel_speed_{w}"] = (1 + slip) * log[f"wheel_speed_{w}"] + rng.normal(0, 0.05, len(time))
    return log.with_channels(channels | wheels)


@pytest.fixture(scope="module")
def estimates(vehicle: Vehicle, log: Log) -> dict[str, Estimates]:
    def turning(faster: Array) -> Log:
        shares = dict(zip(WHEELS, 1 + faster, strict=True))
        return log.with_channels({f"wheel_speed_{w}": f * log[f"wheel_speed_{w}"] for w, f in shares.items()})

    joint, logs = build("joint", vehicle, log.available), [turning(faster) for faster in CASES.values()]
    return dict(zip(CASES, batch([joint] * len(logs), logs), strict=True))


@pytest.mark.parametrize("case", list(CASES))
def test_no_sound_sensor_is_called_faulty(estimates: dict[str, Estimates], case: str) -> None:
    assert estimates[case].metadata.get("faults", []) == []


@pytest.mark.parametrize("case", list(CASES))
def test_differences_cost_nothing(log: Log, estimates: dict[str, Estimates], case: str) -> None:
    """Neither the grade nor the speed, which the middle ones tell; and they are no slip as on ice."""
    from_on = slice(1000, None)
    usual, said = estimates["alike"], estimates[case]

    def rmse(of: Estimates, quantity: str, reference: str) -> float:
        return float(np.sqrt(np.mean((of.values[quantity] - log[reference])[from_on] ** 2)))

    assert rmse(said, "grade", "ref_grade") < 1.3 * rmse(usual, "grade", "ref_grade") + 2e-4
    assert rmse(said, "speed", "ref_velocity_x") < 0.15
    more = said.values["friction_peak_upper"] / usual.values["friction_peak_upper"]
    assert (more[from_on] > 0.8).all()
