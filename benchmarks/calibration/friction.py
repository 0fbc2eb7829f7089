"""Does friction come out better with what was learned of the tires on other drives?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from benchmarks.accuracy.groups.base import SATELLITE, Runs
from benchmarks.accuracy.groups.friction import Friction
from benchmarks.accuracy.scenarios import SCENARIOS, Scenario, logs, named, on_plant
from benchmarks.accuracy.score import Score

from roadstate.calibration import Calibration, calibrate, learned_yaml
from roadstate.calibration.parameters import with_value
from roadstate.core import InputError, Log
from roadstate.estimators import build
from roadstate.run import batch
from roadstate.sim.manoeuvres import KMH
from roadstate.vehicles import Vehicle, load_vehicle, parse_vehicle, vehicle_text

ASPHALT = 0.8
LEARNED_FROM = ("double-lane-change-85-0.8", "straight-0.8")
HELD_OUT = (
    *("circle", "double-lane-change-48-0.4", "straight-0.4", "straight-0.2"),
    *("joint-acceleration-0.8-0.2", "joint-braking-0.2-0.8"),
)
GRIPPY = 1.0
GRIPPIER = tuple(
    Scenario(f"{name}-{GRIPPY}", title, named(name, speed=speed, friction=GRIPPY))
    for name, title, speed in (
        ("constant-radius", "100 m radius, rising to 80 % of the friction", 60 * KMH),
        ("double-lane-change", "double lane change at 85 km/h", 85 * KMH),
    )
)
"""Drives on a road that bears more than the one that was learned from."""
TOLD, OWN, SHAPE, ROAD = "as told", "plant's own", "shape 1.6", "asphalt known"
LEARNED: Mapping[str, tuple[str, ...]] = {
    "friction learned": ("friction",),
    "tires as well": ("friction", "tire", "slip"),
}
"""Vehicle file → the groups of figures learned for it."""
FILES = (TOLD, *LEARNED, OWN, SHAPE, ROAD)
"""Vehicle files: see :func:`_files`."""
_ESTIMATOR = "joint"
_STIFFNESSES = ("cornering_stiffness_front", "cornering_stiffness_rear", "slip_stiffness")
Progress = Callable[[str], None]


@dataclass
class Found:
    """What came out.

    Attributes:
        held_out: scores on drives that nothing was learned from, ``estimator`` being the vehicle file.
        again: on the drives it was learned from, recorded by another seed's sensors.
        grippier: on a road that bears more.
        learned: (file, figure, vehicle) → values, and the 1σ stated.
        refused: (file, figure, vehicle) → how often.
    """

    held_out: list[Score]
    again: list[Score]
    grippier: list[Score]
    learned: dict[tuple[str, str, str], list[tuple[float, float]]] = field(default_factory=dict)
    refused: Counter[tuple[str, str, str]] = field(default_factory=Counter)


def study(vehicles: Sequence[str], seeds: int, cache: Path | None, progress: Progress) -> Found:
    """Learn each seed's friction of dry roads and tires from two drives, then estimate friction on others.

    Args:
        vehicles: names of presets.
        seeds: cars of each.
        cache: folder for logs, see :func:`benchmarks.accuracy.scenarios.logs`.
        progress: told what is being done.

    Raises:
        InputError: a car leaves the road.
    """
    found = Found([], [], [])
    held_out, again = Friction(by_drive=True), Friction()
    grippier = Friction(drives=[scenario.name for scenario in GRIPPIER])
    for name in vehicles:
        vehicle = load_vehicle(name)
        drives = {drive: _logs(name, drive, seeds, cache) for drive in (*LEARNED_FROM, *HELD_OUT)}
        files: list[Mapping[str, Vehicle]] = []
        for seed in range(seeds):
            progress(f"{name}: tires, seed {seed}")
            told = drives[LEARNED_FROM[0]][seed][1]
            files.append(_files(vehicle, told, {d: drives[d][seed][0] for d in LEARNED_FROM}, found))
        for drive, recordings in drives.items():
            progress(f"{name}: {drive}")
            own = [log for log, _ in recordings]
            if drive in LEARNED_FROM:
                own = [*own[1:], own[0]]  # another seed's sensors
            _run(again if drive in LEARNED_FROM else held_out, vehicle, drive, own, files, FILES)
        for scenario in GRIPPIER:
            progress(f"{name}: {scenario.name}")
            own = [log for log, _ in on_plant(name, scenario, seeds)]
            _run(grippier, vehicle, scenario.name, own, files, (TOLD, *LEARNED))
    found.held_out, found.again = held_out.scores(), again.scores()
    found.grippier = grippier.scores()
    return found


def _run(
    group: Friction,
    vehicle: Vehicle,
    drive: str,
    own: Sequence[Log],
    files: Sequence[Mapping[str, Vehicle]],
    names: Sequence[str],
) -> None:
    """Estimate with some of each seed's vehicle files, and add what comes out to a group."""
    for file in names:
        cars = [each[file] for each in files]
        built = [build(_ESTIMATOR, car, log.available) for car, log in zip(cars, own, strict=True)]
        group.add(Runs(vehicle, drive, SATELLITE, file, own, cars, batch(built, own)))


