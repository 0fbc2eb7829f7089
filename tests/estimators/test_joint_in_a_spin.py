"""A car that spins turns otherwise than it is steered and pushed aside, and all its sensors are sound."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from roadstate.core import WHEELS, Estimates, Log
from roadstate.core.quantities import reference
from roadstate.estimators import build
from roadstate.estimators.contact_forces import ForceMeter
from roadstate.estimators.intake import ACCEL_Y, SPIN, STEER, YAW_RATE, Signals
from roadstate.estimators.redundancy import TELLINGS, Redundancy, Slide, Tellings
from roadstate.estimators.signals import Held
from roadstate.papers.base import MISMATCHED
from roadstate.papers.plants import told
from roadstate.run import batch
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.plant import multibody_plant
from roadstate.sim.run import drive, truth_table
from roadstate.sim.sensors import measure, sensor_preset, to_log
from roadstate.vehicles import Vehicle

SATELLITE = {"speed", "altitude", "vertical_speed", "latitude", "longitude"}
SPEED = 20.0


@pytest.fixture(scope="module")
def spins(vehicle: Vehicle) -> list[tuple[Log, Estimates]]:
    """Sine with dwell on half of a dry road's friction: sideslip grows to 45°."""
    script = manoeuvre("sine-with-dwell").prepare(vehicle, friction=0.5)
    table = truth_table(drive(multibody_plant(vehicle), script, vehicle, rate=200.0))
    logs = [to_log(measure(table, sensor_preset("automotive"), seed=s, metadata={})) for s in (0, 1)]
    channels = [c for c in logs[0].available if c not in SATELLITE]
    cars = [build("joint", told(vehicle, MISMATCHED, s), channels) for s in (0, 1)]
    return list(zip(logs, batch(cars, logs), strict=True))


def error(log: Log, said: Estimates, quantity: str) -> np.ndarray:
    true = reference(quantity, log.channels)
    assert true is not None
    return said.values[quantity] - true


def test_no_sound_sensor_is_called_faulty(spins: list[tuple[Log, Estimates]]) -> None:
    for log, said in spins:
        largest = np.abs(np.arctan2(log["ref_velocity_y"], log["ref_velocity_x"])).max()
        assert largest > np.radians(40)  # it does spin
        assert said.metadata.get("faults", []) == []
        assert (said.labels() != "sensor_fault").all()


@pytest.mark.parametrize(("quantity", "most"), [("velocity_y", 0.8), ("speed", 0.6), ("friction_used", 0.04)])
def test_the_motion_is_known_to_its_end(
    spins: list[tuple[Log, Estimates]], quantity: str, most: float
) -> None:
    """v_y of up to 10 m/s, of which the last seconds' are integrated."""
    for log, said in spins:
        off = error(log, said, quantity)[100:]
        assert np.sqrt(np.mean(off**2)) < most
        assert np.mean(np.abs(off) < 3 * said.std[quantity][100:]) > 0.9


def test_a_receiver_tells_where_the_car_goes_not_where_it_points(
    vehicle: Vehicle, spins: list[tuple[Log, Estimates]]
) -> None:
    """At 45° of sideslip v_x is 0.7 of the speed over ground; to its own channels that is no fault."""
    cars = [build("joint", told(vehicle, MISMATCHED, s), log.available) for s, (log, _) in enumerate(spins)]
    logs = [log for log, _ in spins]
    for log, said in zip(logs, batch(cars, logs), strict=True):
        apart = np.abs(log["speed"] - log["ref_velocity_x"])
        assert np.nanmax(apart) > 3.0
        off, std = error(log, said, "speed")[100:], said.std["speed"][100:]
        assert np.sqrt(np.mean(off**2)) < 0.4
        assert np.mean(np.abs(off) < 3 * std) > 0.9
        assert said.metadata["faults"] == []


def test_friction_stays_known(spins: list[tuple[Log, Estimates]]) -> None:
    for log, said in spins:
        late = log.time > 3.5
        assert (np.abs(said.values["friction_peak"] - 0.5)[late] < 0.06).all()
        assert (said.values["friction_peak_lower"][late] < 0.5).all()
        assert (said.values["friction_peak_upper"][late] > 0.5).all()


def tellings(
    vehicle: Vehicle,
    *,
    turns: float,
    pairs: float,
    aside: float,
    steered: float,
    slides: float = 0.0,
    slid: float = 0.0,
    swept: float = 0.0,
    velocity_y: float = 0.0,
    friction: float = 0.9,
) -> Tellings:
    """Of sensors at 20 m/s that lead to yaw rates (rad/s) of so much."""
    channels = [f"wheel_speed_{w}" for w in WHEELS] + ["accel_x", "accel_y", "yaw_rate", "steer"]
    redundancy = Redundancy(vehicle, [*channels, "gear_ratio"])
    half = 0.5 * pairs * np.array([-1, 1, -1, 1]) * np.repeat(np.asarray(redundancy.track), 2)
    demand = SPEED / (float(redundancy.wheelbase) + float(redundancy.understeer) * SPEED**2)
    smooth = np.zeros(8)
    smooth[SPIN] = (SPEED + half) / vehicle.wheels.radius
    smooth[ACCEL_Y], smooth[YAW_RATE], smooth[STEER] = aside * SPEED, turns, steered / demand
    zero = jnp.zeros(8)
    now = jnp.asarray(smooth)
    seen = Signals(
        value=now, age=zero, is_fresh=jnp.ones(8, bool), smooth=now, rate=zero, lag=zero, noise=zero, now=now,
        now_rate=zero, shaken=jnp.zeros(2), is_faulty=jnp.zeros(8, bool),
    )  # fmt: skip
    four, one = jnp.zeros(4), jnp.zeros(())
    lasted = {"lasts": slides, "slid": slid, "swept": swept}
    slide = Slide.none()._replace(**{k: jnp.asarray(v) for k, v in lasted.items()})
    return eqx.filter_jit(redundancy.tell)(
        seen, ForceMeter(vehicle, channels).nothing(), Held.empty(), one, four, four, slide,
        jnp.asarray(SPEED), jnp.asarray(velocity_y), jnp.asarray(friction), jnp.asarray(0.01),
    )  # fmt: skip


