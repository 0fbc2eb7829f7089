"""What a multibody plant tells of an instant, and where its energy goes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.constants import GRAVITY
from roadstate.sim.plant.base import Truth
from roadstate.sim.plant.driveline import EngineDrive
from roadstate.sim.plant.vectors import cross, dot, rotation, to_body, to_world, unit
from roadstate.tires.slip import practical_slip, slip_angle

if TYPE_CHECKING:
    from roadstate.sim.plant.base import Controls
    from roadstate.sim.plant.multibody import Instant, MultibodyPlant, State


def truth_of(plant: MultibodyPlant, state: State, now: Instant) -> Truth:
    """Everything worth knowing; the road under the car is the plane through the four wheels' contacts.

    Of dual tires: forces and loads in sum, the mean of slips and cambers, and the friction that both have
    together.

    Args:
        plant: the car.
        state: its state.
        now: what follows from it.
    """
    motion, contact, drive = state.motion, now.contact, now.drive
    tires, R = plant.tires, rotation(motion.attitude)
    feet = to_world(R, plant.chassis.wheel_centres(motion.travel) + tires.mean(now.frame.arm))
    ahead = feet[:, 0] + feet[:, 1] - feet[:, 2] - feet[:, 3]
    aside = feet[:, 0] + feet[:, 2] - feet[:, 1] - feet[:, 3]
    normal = to_body(R, unit(cross(ahead, aside)))
    forward = unit(jnp.asarray([1.0, 0.0, 0.0], normal.dtype) - normal[0] * normal)
    left = cross(normal, forward)
    rise, tilt = dot(R[2], forward), dot(R[2], left)
    grade = jnp.arcsin(rise)
    rolling = contact.effective_radius * tires.of_wheels(motion.spin)
    load = tires.summed(contact.load)
    friction = tires.mean(now.ground.friction)
    if len(tires.wheel) > 4:
        shared = tires.summed(contact.load * now.ground.friction) / jnp.where(load > 0, load, 1)
        friction = jnp.where(load > 0, shared, friction)
    accel = now.accelerations.velocity + cross(motion.rate, motion.velocity)
    has_engine = isinstance(plant.driveline, EngineDrive)
    return Truth(
        position=motion.position,
        attitude=motion.attitude,
        road=motion.road,
        velocity=motion.velocity,
        angular_rate=motion.rate,
        specific_force=accel - now.gravity,
        angular_accel=now.accelerations.rate,
        planar_velocity=jnp.stack([dot(motion.velocity, forward), dot(motion.velocity, left)]),
        grade=grade,
        bank=jnp.arcsin(tilt / jnp.cos(grade)),
        wheel_speed=now.to_carrier,
        steer=now.steer_angle,
        force_x=tires.summed(contact.force_x),
        force_y=tires.summed(contact.force_y),
        load=load,
        force_body=now.wheel_force.T,
        slip=tires.mean(practical_slip(rolling, contact.velocity_x)),
        slip_angle=tires.mean(slip_angle(contact.velocity_x, contact.velocity_y)),
        camber=tires.mean(now.frame.camber),
        friction=friction,
        drive_torque=drive.shaft_torque + drive.motor_torque,
        brake_torque=now.brake_torque,
        brake_pressure=state.brakes.pressure,
        travel=motion.travel,
        engine_speed=motion.parts[0] if has_engine else jnp.full_like(motion.parts[0], jnp.nan),
        engine_torque=drive.engine_torque,
        gear=state.memory.gear,
        gear_ratio=plant.driveline.ratio(state.memory),
    )


class Energy(NamedTuple):
    """Energies (J) and powers (W) of an instant.

    Attributes:
        kinetic: of all bodies, wheels, the steering and the driveline.
        potential: of gravity, springs, stops, bars, tires' vertical and the shafts' and steering's springs.
        engine: power of the engine or the motors on what they turn. (A driver who turns the steering wheel
            works on the steering's spring, too; with held controls nobody does.)
        aerodynamic: power lost in the air.
        damping: in dampers of suspension and steering and in the tires' vertical damping.
        friction: in brakes, clutch, gears and differentials.
        tires: what the road takes through sliding and rolling; it is what the tires' horizontal deflections
            store, too.
    """

    kinetic: Float[Array, ""]
    potential: Float[Array, ""]
    engine: Float[Array, ""]
    aerodynamic: Float[Array, ""]
    damping: Float[Array, ""]
    friction: Float[Array, ""]
    tires: Float[Array, ""]


def energy_of(plant: MultibodyPlant, state: State, now: Instant, controls: Controls) -> Energy:
    """Where the energy of a multibody plant is, and what flows in and out of it.

    Args:
        plant: the car.
        state: its state.
        now: what follows from it, :meth:`MultibodyPlant.now`.
        controls: in force.
    """
    motion = state.motion
    chassis, contact, frame = plant.chassis, now.contact, now.frame
    R = rotation(motion.attitude)
    centres = chassis.wheel_centres(motion.travel)
    places = jnp.concatenate([chassis.places[:, :1], centres], axis=1)
    heights = motion.position[2] + to_world(R, places)[2]
    steering = plant.steering
    kinetic = chassis.kinetic_energy(motion.velocity, motion.rate, motion.travel_rate, centres, motion.spin)
    kinetic = kinetic + 0.5 * steering.inertia * motion.steer_rate**2
    offset = controls.steering_wheel / steering.ratio - motion.steer
    potential = (
        GRAVITY * jnp.sum(chassis.masses * heights)
        + plant.suspension.energy(motion.travel)
        + plant.tires.energy(frame.loaded_radius)
        + 0.5 * steering.stiffness * offset**2
    )
    drive, engine = now.drive, jnp.sum(now.drive.motor_torque * now.to_carrier)
    if isinstance(plant.driveline, EngineDrive):
        line, parts = plant.driveline, motion.parts
        kinetic = kinetic + 0.5 * (line.engine_inertia * parts[0] ** 2 + line.shaft_inertia * parts[1] ** 2)
        potential = potential + 0.5 * line.stiffness * parts[2] ** 2
        engine = drive.engine_torque * parts[0]
    suspension = -jnp.sum(plant.suspension.damping(motion.travel_rate) * motion.travel_rate)
    stored = plant.tires.stiffness
    pressed = jnp.maximum(plant.tires.radius - frame.loaded_radius, 0)
    turn = chassis.turned(motion.travel_rate)
    _, gain = steering.angles(motion.steer)
    turn = turn + chassis.steering_axis * (gain * motion.steer_rate) + motion.rate[:, None]
    axis = steering.axes(chassis, motion.travel, now.steer_angle)
    wheel_rate = turn + (motion.spin - dot(turn, axis)) * axis
    hub = chassis.velocities(motion.velocity, motion.rate, motion.travel_rate, centres)
    road_power = jnp.sum(dot(now.wheel_force, hub) + dot(now.wheel_moment, wheel_rate))
    elastic = jnp.sum(stored * pressed * contact.velocity_z)
    vertical = jnp.sum(contact.load * contact.velocity_z)
    return Energy(
        kinetic=kinetic,
        potential=potential,
        engine=engine,
        aerodynamic=-dot(now.drag, motion.velocity) - dot(now.drag_torque, motion.rate),
        damping=suspension + steering.damping * motion.steer_rate**2 + elastic - vertical,
        friction=drive.loss - jnp.sum(now.brake_torque * now.to_carrier),
        tires=vertical - road_power,
    )
