"""From the pedal to the wheels: engine, clutch, gears, shaft and differentials; or motors in the wheels."""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.sim.plant.base import AUTOMATIC, Controls
from roadstate.tires.base import as_leaf
from roadstate.tires.smooth import Numbers

# s between two automatic shifts
_REST = 1.5
# shares of the shift's time: when the clutch is open, when the gear changes, when the clutch begins to close,
# when the throttle is given back, when the clutch no longer only matches speeds
_OPEN, _SYNCHRONISED, _CLOSING, _BACK, _FIRM = 0.25, 0.35, 0.4, 0.6, 0.8
# likewise: time constants with which clutch and engine bring the engine to the speed of the new gear
_MATCH = 0.15
# what of that the clutch does where the engine is too slow
_LITTLE = 0.2
# lag of the torque in a shift, when the gearbox asks for it, over that of the pedal's
_QUICK = 0.3
# of the idle speed: where the clutch begins to bite when starting, and over what it closes
_BITE, _CLOSE = 1.0, 0.6
# torque of the idle control per rad/s below idle, over the peak torque
_IDLE_GAIN = 0.03


class Memory(NamedTuple):
    """What changes once per step.

    Attributes:
        torque: (4,) of the motors, or the engine's in the first place, before traction control, N·m.
        gear: engaged or being engaged; 0 neutral, −1 reverse.
        since_shift: s.
        coming: gear that a shift in progress ends in.
    """

    torque: Float[Array, " 4"]
    gear: Float[Array, ""]
    since_shift: Float[Array, ""]
    coming: Float[Array, ""]


class Drive(NamedTuple):
    """What the driveline does at an instant.

    Attributes:
        shaft_torque: (4,) on each wheel from the body (half-shafts), N·m.
        motor_torque: (4,) on each wheel from its carrier (motors in the wheels), N·m.
        derivative: (3,) of engine speed, of the shaft's speed at the gearbox (rad/s²) and of its twist.
        engine_torque: net, at its shaft, N·m.
        clutch_torque: N·m at the engine's side.
        loss: power lost in clutch, gears, differentials and shaft damping, W.
    """

    shaft_torque: Numbers
    motor_torque: Numbers
    derivative: Numbers
    engine_torque: Numbers
    clutch_torque: Numbers
    loss: Numbers


class Driveline(eqx.Module):
    """Pure; the turning parts are (3,): engine speed, shaft speed after the gears (rad/s), twist (rad)."""

    @abstractmethod
    def start(self, wheel_speed: Numbers) -> tuple[Numbers, Memory]:
        """Turning parts and memory of a car at steady speed, foot off the pedal."""

    @abstractmethod
    def advance(
        self, memory: Memory, parts: Numbers, controls: Controls, held_back: Numbers, dt: Numbers
    ) -> Memory:
        """The memory a step later.

        Args:
            memory: now.
            parts: (3,) turning parts.
            controls: the driver's.
            held_back: (4,) share of the torque that traction control leaves, 0 to 1.
            dt: s.
        """

    @abstractmethod
    def drive(self, memory: Memory, parts: Numbers, start: Numbers, to_body: Numbers, dt: Numbers) -> Drive:
        """Torques and derivatives.

        Args:
            memory: in force.
            parts: (3,) turning parts at this instant.
            start: (3,) at the step's start, from which dry friction reckons.
            to_body: (4,) wheel speeds against the body, rad/s.
            dt: from the step's start to where the derivative is used, s.
        """

    @abstractmethod
    def ratio(self, memory: Memory) -> Numbers:
        """Engine speed over wheel speed in mesh with the clutch closed, else 0."""


