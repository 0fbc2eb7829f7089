"""The reference plant: 15 and more degrees of freedom on Magic Formula tires."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from roadstate.core.constants import GRAVITY
from roadstate.sim.plant.base import Controls, Road, Truth
from roadstate.sim.plant.brakes import Brakes, BrakeState
from roadstate.sim.plant.chassis import Accelerations, Chassis, Loads
from roadstate.sim.plant.contact import Contact, Frame, Ground, Tires, frames, ground, limit_slip, relax_slip
from roadstate.sim.plant.driveline import Drive, Driveline, Memory
from roadstate.sim.plant.stability import StabilityControl
from roadstate.sim.plant.steering import Steering
from roadstate.sim.plant.suspension import Suspension
from roadstate.sim.plant.vectors import attitude_rate, cross, dot, rotation, settled, to_body, to_world
from roadstate.tires.base import as_leaf
from roadstate.tires.smooth import Numbers


class Motion(NamedTuple):
    """The continuous states but the tires'.

    Attributes:
        position: (3,) of the CG in the world, m.
        attitude: (3,) yaw, pitch, roll, rad.
        road: (2,) s and d of the CG, m.
        travel: (4,) of the wheels, m, positive in bump.
        steer: mean road-wheel angle, rad.
        velocity: (3,) of the CG along the body's axes, m/s.
        rate: (3,) about the body's axes, rad/s.
        travel_rate: (4,) m/s.
        steer_rate: rad/s.
        spin: (4,) absolute rotation of the wheels about their axes, rad/s.
        parts: (3,) turning parts of the driveline.
    """

    position: Float[Array, " 3"]
    attitude: Float[Array, " 3"]
    road: Float[Array, " 2"]
    travel: Float[Array, " 4"]
    steer: Float[Array, ""]
    velocity: Float[Array, " 3"]
    rate: Float[Array, " 3"]
    travel_rate: Float[Array, " 4"]
    steer_rate: Float[Array, ""]
    spin: Float[Array, " 4"]
    parts: Float[Array, " 3"]


class State(NamedTuple):
    """Everything that a multibody plant remembers.

    Attributes:
        motion: continuous states.
        slip: (2, N) transient slips κ' and tan α' of the tires.
        memory: the driveline's.
        brakes: pressures and controls.
        rates: derivative of the motion half a step ago.
        slip_growth, slip_decay: (2, N) of the transient slips half a step ago.
    """

    motion: Motion
    slip: Float[Array, "2 N"]
    memory: Memory
    brakes: BrakeState
    rates: Motion
    slip_growth: Float[Array, "2 N"]
    slip_decay: Float[Array, "2 N"]


class Instant(NamedTuple):
    """All that follows from a state at one instant.

    Attributes:
        rates: derivative of the motion.
        contact, frame, ground: of the tires.
        wheel_force: (3, 4) of the road on each wheel along the body's axes, N.
        wheel_moment: (3, 4) its moment about the wheel's centre, N·m.
        drive: of the driveline.
        brake_torque: (4,) on each wheel, N·m, with its sign.
        to_carrier: (4,) wheel speeds against their carriers, rad/s.
        to_body: (4,) and against the body.
        accelerations: of the bodies.
        gravity: (3,) along the body's axes, m/s².
        drag: (3,) aerodynamic force along the body's axes, N, and
        drag_torque: (3,) its torque about the CG.
        steer_angle: (4,) of the wheels, rad.
        steer_torque: of the steering's spring on the wheels, N·m.
    """

    rates: Motion
    contact: Contact
    frame: Frame
    ground: Ground
    wheel_force: Numbers
    wheel_moment: Numbers
    drive: Drive
    brake_torque: Numbers
    to_carrier: Numbers
    to_body: Numbers
    accelerations: Accelerations
    gravity: Numbers
    drag: Numbers
    drag_torque: Numbers
    steer_angle: Numbers
    steer_torque: Numbers


class Aerodynamics(eqx.Module):
    """Drag along the motion through the air, and lift at the axles; no force is due to flowing aside.

    Attributes:
        area: (3,) c_dA, and c_lA of the front and the rear axle, m².
        density: kg/m³.
        axles: (2,) x of the axles seen from the CG, m.
        wind: (3,) velocity of the air in the world, m/s.
    """

    area: Numbers = eqx.field(converter=as_leaf)
    density: Numbers = eqx.field(converter=as_leaf)
    axles: Numbers = eqx.field(converter=as_leaf)
    wind: Numbers = eqx.field(converter=as_leaf)

    def force(self, velocity: Float[Array, " 3"], R: Float[Array, "3 3"]) -> tuple[Numbers, Numbers]:
        """(3,) force (N) and (3,) torque about the CG (N·m) along the body's axes, ``R`` from these to the
        world's."""
        velocity = velocity - to_body(R, self.wind)
        speed = jnp.sqrt(dot(velocity, velocity) + 1e-12)
        pressure = 0.5 * self.density * speed**2
        lift = pressure * self.area[1:]
        zero = jnp.zeros_like(speed)
        force = -0.5 * self.density * self.area[0] * speed * velocity
        torque = jnp.stack([zero, -jnp.sum(self.axles * lift), zero])
        return force + jnp.stack([zero, zero, jnp.sum(lift)]), torque


