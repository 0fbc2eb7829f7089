"""The drives of the accuracy benchmark, and their logs: a plant, production sensors, a file that is off.

``logs("family-car", "double-lane-change-85-0.8", 20)`` is all that a study needs: twenty recordings of one
drive on the multibody plant (anti-lock and traction control on), each with its own sensors' errors and with
its own vehicle file, the figures of which are off by 5 to 10 %.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

import roadstate
from roadstate.core import InputError, Log
from roadstate.core.channels import did_you_mean
from roadstate.papers.base import MISMATCHED, Condition
from roadstate.papers.plants import drive_on, recordings, told
from roadstate.sim.facts import off_path
from roadstate.sim.manoeuvres import KMH, Manoeuvre, Script, manoeuvre
from roadstate.sim.manoeuvres.path import straight
from roadstate.sim.manoeuvres.roads import plain
from roadstate.sim.manoeuvres.script import STEP
from roadstate.sim.plant import multibody_plant
from roadstate.sim.plant.base import Plant
from roadstate.sim.roads.friction import FrictionMap, joint
from roadstate.sim.run import Drive
from roadstate.sim.sensors import sensor_preset
from roadstate.sim.speed_plan import SpeedPlan
from roadstate.vehicles import Vehicle, load_vehicle

VEHICLES = ("family-car", "suv", "in-wheel-ev")
"""Front-wheel drive with a gearbox, all-wheel drive with a heavy body, a motor in each wheel."""
SATELLITE = ("latitude", "longitude", "altitude", "vertical_speed", "speed")
"""Channels that the receiver gives; a bus has none of them."""
_FEW = 5  # one in so many seeds, and three at least, of what takes long
_LANE = 1.75  # m: half a lane; a car whose centre is farther from its path has left the road
_SOURCES = ("sim", "vehicles", "tires", "papers/plants.py", "core/signals.py")


@dataclass(frozen=True)
class Scenario:
    """A drive.

    Attributes:
        name: for tables and the command line.
        title: one line.
        prepare: the manoeuvre, for a vehicle.
        is_long: over half a minute: recorded with few seeds only.
        wind: velocity of the air along the world's x and y, m/s.
        stability: whether stability control is on besides anti-lock and traction control.
    """

    name: str
    title: str
    prepare: Callable[[Vehicle], Manoeuvre]
    is_long: bool = False
    wind: tuple[float, float] = (0.0, 0.0)
    stability: bool = False


def few(seeds: int) -> int:
    """How many of so many seeds what takes long gets: a fifth, and three at least."""
    return min(seeds, max(3, -(-seeds // _FEW)))


class LeftTheRoad(InputError):
    """The car could not follow its path: there is nothing to estimate on that drive."""


def logs(
    vehicle: str | Vehicle, drive: str, seeds: int, cache: Path | None = None
) -> list[tuple[Log, Vehicle]]:
    """Recordings of one drive, each with the vehicle file that an estimator is to be told.

    Args:
        vehicle: that is driven.
        drive: one of :data:`SCENARIOS`.
        seeds: how many, from seed 0 on; of a long drive :func:`few` of them.
        cache: folder in which logs are kept as Parquet, and looked for; none without one.

    Raises:
        InputError: no such drive, one that breaks down, or a car that leaves the road.
    """
    if drive not in SCENARIOS:
        raise InputError(f"no drive is called '{drive}'", mend=did_you_mean(drive, SCENARIOS))
    scenario = SCENARIOS[drive]
    car = load_vehicle(vehicle) if isinstance(vehicle, str) else vehicle
    count = few(seeds) if scenario.is_long else seeds
    folder = None if cache is None else Path(cache) / _fingerprint() / car.name / drive
    made = None if folder is None else _load(folder, count)
    if made is None:
        made = _recorded(car, scenario, count)
        if folder is not None:
            _save(folder, made)
    return _with_files(car, made)


def on_plant(vehicle: str, scenario: Scenario, seeds: int) -> list[tuple[Log, Vehicle]]:
    """As :func:`logs`, of any scenario."""
    car = load_vehicle(vehicle)
    return _with_files(car, _recorded(car, scenario, seeds))


def _with_files(car: Vehicle, made: list[Log]) -> list[tuple[Log, Vehicle]]:
    return [(log, told(car, MISMATCHED, seed)) for seed, log in enumerate(made)]


def driven(vehicle: Vehicle, scenario: Scenario) -> Drive:
    """The drive as it was on the plant.

    Raises:
        InputError: it breaks down.
        LeftTheRoad: the car is more than half a lane off its path.
    """
    result = drive_on(_condition(vehicle, scenario), matched=True)
    apart = np.abs(off_path(result))
    if np.isfinite(apart).any() and np.nanmax(apart) > _LANE:
        raise LeftTheRoad(
            f"'{vehicle.name}' leaves the road on '{scenario.name}': {np.nanmax(apart):.1f} m off its path"
        )
    return result


def _recorded(vehicle: Vehicle, scenario: Scenario, seeds: int) -> list[Log]:
    return list(recordings(driven(vehicle, scenario), _condition(vehicle, scenario), MISMATCHED, seeds))


def _plant(vehicle: Vehicle, wind: tuple[float, float], stability: bool) -> Plant:
    return multibody_plant(
        vehicle, anti_lock=True, traction_control=True, stability_control=stability, wind=wind
    )


def _condition(vehicle: Vehicle, scenario: Scenario) -> Condition:
    sensors = sensor_preset("automotive")
    plant = partial(_plant, wind=scenario.wind, stability=scenario.stability)
    return Condition(scenario.name, scenario.title, vehicle, scenario.prepare, plant, sensors)


@cache
def _fingerprint() -> str:
    """Changes with whatever decides what a log holds."""
    home = Path(roadstate.__file__).parent
    files = [Path(__file__)]
    for source in _SOURCES:
        files += sorted((home / source).rglob("*.*")) if (home / source).is_dir() else [home / source]
    digest = hashlib.sha256()
    for file in files:
        if file.suffix in (".py", ".yaml"):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _load(folder: Path, seeds: int) -> list[Log] | None:
    """The logs kept in a folder; ``None`` where there are not as many."""
    files = [folder / f"{seed}.parquet" for seed in range(seeds)]
    truth_file = folder / "truth.parquet"
    if not (truth_file.is_file() and all(f.is_file() for f in files)):
        return None
    truth = Log.from_parquet(truth_file).channels
    return [Log.from_parquet(file).with_channels(truth) for file in files]


def _save(folder: Path, made: list[Log]) -> None:
    """The truth once, the sensors of each seed beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed, log in enumerate(made):
        log.select(set(log.channels) - set(log.references)).to_parquet(folder / f"{seed}.parquet")
    made[0].select(made[0].references).to_parquet(folder / "truth.parquet")


