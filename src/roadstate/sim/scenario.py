"""From a vehicle to a log: a drive on paper 002's ramp, measured."""

from __future__ import annotations

from typing import TYPE_CHECKING

from roadstate.core import Log
from roadstate.sim.drive import SpeedPlan, follow
from roadstate.sim.driver import Driver
from roadstate.sim.road import GradeProfile, interchange_ramp
from roadstate.sim.sensors import SensorNoise, measure

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle


def simulate(
    vehicle: Vehicle,
    plan: SpeedPlan | None = None,
    *,
    road: GradeProfile | None = None,
    seed: int = 0,
    noise: SensorNoise | None = None,
) -> Log:
    """Drive a vehicle along a road by the longitudinal point-mass model and measure it at 100 Hz.

    Args:
        vehicle: the car.
        plan: its speed over time; default :meth:`SpeedPlan.variable`.
        road: default :func:`interchange_ramp`.
        seed: of the sensors' noise; the same seed gives the same bits.
        noise: default :class:`SensorNoise`.

    Raises:
        InputError: the vehicle has an engine but no gear ratios.
    """
    plan = plan if plan is not None else SpeedPlan.variable()
    road = road if road is not None else interchange_ramp()
    truth = follow(Driver.from_vehicle(vehicle), road, plan)
    return measure(truth, vehicle, seed=seed, noise=noise)
