"""From a vehicle file, and a plant file if there is one, to the reference plant."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np

from roadstate.core.constants import GRAVITY
from roadstate.core.errors import InputError
from roadstate.sim.plant.brakes import Brakes
from roadstate.sim.plant.chassis import Chassis
from roadstate.sim.plant.contact import Tires
from roadstate.sim.plant.driveline import Driveline, EngineDrive, WheelMotors
from roadstate.sim.plant.figures import PlantFigures, full_pedal, usual_figures
from roadstate.sim.plant.figures import Suspension as SuspensionFigures
from roadstate.sim.plant.handling import matched
from roadstate.sim.plant.multibody import Aerodynamics, MultibodyPlant
from roadstate.sim.plant.stability import StabilityControl
from roadstate.sim.plant.steering import Steering
from roadstate.sim.plant.suspension import Suspension
from roadstate.sim.plant.tire_figures import corner_loads, plant_tire, tires_per_corner
from roadstate.tires.base import as_leaf
from roadstate.tires.magic_formula import MagicFormula
from roadstate.vehicles.parameters import Vehicle

_SIDE = np.array([1.0, -1.0, 1.0, -1.0])
_FRONT = np.array([True, True, False, False])
# N/m of a tire per N of mean static load, and the terms of its effective radius
_TIRE_STIFFNESS = 50.0
_EFFECTIVE = np.array([8.4, 0.27, 0.07])
_STOP = 8.0  # stiffness of a stop over the spring's
_LOW_SPEED_DAMPING = 0.2  # damping ratio of a car that stands on its tires' carcasses
_SHORTEST = 0.01  # m
_CAMBER = 0.45  # rad/m, of a car's wheel
_ROLL_GRADIENT = 0.0088  # rad/(m/s²), where the vehicle file has none
_FRONT_BAR = 0.06  # by which the front's share of the roll stiffness exceeds its share of the load
_PRESSURE = 1.2e7  # Pa with which brakes stop the car that are in no file
_WIND_UP = 0.08  # rad of the shafts under it


def multibody_plant(
    vehicle: Vehicle,
    figures: PlantFigures | None = None,
    *,
    tir: str | Path | None = None,
    stiffness_follows_friction: bool = False,
    anti_lock: bool = False,
    traction_control: bool = False,
    stability_control: bool = False,
    wind: tuple[float, float] = (0.0, 0.0),
    inner_step: float = 0.001,
) -> MultibodyPlant:
    """The reference plant of a vehicle.

    Args:
        vehicle: its file or preset; standing on its wheels the plant has the file's mass, yaw inertia,
            centre of gravity, rolling radius and axle stiffnesses.
        figures: what the file does not hold; where not set, :func:`usual_figures` of the vehicle.
        tir: a tire property file instead of the package's tire, scaled.
        stiffness_follows_friction: as :func:`roadstate.sim.plant.tire_figures.plant_tire`.
        anti_lock, traction_control, stability_control: whether these controls are on.
        wind: velocity of the air along the world's x and y, m/s.
        inner_step: of the integration, s.

    Raises:
        InputError: wheels too heavy for the yaw inertia; no gear ratios; as ``plant_tire``.
    """
    figures = usual_figures(vehicle, figures)
    tire = plant_tire(
        vehicle, tir, figures=figures.tires, stiffness_follows_friction=stiffness_follows_friction
    )
    unsprung = _unsprung(vehicle, figures)
    tires = _tires(vehicle, figures, tire, unsprung)
    standing = np.asarray(tires.radius - tires.nominal_deflection)[[tires.wheel.index(i) for i in range(4)]]
    gains = _brake_gains(vehicle)
    vertical = float(tires.stiffness[0])
    chassis = _chassis(vehicle, figures, unsprung, standing, gains)
    suspension = _suspension(vehicle, figures, unsprung, chassis, tires)
    tire, steering_stiffness = matched(
        vehicle, figures, tire, chassis, suspension, vertical, as_measured=tir is not None
    )
    geometry = vehicle.geometry
    lift = figures.lift
    area = vehicle.aerodynamics.frontal_area
    return MultibodyPlant(
        chassis=chassis,
        suspension=suspension,
        tires=replace(tires, model=tire),
        steering=_steering(vehicle, figures, steering_stiffness),
        driveline=_driveline(vehicle, figures),
        brakes=Brakes(
            **_leaves(
                gain=gains,
                largest_pressure=full_pedal(vehicle, figures, gains),
                lag=figures.brakes.lag,
                radius=np.full(4, vehicle.wheels.radius),
                anti_lock=float(anti_lock),
                traction=float(traction_control),
            )
        ),
        aerodynamics=Aerodynamics(
            **_leaves(
                area=np.array([vehicle.drag_area, lift.front * area, lift.rear * area]),
                density=vehicle.aerodynamics.air_density,
                axles=np.array([geometry.cg_to_front_axle, -geometry.cg_to_rear_axle]),
                wind=np.array([*wind, 0.0]),
            )
        ),
        stability=_stability(vehicle) if stability_control else None,
        inner_step=inner_step,
    )


def _stability(vehicle: Vehicle) -> StabilityControl:
    ratio = 1.0 if vehicle.steering is None else vehicle.steering.ratio
    understeer = max(vehicle.understeer_gradient, 0.0)
    return StabilityControl(**_leaves(ratio=ratio, wheelbase=vehicle.wheelbase, understeer=understeer))


def _leaves(**values: Any) -> dict[str, Any]:
    """Numbers as parameter leaves; what is a part already stays."""
    return {name: v if isinstance(v, eqx.Module) else as_leaf(v) for name, v in values.items()}


def _per_wheel(front: float, rear: float) -> np.ndarray:
    return np.where(_FRONT, front, rear)


def _unsprung(vehicle: Vehicle, figures: PlantFigures) -> np.ndarray:
    share = 0.13 if vehicle.driveline.kind == "in_wheel" else 0.10
    rear = 0.58 if vehicle.wheels.dual_rear else 0.5
    front_mass, rear_mass = figures.front.unsprung_mass, figures.rear.unsprung_mass
    return _per_wheel(
        0.5 * share * (1 - rear) * vehicle.mass if front_mass is None else front_mass,
        0.5 * share * rear * vehicle.mass if rear_mass is None else rear_mass,
    )


def _tires(vehicle: Vehicle, figures: PlantFigures, tire: MagicFormula, unsprung: np.ndarray) -> Tires:
    count = tires_per_corner(vehicle)
    wheel = np.repeat(np.arange(4), count)
    mean = vehicle.mass * GRAVITY / count.sum()
    stiffness = figures.tires.vertical_stiffness or _TIRE_STIFFNESS * mean
    load, carried = (corner_loads(vehicle) / count)[wheel], (unsprung / count)[wheel]
    left = np.concatenate([np.linspace(0.5, -0.5, n) if n > 1 else np.zeros(1) for n in count])
    deflection = load / stiffness
    B, D, F = _EFFECTIVE
    radius = vehicle.wheels.radius + deflection * (D * np.arctan(B) + F)
    along = np.asarray(tire.stiffnesses(load)[0])
    carcass = along / np.asarray(tire.relaxation_lengths(load).longitudinal)
    return Tires(
        **_leaves(
            model=tire,
            beside=figures.tires.dual_spacing * left,
            radius=radius,
            stiffness=np.full(len(wheel), stiffness),
            damping=2 * figures.tires.vertical_damping * np.sqrt(stiffness * carried),
            nominal_deflection=deflection,
            low_speed_damping=2 * _LOW_SPEED_DAMPING * np.sqrt(carcass * load / GRAVITY),
            shortest=_SHORTEST,
            effective=_EFFECTIVE,
        ),
        wheel=tuple(int(i) for i in wheel),
    )


def _drive_share(vehicle: Vehicle, figures: PlantFigures) -> float:
    return {"front": 1.0, "rear": 0.0}.get(vehicle.driveline.driven, figures.powertrain.front_share)


def _brake_gains(vehicle: Vehicle) -> np.ndarray:
    if vehicle.brakes is not None:
        return _per_wheel(vehicle.brakes.torque_per_pressure_front, vehicle.brakes.torque_per_pressure_rear)
    whole = 1.2 * vehicle.mass * GRAVITY * vehicle.wheels.radius / _PRESSURE
    return _per_wheel(0.5 * 0.65 * whole, 0.5 * 0.35 * whole)


def _places(vehicle: Vehicle, standing: np.ndarray) -> np.ndarray:
    g = vehicle.geometry
    x = _per_wheel(g.cg_to_front_axle, -g.cg_to_rear_axle)
    y = 0.5 * _SIDE * _per_wheel(g.track_front, g.track_rear)
    return np.stack([x, y, standing - g.cg_height])


def _chassis(
    vehicle: Vehicle,
    figures: PlantFigures,
    unsprung: np.ndarray,
    standing: np.ndarray,
    gains: np.ndarray,
) -> Chassis:
    g, wheels = vehicle.geometry, _places(vehicle, standing)
    sprung = vehicle.mass - unsprung.sum()
    if sprung <= 0.3 * vehicle.mass:
        raise InputError(
            "the wheels outweigh the car", where=vehicle.name, mend="lower 'unsprung_mass' in the plant file"
        )
    centre = -(wheels @ unsprung) / sprung
    yaw = vehicle.yaw_inertia - unsprung @ (wheels[0] ** 2 + wheels[1] ** 2)
    yaw -= sprung * (centre[0] ** 2 + centre[1] ** 2)
    if yaw <= 0.05 * vehicle.yaw_inertia:
        raise InputError(
            f"its wheels alone have {vehicle.yaw_inertia - yaw:.0f} kg*m^2 of its {vehicle.yaw_inertia:.0f}",
            where=f"{vehicle.name}: yaw_inertia",
            mend="lower 'unsprung_mass' in the plant file, or check the yaw inertia",
        )
    roll = sprung * (figures.inertia.roll * 0.5 * (g.track_front + g.track_rear)) ** 2
    pitch = sprung * (figures.inertia.pitch * g.wheelbase) ** 2
    path, turn = _paths(vehicle, figures, standing, gains)
    lean_back, lean_in = figures.steering.caster, figures.steering.kingpin_inclination
    front = np.stack([-np.tan(lean_back) * _FRONT, -np.tan(lean_in) * _SIDE * _FRONT, np.ones(4)])
    count = tires_per_corner(vehicle)
    return Chassis(
        **_leaves(
            masses=np.concatenate([[sprung], unsprung]),
            places=np.concatenate([centre[:, None], wheels], axis=1),
            inertia=np.diag([roll, pitch, yaw]),
            path=path,
            carrier_turn=turn,
            steering_axis=front / np.linalg.norm(front, axis=0),
            spin_inertia=vehicle.wheels.inertia * count,
        ),
        rigid=(figures.front.kind == "rigid_axle", figures.rear.kind == "rigid_axle"),
    )


def _paths(
    vehicle: Vehicle, figures: PlantFigures, standing: np.ndarray, gains: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Motion of the wheel centres and turn of the carriers per travel."""
    g, front, rear = vehicle.geometry, figures.front, figures.rear
    slope = g.cg_height / g.wheelbase
    driven = _drive_share(vehicle, figures)
    both = gains[0] + gains[2]
    braked = gains[0] / both if both > 0 else 0.5  # no brakes: any share does
    sign = np.where(_FRONT, 1.0, -1.0)
    drive_share = _per_wheel(driven, 1 - driven)
    brake_share = np.maximum(_per_wheel(braked, 1 - braked), 0.05)
    anti_drive = _per_wheel(front.anti_pitch_drive, rear.anti_pitch_drive)
    anti_brake = _per_wheel(front.anti_pitch_brake, rear.anti_pitch_brake)
    x = np.where(drive_share > 0, sign * anti_drive * slope / np.maximum(drive_share, 0.05), 0.0)
    x_contact = sign * anti_brake * slope / brake_share
    track = _per_wheel(g.track_front, g.track_rear)
    height = _per_wheel(front.roll_centre_height, rear.roll_centre_height)
    camber = _SIDE * np.repeat([_camber(front, g.track_front), _camber(rear, g.track_rear)], 2)
    toe = -_SIDE * _per_wheel(front.toe_per_travel, rear.toe_per_travel)
    y = _SIDE * 2 * height / track - camber * standing
    return np.stack([x, y, np.ones(4)]), np.stack([camber, (x - x_contact) / standing, toe])