def _logs(vehicle: str, drive: str, seeds: int, cache: Path | None) -> list[tuple[Log, Vehicle]]:
    # a long drive is recorded with a fifth of the seeds asked for
    return logs(vehicle, drive, 5 * seeds if SCENARIOS[drive].is_long else seeds, cache)[:seeds]


def _files(vehicle: Vehicle, told: Vehicle, drives: Mapping[str, Log], found: Found) -> dict[str, Vehicle]:
    """The vehicle files that are compared: three that one can have, three that tell a cause.

    As told; with the friction of dry roads learned, and the tires as well; with the plant's own stiffnesses;
    with the shape that turns out best; with the friction of the asphalt for that of dry roads.
    """
    own, sure = told, ("prior", "stiffness_relative")
    for figure in _STIFFNESSES:
        own = with_value(own, ("tires", figure), getattr(vehicle.tires, figure))
    shape = with_value(with_value(told, ("tires", "shape"), 1.6), ("prior", "tire_shape_std"), 0.05)
    road = with_value(told, ("tires", "friction"), ASPHALT)
    return {
        TOLD: told,
        **{file: _learned(vehicle, told, drives, file, found) for file in LEARNED},
        OWN: with_value(own, sure, 0.03),
        SHAPE: shape,
        ROAD: with_value(road, ("prior", "friction_relative"), 0.03),
    }


def _learned(vehicle: Vehicle, told: Vehicle, drives: Mapping[str, Log], file: str, found: Found) -> Vehicle:
    try:
        fit = calibrate(told, drives, LEARNED[file], estimator=_ESTIMATOR)
    except InputError:
        found.refused[file, "everything", vehicle.name] += 1
        return told
    for one in fit.learned:
        key = file, one.parameter.name, vehicle.name
        found.learned.setdefault(key, []).append((one.value, one.std))
    for name in fit.refused:
        found.refused[file, name, vehicle.name] += 1
    return _written(vehicle, fit)


def _written(vehicle: Vehicle, fit: Calibration) -> Vehicle:
    """As the new file has it: the learned figures, and the uncertainties written beside them."""
    text = learned_yaml(vehicle_text(vehicle.name), vehicle.name, fit)
    return fit.vehicle.model_copy(update={"prior": parse_vehicle(text, vehicle.name).prior})


def mean_of(values: Sequence[tuple[float, float]]) -> tuple[float, float, float]:
    """Mean and standard deviation of figures over seeds, and the mean 1σ stated."""
    figures, stds = np.array(values).T
    return float(figures.mean()), float(figures.std()), float(stds.mean())