class WheelMotors(Driveline):
    """A motor in each driven wheel; its torque and power are limited; no recuperation by the pedal.

    Attributes:
        largest_torque: (4,) N·m; 0 where a wheel has no motor.
        corner_speed: rad/s of the wheel from which power limits the torque.
        lag: s.
    """

    largest_torque: Numbers = eqx.field(converter=as_leaf)
    corner_speed: Numbers = eqx.field(converter=as_leaf)
    lag: Numbers = eqx.field(converter=as_leaf)

    def start(self, wheel_speed: Numbers) -> tuple[Numbers, Memory]:
        """As :meth:`Driveline.start`."""
        zero = jnp.zeros((), wheel_speed.dtype)
        return jnp.zeros(3, zero.dtype), Memory(jnp.zeros(4, zero.dtype), zero + 1, zero, zero + 1)

    def advance(
        self, memory: Memory, parts: Numbers, controls: Controls, held_back: Numbers, dt: Numbers
    ) -> Memory:
        """As :meth:`Driveline.advance`."""
        direction = jnp.where(controls.gear == -1, -1, jnp.where(controls.gear == 0, 0, 1))
        asked = direction * controls.throttle * self.largest_torque + controls.wheel_torque
        asked = jnp.clip(asked, -self.largest_torque, self.largest_torque) * held_back
        torque = memory.torque + (asked - memory.torque) * -jnp.expm1(-dt / self.lag)
        return Memory(torque, direction * jnp.ones_like(memory.gear), memory.since_shift, memory.coming)

    def drive(self, memory: Memory, parts: Numbers, start: Numbers, to_body: Numbers, dt: Numbers) -> Drive:
        """As :meth:`Driveline.drive`."""
        zero = jnp.zeros((), to_body.dtype)
        weakened = self.corner_speed / jnp.maximum(jnp.abs(to_body), self.corner_speed)
        torque = memory.torque * weakened
        return Drive(jnp.zeros_like(torque), torque, jnp.zeros(3, zero.dtype), jnp.sum(torque), zero, zero)

    def ratio(self, memory: Memory) -> Numbers:
        """As :meth:`Driveline.ratio`."""
        return memory.gear