def _camber(axle: SuspensionFigures, track: float) -> float:
    """Lean inwards per travel, rad/m: with 2/track wheels stay upright on the road as the body rolls."""
    if axle.kind == "rigid_axle":
        return 2 / track
    return _CAMBER if axle.camber_per_travel is None else axle.camber_per_travel


def _suspension(
    vehicle: Vehicle, figures: PlantFigures, unsprung: np.ndarray, chassis: Chassis, tires: Tires
) -> Suspension:
    g = vehicle.geometry
    front, rear = figures.front, figures.rear
    carried = corner_loads(vehicle) / GRAVITY - unsprung
    frequency = 2 * np.pi * _per_wheel(front.ride_frequency, rear.ride_frequency)
    stiffness = carried * frequency**2
    critical = 2 * carried * frequency
    track = np.array([g.track_front, g.track_rear])
    base = np.array([front.spring_track, rear.spring_track])
    whole = 0.5 * stiffness[[0, 2]] * track**2
    springs = whole * base**2
    height = g.cg_height + float(chassis.places[2, 0])
    front_share = g.cg_to_rear_axle / g.wheelbase
    axis = front_share * front.roll_centre_height + (1 - front_share) * rear.roll_centre_height
    lever = float(chassis.masses[0]) * (height - axis)
    gradient = vehicle.body.roll_gradient or _ROLL_GRADIENT
    # the body rolls on its springs by what is left to them: it rolls on its tires as well
    on_tires = np.sum(tires.stiffness * (0.5 * track[np.array(tires.wheel) // 2]) ** 2)
    gradient = max(gradient - vehicle.mass * g.cg_height / float(on_tires), 0.1 * gradient)
    wanted = max(lever / gradient + lever * GRAVITY, float(springs.sum()))
    share = min(max(front_share + _FRONT_BAR, springs[0] / wanted), 1 - springs[1] / wanted)
    bars = (np.array([share, 1 - share]) * wanted - whole) / track**2
    return Suspension(
        **_leaves(
            preload=carried * GRAVITY,
            stiffness=stiffness,
            damping_bump=critical * _per_wheel(front.damping_bump, rear.damping_bump),
            damping_rebound=critical * _per_wheel(front.damping_rebound, rear.damping_rebound),
            bump_travel=_per_wheel(front.bump_travel, rear.bump_travel),
            rebound_travel=_per_wheel(front.rebound_travel, rear.rebound_travel),
            stop_stiffness=_STOP * stiffness,
            bar_stiffness=_per_wheel(*bars),
        )
    )


def _steering(vehicle: Vehicle, figures: PlantFigures, stiffness: float) -> Steering:
    given, g = figures.steering, vehicle.geometry
    natural = 2 * np.pi * given.frequency
    return Steering(
        **_leaves(
            ratio=1.0 if vehicle.steering is None else vehicle.steering.ratio,
            stiffness=stiffness,
            damping=2 * given.damping * stiffness / natural,
            inertia=stiffness / natural**2,
            ackermann=given.ackermann * 0.5 * g.track_front / g.wheelbase,
        )
    )


def _driveline(vehicle: Vehicle, figures: PlantFigures) -> Driveline:
    line, power = vehicle.driveline, figures.powertrain
    radius, driven = vehicle.wheels.radius, _drive_share(vehicle, figures)
    share = 0.5 * _per_wheel(driven, 1 - driven)
    force = power.launch * vehicle.mass * GRAVITY
    if line.kind == "in_wheel":
        largest = force * radius if power.peak_torque is None else power.peak_torque
        return WheelMotors(**_leaves(largest_torque=largest * share, corner_speed=12.0 / radius, lag=0.02))
    if not line.total_ratios:
        raise InputError(
            "no gear ratios to drive with", where=vehicle.name, mend="give 'driveline.gear_ratios'"
        )
    first = line.total_ratios[0]
    reverse = (line.reverse_ratio or 0.9 * line.gear_ratios[0]) * line.final_drive
    peak = force * radius / (first * line.efficiency) if power.peak_torque is None else power.peak_torque
    largest_speed = power.largest_speed or (280.0 if vehicle.mass > 3500 else 650.0)
    at_wheels = peak * first * line.efficiency
    wheels = vehicle.wheels.inertia * float(np.sum(tires_per_corner(vehicle)[share > 0]))
    stiffness = at_wheels / _WIND_UP
    return EngineDrive(
        **_leaves(
            ratios=np.array([-reverse, 0.0, *line.total_ratios] + [0.0] * (24 - len(line.total_ratios))),
            gears=len(line.total_ratios),
            share=share,
            efficiency=line.efficiency,
            engine_inertia=line.engine_inertia or 1.1e-4 * vehicle.mass,
            shaft_inertia=0.5 * wheels,
            stiffness=stiffness,
            damping=0.2 * np.sqrt(stiffness * wheels),
            peak_torque=peak,
            peak_speed=power.peak_speed or 0.45 * largest_speed,
            largest_speed=largest_speed,
            idle_speed=power.idle_speed,
            drag=0.2,
            lag=power.lag,
            shift_time=power.shift_time,
            shift_up=power.shift_up * largest_speed,
            shift_down=power.shift_down * largest_speed,
            slip_torque=power.limited_slip,
            slip_limit=power.limited_slip_torque,
        )
    )
