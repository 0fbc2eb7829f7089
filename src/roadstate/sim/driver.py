"""Who drives the point-mass model: a speed plan followed with an engine, gears and brakes of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from roadstate.core import InputError
from roadstate.core.constants import GRAVITY
from roadstate.sim.longitudinal import LongitudinalPlant, Push
from roadstate.sim.speed_law import SpeedLaw

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_LAW = SpeedLaw()
_LAG = 0.12  # s: how fast engine and brakes follow what is asked of them
_SHIFT_TIME = 0.5  # s with the clutch open
_SETTLE_TIME = 2.0  # s before the next shift may begin
_LAUNCH = 0.4  # of the weight: the largest drive force, in the lowest gear
_OVERRUN = 0.15  # of the largest torque: what the engine brakes with, foot off the pedal
_IDLE = 80.0  # rad/s: engine speed below which the clutch slips
_SHIFT_UP = 240.0  # rad/s of the engine
_SHIFT_DOWN = 115.0  # rad/s
_HOLDING = 0.3  # of the weight: the brake force a standing car is held with
_LIGHTEST = 0.1  # m/s²: slowing down that is not worth the brake pedal
_PEDAL_FREE = 5.0  # N·m in sum over the wheels below which the brake pedal counts as released


class Command(NamedTuple):
    """What acts on the car, and what its bus would tell of it.

    Attributes:
        push: torques at the wheels and the total ratio.
        engine_torque: net, at the engine's shaft, N·m.
        engine_speed: rad/s.
        gear_ratio: transmission ratio in mesh without the final drive; 0 with the clutch open.
        brake: 1 where the pedal is pressed, else 0.
    """

    push: Push
    engine_torque: Float[Array, ""]
    engine_speed: Float[Array, ""]
    gear_ratio: Float[Array, ""]
    brake: Float[Array, ""]


class DriverState(NamedTuple):
    """What the driver and the actuators remember from step to step."""

    engine_torque: Float[Array, ""]
    brake_torque: Float[Array, ""]
    engine_speed: Float[Array, ""]
    integral: Float[Array, ""]
    gear: Int[Array, ""]
    since_shift: Float[Array, ""]


class Driver(eqx.Module):
    """Speed control by a PI law, a gear choice by engine speed, brakes for what the engine cannot hold.

    The engine is no map of a real one: its largest torque gives a drive force of 0.4 times the weight in the
    lowest gear, and 15 % of it is its drag. Shift speeds and times are chosen, too.

    Attributes:
        plant: the car that is driven.
        ratios: (G,) engine speed over wheel speed, lowest gear first; one alone is never shifted.
        final_drive: ratio of the final drive.
        efficiency: of the driveline; the engine's drag reaches the wheels divided by it.
    """

    plant: LongitudinalPlant
    ratios: Float[Array, " G"]
    final_drive: Float[Array, ""]
    efficiency: Float[Array, ""]

    @classmethod
    def from_vehicle(cls, vehicle: Vehicle) -> Self:
        """The driver of a vehicle file's car.

        Raises:
            InputError: a car with an engine but no gear ratios.
        """
        line = vehicle.driveline
        ratios = line.total_ratios or ((line.final_drive,) if line.kind == "in_wheel" else ())
        if not ratios:
            raise InputError(
                "no gear ratios to drive with", where=vehicle.name, mend="give 'driveline.gear_ratios'"
            )
        figures = (jnp.asarray(v) for v in (ratios, line.final_drive, line.efficiency))
        return cls(LongitudinalPlant.from_vehicle(vehicle), *figures)

    def init(self, velocity: float) -> DriverState:
        """A driver at ``velocity`` (m/s) in the gear that suits it, feet off the pedals."""
        speeds = velocity / self.plant.radius * self.ratios
        gear = jnp.argmax(speeds <= _SHIFT_UP)
        zero = jnp.zeros(())
        rolling = jnp.maximum(speeds[gear], self._idle_speed())
        return DriverState(zero, zero, rolling, zero, gear, jnp.asarray(_SETTLE_TIME))

    def drive(
        self,
        state: DriverState,
        velocity: Float[Array, ""],
        grade: Float[Array, ""],
        target: Float[Array, ""],
        target_accel: Float[Array, ""],
        dt: float,
    ) -> tuple[DriverState, Command]:
        """What the driver does at one instant, and the state ``dt`` seconds later.

        Args:
            state: of the driver.
            velocity: of the car in m/s.
            grade: in rad; felt, and used only to hold the car on a slope until the engine can.
            target: planned speed in m/s.
            target_accel: its derivative in m/s².
            dt: in s.
        """
        gear, since_shift = self._choose_gear(state, velocity, dt)
        ratio = self.ratios[gear]
        parked = (target < 0.05) & (velocity < 0.5)
        is_open = (since_shift < _SHIFT_TIME) | parked
        asked = _LAW.asked(state.integral, velocity, target, target_accel)
        force = jnp.where(
            parked, 0.0, asked * self.plant.effective_mass(ratio) + self.plant.drag * velocity**2
        )

        to_wheels = jnp.where(force >= 0, ratio * self.efficiency, ratio / self.efficiency)
        limit = self._engine_limit()
        wanted = force * self.plant.radius / to_wheels
        engine = jnp.where(is_open, 0.0, jnp.clip(wanted, -_OVERRUN * limit, limit))
        blend = -jnp.expm1(-dt / _LAG)
        engine_torque = state.engine_torque + blend * (engine - state.engine_torque)
        in_mesh = jnp.where(is_open, 0.0, ratio)
        efficiency = jnp.where(engine_torque >= 0, self.efficiency, 1 / self.efficiency)
        drive_torque = engine_torque * in_mesh * efficiency

        brake_torque = state.brake_torque + blend * (
            self._brake(force, parked, ratio, limit) - state.brake_torque
        )
        slope = self.plant.mass * GRAVITY * jnp.sin(grade) * self.plant.radius
        on_hill = (velocity == 0) & ~parked & (drive_torque < slope)
        brake_torque = jnp.where(on_hill, jnp.maximum(brake_torque, state.brake_torque), brake_torque)

        saturated = is_open | (wanted > limit) | on_hill
        integral = _LAW.advance(state.integral, velocity, target, saturated, dt)
        integral = jnp.where(parked, 0.0, integral)
        rolling = jnp.maximum(velocity / self.plant.radius * ratio, self._idle_speed())
        lagged = state.engine_speed + blend * (
            jnp.where(parked, self._idle_speed(), rolling) - state.engine_speed
        )
        engine_speed = jnp.where(is_open, lagged, rolling)
        brake = jnp.where(brake_torque > _PEDAL_FREE, 1.0, 0.0)
        push = Push(drive_torque, brake_torque, in_mesh)
        command = Command(push, engine_torque, engine_speed, in_mesh / self.final_drive, brake)
        return DriverState(engine_torque, brake_torque, engine_speed, integral, gear, since_shift), command

    def _idle_speed(self) -> float:
        """In rad/s; a single gear is an electric motor's, which needs none."""
        return _IDLE if len(self.ratios) > 1 else 0.0

    def _engine_limit(self) -> Float[Array, ""]:
        """Largest engine torque in N·m."""
        return _LAUNCH * self.plant.mass * GRAVITY * self.plant.radius / self.ratios[0]

    def _brake(
        self,
        force: Float[Array, ""],
        parked: Bool[Array, ""],
        ratio: Float[Array, ""],
        limit: Float[Array, ""],
    ) -> Float[Array, ""]:
        """Brake torque in N·m for what is left of a braking force after the engine's drag."""
        overrun = _OVERRUN * limit * ratio / self.efficiency
        left = -force * self.plant.radius - overrun
        left = jnp.where(left > _LIGHTEST * self.plant.mass * self.plant.radius, left, 0.0)
        return jnp.where(parked, _HOLDING * self.plant.mass * GRAVITY * self.plant.radius, left)

    def _choose_gear(
        self, state: DriverState, velocity: Float[Array, ""], dt: float
    ) -> tuple[Int[Array, ""], Float[Array, ""]]:
        speed = velocity / self.plant.radius * self.ratios[state.gear]
        ready = state.since_shift >= _SETTLE_TIME
        up = ready & (speed > _SHIFT_UP) & (state.gear < len(self.ratios) - 1)
        down = ready & (speed < _SHIFT_DOWN) & (state.gear > 0)
        gear = state.gear + jnp.where(up, 1, jnp.where(down, -1, 0))
        return gear, jnp.where(up | down, 0.0, state.since_shift + dt)
