"""From a vehicle to a log: a drive on paper 002's ramp by the point-mass model, measured."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from roadstate.core import WHEELS, Log
from roadstate.core.channels import RATES
from roadstate.core.constants import GRAVITY
from roadstate.sim.drive import SAMPLE_STEP, Array, SpeedPlan, Truth, follow
from roadstate.sim.driver import Driver
from roadstate.sim.roads.grade import GradeProfile, interchange_ramp
from roadstate.sim.sensors.noise import SensorNoise
from roadstate.sim.sensors.suite import measure, to_log

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_HEADING = np.deg2rad(35.0)  # of the straight road, clockwise from north
_BRAKE_SHARES = (0.325, 0.175)  # of a front and a rear wheel
_DRIVE_SHARES = {"front": (0.5, 0.0), "rear": (0.0, 0.5), "all": (0.25, 0.25)}


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
    noise = noise if noise is not None else SensorNoise()
    truth = follow(Driver.from_vehicle(vehicle), road, plan)
    metadata = {
        "source": "simulated: a longitudinal point-mass model, not the full vehicle simulator",
        "vehicle": vehicle.name,
        "noise": asdict(noise),
    }
    recording = measure(truth_table(truth, vehicle), noise.suite(), seed=seed, metadata=metadata)
    return to_log(recording, 1 / SAMPLE_STEP)


def truth_table(truth: Truth, vehicle: Vehicle) -> dict[str, Array]:
    """What ideal sensors at the centre of gravity would read of a drive by the point-mass model.

    The body pitches by the vehicle's gradient k: with f = v̇ + g sin θ and φ = k f the accelerometer along it
    reads f cos φ + g cos θ sin φ. A wheel slips in proportion to its force, κ = F_x/(c_κ F_z), with the
    static load: R ω = (1 + κ) v.

    Args:
        truth: of T samples.
        vehicle: wheels, driven axle, slip stiffness and pitch gradient are used.
    """
    force = truth.acceleration + GRAVITY * np.sin(truth.grade)
    pitch = vehicle.body.pitch_gradient * force
    normal = GRAVITY * np.cos(truth.grade)
    none = np.zeros(len(truth.time))
    table: dict[str, Array] = {
        "time": truth.time,
        "accel_x": force * np.cos(pitch) + normal * np.sin(pitch),
        "accel_y": none,
        "accel_z": normal * np.cos(pitch) - force * np.sin(pitch),
        **dict.fromkeys(RATES, none),
        "brake": truth.brake,
        # along the level: on these grades the road's own length differs from it by less than 0.3 %
        "north": truth.distance * np.cos(_HEADING),
        "east": truth.distance * np.sin(_HEADING),
        "altitude": truth.altitude,
        "ref_grade": truth.grade,
        "ref_velocity_x": truth.velocity,
    }
    if vehicle.driveline.kind == "engine":
        table |= {
            "engine_torque": truth.engine_torque,
            "engine_speed": truth.engine_speed,
            "gear_ratio": truth.gear_ratio,
        }
    # what spins up the engine does not reach the wheels
    spin_up = vehicle.driveline.engine_inertia * truth.total_ratio**2 * truth.acceleration
    drive_torque = truth.drive_torque - spin_up / vehicle.wheels.radius
    for i, wheel in enumerate(WHEELS):
        axle = i // 2
        drive = _DRIVE_SHARES[vehicle.driveline.driven][axle] * drive_torque
        brake = _BRAKE_SHARES[axle] * np.where(truth.brake > 0, truth.brake_torque, 0.0)
        load = vehicle.static_axle_loads[axle] / 2
        slip = (drive - brake) / vehicle.wheels.radius / (vehicle.tires.slip_stiffness * load)
        table[f"wheel_speed_{wheel}"] = (1 + slip) * truth.velocity / vehicle.wheels.radius
        table[f"drive_torque_{wheel}"] = drive
        table[f"brake_torque_{wheel}"] = brake
    return table