def named(name: str, **options: float) -> Callable[[Vehicle], Manoeuvre]:
    """One of the simulator's manoeuvres with some of its options, for a :class:`Scenario`."""
    return lambda vehicle: manoeuvre(name).prepare(vehicle, **options)


def in_town(seconds: float) -> Callable[[Vehicle], Manoeuvre]:
    """So much of the drive in town, from its beginning, for a :class:`Scenario`."""

    def prepare(vehicle: Vehicle) -> Manoeuvre:
        whole = manoeuvre("urban-drive").prepare(vehicle, friction=0.8)
        return replace(whole, script=Script(whole.script.table[: round(seconds / STEP) + 1]))

    return prepare


def straight_ahead(
    name: str, friction: FrictionMap | float, plan: SpeedPlan, **pedals: float
) -> Callable[[Vehicle], Manoeuvre]:
    """On a level road straight ahead, for a :class:`Scenario`; pedals as ``Script.write`` takes them."""

    def prepare(vehicle: Vehicle) -> Manoeuvre:
        script = Script.write(plan, **pedals)
        return Manoeuvre(name, name, plain(friction), plan.speed[0], script, straight())

    return prepare


def _growing(friction: float) -> SpeedPlan:
    """Speed up and brake three times, harder each time: to 30, 60 and 90 % of the friction."""
    time, speed = [0.0, 1.0], [5.0, 5.0]
    for share in (0.3, 0.6, 0.9):
        accel = share * friction * 9.81
        # a driven axle bears about half of the load
        for rate, target in ((0.5 * accel, min(5.0 + 5.0 * accel, 22.0)), (-accel, 5.0)):
            time.append(time[-1] + (target - speed[-1]) / rate)
            speed.append(target)
            time.append(time[-1] + 0.7)
            speed.append(target)
    return SpeedPlan(tuple(time), tuple(speed))


def _all() -> dict[str, Scenario]:
    found = [
        Scenario(name, f"{what} on the interchange ramp", named(name), is_long=True)
        for name, what in (
            ("straight-constant-speed", "straight at 9.7 m/s"),
            ("straight-variable-speed", "straight at changing speed, with a stop"),
            ("curve-variable-speed", "bends at changing speed, with a stop"),
        )
    ]
    for speed in (48.0, 85.0):
        for mu in (0.8, 0.4):
            name = f"double-lane-change-{speed:.0f}-{mu:g}"
            prepare = named("double-lane-change", speed=speed * KMH, friction=mu)
            found.append(Scenario(name, f"double lane change at {speed:.0f} km/h on {mu:g}", prepare))
    circle = named("constant-radius", speed=60 * KMH, friction=0.8)
    found.append(
        Scenario("circle", "100 m radius, 60 km/h and rising to 80 % of the friction 0.8", circle, True)
    )
    for mu in (0.8, 0.4, 0.2):
        name = f"straight-{mu:g}"
        title = f"three times speeding up and braking, harder each time, on {mu:g}"
        found.append(Scenario(name, title, straight_ahead(name, mu, _growing(mu)), is_long=True))
    for first, then in ((0.8, 0.2), (0.2, 0.8)):
        words = f"{first:g}-{then:g}"
        name = f"joint-acceleration-{words}"
        prepare = straight_ahead(
            name,
            joint([40.0 if first > then else 25.0], [first, then]),
            SpeedPlan.constant(25 * KMH, 7.0),
            throttle=0.9,
            pedals_from=0.5,
        )
        found.append(Scenario(name, f"nearly full throttle from 25 km/h, {first:g} then {then:g}", prepare))
        name = f"joint-braking-{words}"
        prepare = straight_ahead(
            name,
            joint([40.0 if first > then else 70.0], [first, then]),
            SpeedPlan.constant(20.0, 6.0),
            brake=0.5,
            pedals_from=1.0,
        )
        found.append(Scenario(name, f"braking for 6 m/s² from 20 m/s, {first:g} then {then:g}", prepare))
    for name in ("split-road", "split-road-braking"):
        title = manoeuvre(name).summary
        found.append(Scenario(name, title, named(name, friction=0.8)))
    found.append(Scenario("urban", "ten minutes in town on 0.8", in_town(600.0), is_long=True))
    return {s.name: s for s in found}


SCENARIOS: dict[str, Scenario] = _all()
"""The drives by name."""
QUICK = (
    *("curve-variable-speed", "double-lane-change-48-0.4", "double-lane-change-85-0.8"),
    *("joint-acceleration-0.8-0.2", "joint-braking-0.2-0.8"),
)
"""A few drives, for a glance."""