def speaks(found: Tellings, name: str) -> bool:
    return bool(np.isfinite(found.std[TELLINGS.index(name)]))


def test_a_spin_silences_what_it_contradicts(vehicle: Vehicle) -> None:
    found = tellings(vehicle, turns=0.45, pairs=0.43, aside=0.24, steered=-0.1)
    assert float(found.slide.lasts) > 0
    assert not any(speaks(found, name) for name in ("accel_y", "steer", "wheels_accel"))
    assert all(speaks(found, name) for name in ("yaw_rate", "front_pair", "rear_pair"))
    assert not bool(found.answers[TELLINGS.index("yaw_rate")])


def test_what_does_not_turn_the_car_moves_it_aside_and_not_for_long(vehicle: Vehicle) -> None:
    spins = {"turns": 0.45, "pairs": 0.43, "aside": 0.24, "steered": -0.1}
    assert float(tellings(vehicle, **spins, slid=3.5).slide.lasts) > 0
    lasted = tellings(vehicle, **spins, slid=4.5)
    assert float(lasted.slide.lasts) == 0
    assert float(lasted.slide.slid) == pytest.approx(4.51)
    assert all(speaks(lasted, name) for name in ("accel_y", "steer", "yaw_rate"))
    grips = {"turns": 0.1, "pairs": 0.1, "aside": 0.1, "steered": 0.1}
    assert float(tellings(vehicle, **grips, slid=4.5).slide.slid) == pytest.approx(4.49)


def test_a_car_on_a_banked_track_does_not_spin(vehicle: Vehicle) -> None:
    """It is steered as its geometry and its lateral specific force ask for, which is not v r."""
    redundancy = Redundancy(vehicle, [*(f"wheel_speed_{w}" for w in WHEELS), "gear_ratio"])
    turns, aside = 0.45, 0.2
    understeer = float(redundancy.understeer) * SPEED**2
    steered = (turns * float(redundancy.wheelbase) + aside * understeer) / (
        float(redundancy.wheelbase) + understeer
    )
    assert float(tellings(vehicle, turns=turns, pairs=0.43, aside=aside, steered=steered).slide.lasts) == 0
    # of a level bend such steering would be short by less than that of a spin, or by more
    far = tellings(vehicle, turns=turns, pairs=0.43, aside=aside, steered=steered - 0.2)
    assert float(far.slide.lasts) > 0


def test_what_ice_does_not_hold_need_not_come_about(vehicle: Vehicle) -> None:
    """Of 2.4 m/s² that it is steered for, a dry road holds 1.5, ice of .1 the half of one."""
    bend = {"turns": 0.05, "pairs": 0.05, "aside": 0.05, "steered": 0.12}
    place = TELLINGS.index("steer")
    dry, icy = (tellings(vehicle, **bend, friction=mu).std[place] for mu in (0.9, 0.1))
    share, beyond = 0.25 * 0.12, 0.5 * (0.12 - 0.6 * 0.1 * 9.80665 / SPEED)
    assert float(icy) > np.hypot(share, beyond)
    assert float(icy) > 1.2 * float(dry)
    assert float(dry) == pytest.approx(float(tellings(vehicle, **bend, friction=0.3).std[place]))


@pytest.mark.parametrize(
    "lies", [{"turns": -0.4}, {"aside": -0.4}, {"steered": 0.0}, {"pairs": -0.4}], ids="-".join
)
def test_one_that_lies_is_no_spin(vehicle: Vehicle, lies: dict[str, float]) -> None:
    found = tellings(vehicle, **{"turns": 0.4, "pairs": 0.4, "aside": 0.4, "steered": 0.4} | lies)
    assert float(found.slide.lasts) == 0
    assert all(speaks(found, name) for name in ("yaw_rate", "accel_y", "steer"))


def test_a_driver_who_steers_against_a_slide(vehicle: Vehicle) -> None:
    """All else agrees that the car turns left, while it is steered to the right."""
    against = {"turns": 0.28, "pairs": 0.3, "aside": 0.2, "steered": -0.2}
    grips = tellings(vehicle, **against, velocity_y=-0.5)
    assert speaks(grips, "steer")
    slides = tellings(vehicle, **against, velocity_y=-2.5, swept=-1.5)
    assert not speaks(slides, "steer")
    assert speaks(tellings(vehicle, **against, velocity_y=-2.5), "steer")  # which has never moved aside
    assert all(speaks(slides, name) for name in ("yaw_rate", "accel_y", "front_pair", "rear_pair"))


def test_a_spin_is_over_after_a_while(vehicle: Vehicle) -> None:
    usual = {"turns": 0.1, "pairs": 0.1, "aside": 0.1, "steered": 0.1}
    left = float(tellings(vehicle, **usual, slides=1.0).slide.lasts)
    assert left == pytest.approx(0.99)
    assert not speaks(tellings(vehicle, **usual, slides=1.0), "steer")
    assert speaks(tellings(vehicle, **usual, slides=0.005), "steer")
