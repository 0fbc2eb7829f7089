"""Recordings of a drive that a car is learned from: with production sensors, and with ideal ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import SATELLITE, SCENARIOS, Scenario, driven

from roadstate.core import Log
from roadstate.papers.base import MISMATCHED, Condition
from roadstate.papers.plants import recordings, told
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.plant import multibody_plant
from roadstate.sim.run import truth_table
from roadstate.sim.sensors import measure, sensor_preset, to_log
from roadstate.vehicles import Vehicle

SLALOM = Scenario("slalom", "eight cones 30 m apart, 55 km/h", lambda car: manoeuvre("slalom").prepare(car))


@dataclass(frozen=True)
class Recorded:
    """One drive on the multibody plant.

    Attributes:
        logs: of each seed, production sensors, no satellites.
        told: of each seed, the vehicle file whose figures are off.
        ideal: the same drive by sensors without errors.
    """

    logs: Sequence[Log]
    told: Sequence[Vehicle]
    ideal: Log


def recorded(vehicle: Vehicle, drive: str, seeds: int) -> Recorded:
    """Drive once, record with every seed's own sensors.

    Args:
        vehicle: that is driven.
        drive: of :data:`benchmarks.accuracy.scenarios.SCENARIOS`, or ``slalom``.
        seeds: how many.

    Raises:
        InputError: the drive breaks down, or the car leaves the road.
    """
    scenario = SLALOM if drive == SLALOM.name else SCENARIOS[drive]
    done = driven(vehicle, scenario)
    condition = Condition(
        drive, scenario.title, vehicle, scenario.prepare, multibody_plant, sensor_preset("automotive")
    )
    logs = [without(log, SATELLITE) for log in recordings(done, condition, MISMATCHED, seeds)]
    ideal = to_log(measure(truth_table(done), sensor_preset("ideal"), seed=0))
    return Recorded(
        logs,
        [told(vehicle, MISMATCHED, seed) for seed in range(seeds)],
        ideal.select(set(logs[0].channels) & set(ideal.channels)),
    )