class EngineDrive(Driveline):
    """An engine, a clutch, gears, an elastic shaft and differentials; all in the body, as half-shafts need.

    The clutch is dry friction with a capacity: it sticks where the torque to stick is within it. With the
    engine near idle it slips, so that the engine starts the car and never stalls. In a shift it opens as the
    torque is taken away; the engine is then brought to the speed that the new gear asks for, by its own
    torque as far as it can (up, when shifting down) and by the closing clutch, whose capacity in that time is
    just what ends the difference with a time constant. An open differential splits torque evenly, whatever
    the speeds; a limited-slip one adds a torque between its wheels. Reaction: the body takes the moment of
    all shafts; the engine's own inertia torque is neglected.

    Attributes:
        ratios: (26,) engine over wheel speed for reverse (negative), neutral (0) and gears 1 … G; the rest
            is only there for all cars to run the same compiled program.
        gears: G.
        share: (4,) of each wheel in the shaft's torque; their sum is 1.
        efficiency: of the gears.
        engine_inertia, shaft_inertia: kg·m²; the latter of what turns behind the gears, at wheel speed.
        stiffness, damping: of the shafts in sum, at wheel speed, N·m/rad and N·m·s/rad.
        peak_torque: N·m.
        peak_speed, largest_speed, idle_speed: rad/s.
        drag: torque of the engine without throttle over its peak torque, at the largest speed.
        lag: of the torque, s.
        shift_time: s.
        shift_up, shift_down: engine speeds, rad/s.
        slip_torque, slip_limit: of limited-slip differentials, N·m·s/rad and N·m.
    """

    ratios: Numbers = eqx.field(converter=as_leaf)
    gears: Numbers = eqx.field(converter=as_leaf)
    share: Numbers = eqx.field(converter=as_leaf)
    efficiency: Numbers = eqx.field(converter=as_leaf)
    engine_inertia: Numbers = eqx.field(converter=as_leaf)
    shaft_inertia: Numbers = eqx.field(converter=as_leaf)
    stiffness: Numbers = eqx.field(converter=as_leaf)
    damping: Numbers = eqx.field(converter=as_leaf)
    peak_torque: Numbers = eqx.field(converter=as_leaf)
    peak_speed: Numbers = eqx.field(converter=as_leaf)
    largest_speed: Numbers = eqx.field(converter=as_leaf)
    idle_speed: Numbers = eqx.field(converter=as_leaf)
    drag: Numbers = eqx.field(converter=as_leaf)
    lag: Numbers = eqx.field(converter=as_leaf)
    shift_time: Numbers = eqx.field(converter=as_leaf)
    shift_up: Numbers = eqx.field(converter=as_leaf)
    shift_down: Numbers = eqx.field(converter=as_leaf)
    slip_torque: Numbers = eqx.field(converter=as_leaf)
    slip_limit: Numbers = eqx.field(converter=as_leaf)

    def _ratio_of(self, gear: Numbers) -> Numbers:
        return self.ratios[jnp.clip(gear + 1, 0, self.gears + 1).astype(jnp.int32)]

    def start(self, wheel_speed: Numbers) -> tuple[Numbers, Memory]:
        """As :meth:`Driveline.start`: in the lowest gear below the speed of shifting up."""
        shaft = jnp.sum(self.share * wheel_speed)
        fits = self.ratios[2:] * shaft <= self.shift_up
        gear = jnp.where(jnp.any(fits), jnp.argmax(fits) + 1.0, self.gears).astype(shaft.dtype)
        gear = jnp.minimum(gear, self.gears)
        engine = jnp.maximum(self._ratio_of(gear) * shaft, self.idle_speed)
        parts = jnp.stack([engine, shaft, jnp.zeros_like(shaft)])
        return parts, Memory(jnp.zeros(4, shaft.dtype), gear, jnp.full_like(shaft, _REST + 10), gear)

    def advance(
        self, memory: Memory, parts: Numbers, controls: Controls, held_back: Numbers, dt: Numbers
    ) -> Memory:
        """As :meth:`Driveline.advance`."""
        top = self.gears
        speed, since = parts[0], memory.since_shift + dt
        # judged by the speed the engine has, or would have, with the clutch closed
        in_mesh = jnp.abs(self._ratio_of(memory.coming)) * jnp.abs(parts[1])
        rested = since > _REST
        step = jnp.where(rested & (in_mesh > self.shift_up), 1.0, 0.0)
        step = step - jnp.where(rested & (in_mesh < self.shift_down), 1.0, 0.0)
        chosen = jnp.clip(jnp.maximum(memory.coming, 1.0) + step, 1.0, top)
        wanted = jnp.where(controls.gear == AUTOMATIC, chosen, jnp.clip(controls.gear, -1.0, top))
        shifting = (wanted != memory.coming) & (since > self.shift_time)
        since = jnp.where(shifting, 0.0, since)
        coming = jnp.where(shifting, wanted, memory.coming)
        phase = since / self.shift_time
        gear = jnp.where(phase >= _SYNCHRONISED, coming, memory.gear)

        available = self._largest_torque(speed)
        drag = self.drag * self.peak_torque * speed / self.largest_speed
        ratio = self._ratio_of(gear)
        request = jnp.sum(controls.wheel_torque)
        asked = jnp.where(ratio != 0, request / jnp.where(ratio != 0, ratio * self.efficiency, 1.0), 0.0)
        pedal = controls.throttle * (available + drag) - drag
        idle = _IDLE_GAIN * self.peak_torque * jnp.maximum(self.idle_speed - speed, 0)
        target = jnp.clip(pedal + asked, -drag, available)
        held = jnp.sum(self.share * held_back)
        target = jnp.where(target > 0, target * held, target)
        fitting = jnp.maximum(self._ratio_of(coming) * parts[1], self.idle_speed)
        match = self.engine_inertia * (fitting - speed) / (_MATCH * self.shift_time)
        match = jnp.where(phase < _OPEN, 0.0, jnp.clip(match, -drag, available))
        given = match + _given_back(phase) * (target - match) + idle
        lag = jnp.where(phase < 1, _QUICK, 1.0) * self.lag
        torque = memory.torque[0] + (given - memory.torque[0]) * -jnp.expm1(-dt / lag)
        return Memory(memory.torque.at[0].set(torque), gear, since, coming)

    def _largest_torque(self, speed: Numbers) -> Numbers:
        """Flat-topped: falls to 0 at the largest speed, and to 0.6 at standstill."""
        high = (speed - self.peak_speed) / (self.largest_speed - self.peak_speed)
        low = 1 - 0.4 * (1 - jnp.clip(speed / self.peak_speed, 0, 1)) ** 2
        return self.peak_torque * jnp.where(high > 0, jnp.maximum(1 - high**2, 0), low)

    def _capacity(self, memory: Memory, engine_speed: Numbers, apart: Numbers) -> Numbers:
        """Of the clutch, N·m at the engine, for speeds that are ``apart`` (rad/s)."""
        phase = memory.since_shift / self.shift_time
        whole = 2 * self.peak_torque
        borne = jnp.where(phase < _OPEN, 1.0, _given_back(phase)) * jnp.abs(memory.torque[0])
        # an engine that is too slow speeds up by itself: the clutch would brake the car
        slower = jnp.where(apart < 0, _LITTLE, 1.0)
        matching = borne + slower * self.engine_inertia * jnp.abs(apart) / (_MATCH * self.shift_time)
        opening, closing = 1 - phase / _OPEN, jnp.clip((phase - _CLOSING) / (_FIRM - _CLOSING), 0, 1)
        share = jnp.where(phase < _OPEN, opening, closing)
        firm = whole * jnp.maximum(phase - _FIRM, 0) / (1 - _FIRM)
        capacity = jnp.where(phase < 1, jnp.minimum(share * matching + firm, whole), whole)
        bite = (engine_speed / self.idle_speed - _BITE) / _CLOSE
        return jnp.where(memory.gear == 0, 0.0, capacity * jnp.clip(bite, 0, 1))

    def drive(self, memory: Memory, parts: Numbers, start: Numbers, to_body: Numbers, dt: Numbers) -> Drive:
        """As :meth:`Driveline.drive`."""
        ratio = self._ratio_of(memory.gear)
        twisting = parts[1] - jnp.sum(self.share * to_body)
        shaft = self.stiffness * parts[2] + self.damping * twisting
        torque = memory.torque[0]
        apart = start[0] - ratio * start[1]
        capacity = self._capacity(memory, start[0], apart)
        freely = torque / self.engine_inertia + ratio * shaft / self.shaft_inertia
        closing = apart / dt + freely  # has the sign of the clutch's torque
        passed = jnp.where(closing * ratio * parts[1] >= 0, self.efficiency, 1 / self.efficiency)
        compliance = 1 / self.engine_inertia + ratio**2 * passed / self.shaft_inertia
        clutch = jnp.clip(closing / compliance, -capacity, capacity)
        derivative = jnp.stack(
            [
                (torque - clutch) / self.engine_inertia,
                (ratio * clutch * passed - shaft) / self.shaft_inertia,
                twisting,
            ]
        )
        apart_wheels = to_body - to_body[jnp.asarray([1, 0, 3, 2])]
        locking = -jnp.clip(self.slip_torque * apart_wheels, -self.slip_limit, self.slip_limit)
        locking = jnp.where(self.share > 0, locking, 0.0)
        loss = (
            clutch * parts[0]
            - ratio * clutch * passed * parts[1]
            + self.damping * twisting**2
            - jnp.sum(locking * to_body)
        )
        on_wheels = self.share * shaft + locking
        return Drive(on_wheels, jnp.zeros_like(on_wheels), derivative, torque, clutch, loss)

    def ratio(self, memory: Memory) -> Numbers:
        """As :meth:`Driveline.ratio`."""
        closed = memory.since_shift >= self.shift_time
        return jnp.where(closed, self._ratio_of(memory.gear), 0.0)


def _given_back(phase: Numbers) -> Numbers:
    """Share of the driver's torque that the engine gives, at a share of the shift's time."""
    return jnp.clip((phase - _BACK) / (1 - _BACK), 0, 1)