class MultibodyPlant(eqx.Module):
    """6 of the body, 4 travels, 4 spins, 1 steering; 2N transient slips, 3 turning parts of the driveline.

    Build one by :func:`roadstate.sim.plant.multibody_plant`.

    Attributes:
        chassis, suspension, tires, steering, driveline, brakes, aerodynamics: the parts.
        stability: control, where the car has one.
        inner_step: s, of the integration.
    """

    chassis: Chassis
    suspension: Suspension
    tires: Tires
    steering: Steering
    driveline: Driveline
    brakes: Brakes
    aerodynamics: Aerodynamics
    stability: StabilityControl | None = None
    inner_step: float = eqx.field(default=0.001, static=True)

    def instant(
        self,
        road: Road,
        motion: Motion,
        slip: Numbers,
        actuators: tuple[Memory, BrakeState],
        controls: Controls,
        start: tuple[Numbers, Numbers],
        dt: ArrayLike,
    ) -> Instant:
        """Forces and accelerations.

        Args:
            road: under the car.
            motion: continuous states.
            slip: (2, N) transient slips.
            actuators: driveline's memory and brakes in force.
            controls: the driver's.
            start: spins against the carriers (4,) and turning parts (3,) at the step's start: dry friction
                is what would stop them within ``dt``, at most its capacity.
            dt: s.
        """
        memory, brakes = actuators
        chassis, tires, h = self.chassis, self.tires, jnp.asarray(dt, motion.velocity.dtype)
        steer_angle, steer_gain = self.steering.angles(motion.steer)
        R = rotation(motion.attitude)
        under = road.at(motion.road[0], motion.road[1])
        centres = chassis.wheel_centres(motion.travel)
        axis = self.steering.axes(chassis, motion.travel, steer_angle)
        tire_axis = tires.of_wheels(axis)
        feet = tires.of_wheels(centres) + tires.beside * tire_axis
        surface = ground(road, motion.position, R, motion.road, feet, under)
        frame = Frame(*settled(*frames(tire_axis, surface, tires.beside)))

        turning = chassis.turned(motion.travel_rate)
        turning = turning + chassis.steering_axis * (steer_gain * motion.steer_rate)
        carrier_rate = motion.rate[:, None] + turning
        about_axis = dot(carrier_rate, axis)
        hub = chassis.velocities(motion.velocity, motion.rate, motion.travel_rate, centres)
        velocity = tires.of_wheels(hub) + cross(tires.of_wheels(carrier_rate - about_axis * axis), frame.arm)
        contact = tires.contact(frame, velocity, tires.of_wheels(motion.spin), slip, surface.friction)
        force, moment = tires.summed(contact.force), tires.summed(contact.moment)

        to_body = motion.spin - dot(motion.rate, axis)
        to_carrier = motion.spin - about_axis
        drive = self.driveline.drive(memory, motion.parts, start[1], to_body, h)
        turned = dot(moment, axis)
        free = turned + drive.shaft_torque + drive.motor_torque
        stopping = chassis.spin_inertia * start[0] / h + free
        capacity = self.brakes.gain * brakes.pressure
        brake_torque = -jnp.clip(stopping, -capacity, capacity)
        spin_accel = (free + brake_torque) / chassis.spin_inertia

        gyroscopic = cross(carrier_rate, axis * (chassis.spin_inertia * motion.spin))
        on_carrier = moment - (turned + brake_torque + drive.motor_torque) * axis - gyroscopic
        drag, drag_torque = self.aerodynamics.force(motion.velocity, R)
        gravity = -GRAVITY * R[2]
        shafts = -jnp.sum(drive.shaft_torque * axis, axis=1)
        travel_force = self.suspension.elastic(motion.travel) + self.suspension.damping(motion.travel_rate)
        accelerations = chassis.accelerate(
            motion.velocity,
            motion.rate,
            motion.travel_rate,
            centres,
            gravity,
            Loads(force, on_carrier, travel_force, drag, drag_torque + shafts),
        )
        steer_torque = self.steering.spring(motion.steer, motion.steer_rate, controls.steering_wheel)
        on_steering = jnp.sum(steer_gain * dot(chassis.steering_axis, on_carrier))
        v_world = to_world(R, motion.velocity)
        cos, sin = jnp.cos(under.heading), jnp.sin(under.heading)
        ahead, aside = v_world[0] * cos + v_world[1] * sin, v_world[1] * cos - v_world[0] * sin
        rates = Motion(
            position=v_world,
            attitude=attitude_rate(motion.attitude, motion.rate),
            road=jnp.stack([ahead / (1 - under.curvature * motion.road[1]), aside]),
            travel=motion.travel_rate,
            steer=motion.steer_rate,
            velocity=accelerations.velocity,
            rate=accelerations.rate,
            travel_rate=accelerations.travel,
            steer_rate=(steer_torque + on_steering) / self.steering.inertia,
            spin=spin_accel,
            parts=drive.derivative,
        )
        return Instant(
            rates, contact, frame, surface, force, moment, drive, brake_torque, to_carrier, to_body,
            accelerations, gravity, drag, drag_torque, steer_angle, steer_torque,
        )  # fmt: skip

    def wheel_speed(self, motion: Motion) -> Numbers:
        """(4,) against the carriers, rad/s."""
        angle, gain = self.steering.angles(motion.steer)
        axis = self.steering.axes(self.chassis, motion.travel, angle)
        turning = self.chassis.turned(motion.travel_rate)
        turning = turning + self.chassis.steering_axis * (gain * motion.steer_rate)
        return motion.spin - dot(motion.rate[:, None] + turning, axis)

    def inner(self, road: Road, state: State, controls: Controls, dt: ArrayLike) -> State:
        """One step by the midpoint rule, the midpoint extrapolated from the last one's rates.

        y' = y + ½Δt f_last, y⁺ = y + Δt f(y'): second order with one evaluation (the two-step Adams–Bashforth
        rule in another form), stable for damping below 1/Δt. Transient slips go by its exponential form,
        stable for any relaxation length; dry friction is what would stop the part within Δt.
        """
        motion, slip, memory, brakes = state[:4]
        h = jnp.asarray(dt, motion.velocity.dtype)
        wheel_speed = self.wheel_speed(motion)
        controls = self._held_on_course(state, controls)
        next_brakes = self.brakes.advance(brakes, controls, motion.velocity[0], wheel_speed, h)
        next_memory = self.driveline.advance(memory, motion.parts, controls, next_brakes.traction, h)
        mean = (
            next_memory._replace(torque=0.5 * (memory.torque + next_memory.torque)),
            next_brakes._replace(pressure=0.5 * (brakes.pressure + next_brakes.pressure)),
        )
        half = jax.tree.map(lambda a, b: a + h / 2 * b, motion, state.rates)
        half_slip = relax_slip(slip, state.slip_growth, state.slip_decay, h / 2)
        now = self.instant(road, half, half_slip, mean, controls, (wheel_speed, motion.parts), h)
        growth, decay = now.contact.slip_growth, now.contact.slip_decay
        moved = jax.tree.map(lambda a, b: a + h * b, motion, now.rates)
        slipped = limit_slip(relax_slip(slip, growth, decay, h))
        return State(moved, slipped, next_memory, next_brakes, now.rates, growth, decay)

    def _held_on_course(self, state: State, controls: Controls) -> Controls:
        """With what stability control asks of the brakes."""
        if self.stability is None:
            return controls
        motion = state.motion
        speed, yaw_rate = motion.velocity[0], motion.rate[2]
        accel_y = state.rates.velocity[1] + yaw_rate * speed
        more = self.stability.pressure(speed, yaw_rate, accel_y, controls.steering_wheel)
        return controls._replace(brake_pressure=controls.brake_pressure + more)

    def step(self, road: Road, state: State, controls: Controls, dt: float) -> State:
        """As :meth:`roadstate.sim.plant.base.Plant.step`."""
        count = round(dt / self.inner_step)
        if count < 1 or abs(count * self.inner_step - dt) > 1e-9:
            raise ValueError(f"dt = {dt} s is no multiple of the inner step, {self.inner_step} s")

        def one(now: State, _: None) -> tuple[State, None]:
            return self.inner(road, now, controls, self.inner_step), None

        return jax.lax.scan(one, state, None, length=count)[0]

    def now(self, road: Road, state: State, controls: Controls) -> Instant:
        """:meth:`instant` of a state, dry friction as over one inner step."""
        start = (self.wheel_speed(state.motion), state.motion.parts)
        actuators = (state.memory, state.brakes)
        return self.instant(road, state.motion, state.slip, actuators, controls, start, self.inner_step)

    def truth(self, road: Road, state: State, controls: Controls) -> Truth:
        """As :meth:`roadstate.sim.plant.base.Plant.truth`."""
        from roadstate.sim.plant.truth import truth_of

        return truth_of(self, state, self.now(road, state, controls))

    def init(self, road: Road, speed: ArrayLike, s: ArrayLike = 0.0, d: ArrayLike = 0.0) -> State:
        """As :meth:`roadstate.sim.plant.base.Plant.init`: height, attitude and travels by Newton."""
        from roadstate.sim.plant.trim import trimmed

        return trimmed(self, road, speed, s, d)
