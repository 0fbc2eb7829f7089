"""A driver who follows a path and holds a speed, or moves steering wheel and pedals as written."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.constants import GRAVITY
from roadstate.sim.manoeuvres.base import Manoeuvre, full_throttle
from roadstate.sim.manoeuvres.path import Path
from roadstate.sim.manoeuvres.script import CLOSED, OPEN, Script
from roadstate.sim.plant.base import NEUTRAL, Controls, Truth
from roadstate.sim.roads.road import Road
from roadstate.sim.speed_law import SpeedLaw

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

Number = Float[Array, ""]

_LAW = SpeedLaw(gain=1.2, integral_gain=0.4, windup=3.0)
_LEAD = 0.15  # s: how far ahead the path's curvature is steered, for what steering and tires lag
_HORIZON = 0.6  # s: in which an error is to be mended
_SHORTEST = 5.0  # m, likewise, at low speed
_DAMPING = 1.6  # twice the damping ratio of that
_INTEGRAL = 0.3  # 1/s: weight of the distance from the path, summed over time
_LARGEST_SUM = 6.0  # m·s
_LARGEST_WHEEL = 9.4  # rad of the steering wheel: a turn and a half
_FASTEST_WHEEL = 17.0  # rad/s: 1000 °/s
_PEDAL_LAG = 0.12  # s
_COASTING = 0.4  # m/s² of slowing down that is left to engine drag
_HOLDING, _STOPPING = 0.35, 0.08  # of the brake pedal, for a car that stands, and that nearly does
_LARGEST_SLIP = 0.1
_NEARLY_STANDING = 0.5  # m/s
_HARD_BRAKING = 12.0  # m/s² at full brake pedal


class Seen(NamedTuple):
    """What a driver sees of the car; scalars.

    Attributes:
        s, d: place along and to the left of the centreline, m.
        heading: against the centreline's, rad, positive to the left.
        speed, velocity_y: in the road plane, m/s.
        grade: rad.
    """

    s: Number
    d: Number
    heading: Number
    speed: Number
    velocity_y: Number
    grade: Number


def seen(road: Road, truth: Truth) -> Seen:
    """What a driver sees of a plant's truth at an instant."""
    turned = truth.attitude[0] - road.at(truth.road[0], jnp.zeros_like(truth.road[0])).heading
    return Seen(
        truth.road[0],
        truth.road[1],
        jnp.arctan2(jnp.sin(turned), jnp.cos(turned)),
        truth.planar_velocity[0],
        truth.planar_velocity[1],
        truth.grade,
    )


class DriverState(NamedTuple):
    """What the driver remembers.

    Attributes:
        integral: of the speed's PI law, m/s².
        aside: of the distance from the path over time, m·s.
        steering_wheel: rad.
        throttle, brake: 0 to 1.
    """

    integral: Number
    aside: Number
    steering_wheel: Number
    throttle: Number
    brake: Number


class Driver(eqx.Module):
    """Pure: the same state, sight and time give the same controls.

    Steering: the curvature of road and path a little ahead, as feed-forward, and that which would bring an
    error e of place and ε of course to zero like a damped oscillator over the distance L = v·T:
    κ = κ_path(s + vτ) − (e + k ∫e dt)/L² − 2ζ ε/L. The steering-wheel angle follows by the formula of the
    steady single-track model, i_s (atan(l κ) + K v² κ) (Gillespie, *Fundamentals of Vehicle Dynamics*,
    ch. 6). The course is the direction in which the car moves, sideslip included.

    Pedals: a PI law on the speed with feed-forward, through a rough idea of what full pedals do.

    Attributes:
        road: of the manoeuvre.
        path: to follow.
        script: what to do when.
        wheelbase: l, m.
        steering_ratio: i_s.
        understeer: K, rad/(m/s²).
        drive_accel: at full throttle and low speed, m/s².
        drive_power: per mass, W/kg, which limits it at higher speed.
        brake_accel: at full brake pedal, m/s².
        slip_stiffness: longitudinal force per slip and load.
    """

    road: Road
    path: Path
    script: Script
    wheelbase: Number
    steering_ratio: Number
    understeer: Number
    drive_accel: Number
    drive_power: Number
    brake_accel: Number
    slip_stiffness: Number

    @classmethod
    def for_vehicle(cls, manoeuvre: Manoeuvre, vehicle: Vehicle) -> Self:
        """The driver of a manoeuvre in a car.

        Args:
            manoeuvre: what to drive.
            vehicle: its wheelbase, steering ratio and understeer gradient are used; how strong its engine is
                follows from its gears as for the plants, and its slip stiffness.
        """
        launch, power = full_throttle(vehicle)
        figures = (
            vehicle.wheelbase,
            1.0 if vehicle.steering is None else vehicle.steering.ratio,
            max(vehicle.understeer_gradient, 0.0),
            launch,
            power,
            _HARD_BRAKING,
            vehicle.tires.slip_stiffness,
        )
        parts = manoeuvre.road, manoeuvre.path, manoeuvre.script
        # NumPy's: hundreds of drivers are made at once
        leaves: list[Any] = [np.asarray(v, jnp.result_type(float)) for v in figures]
        return cls(*parts, *leaves)

    def init(self) -> DriverState:
        """Hands straight, feet off the pedals."""
        zero = jnp.zeros((), self.wheelbase.dtype)
        return DriverState(zero, zero, zero, zero, zero)

    def controls(self, state: DriverState, now: Seen, t: Any, dt: float) -> tuple[DriverState, Controls]:
        """What the driver does at an instant, and the state ``dt`` seconds later.

        Args:
            state: of the driver.
            now: what he sees.
            t: time since the start, s.
            dt: until he is asked again, s.
        """
        cue = self.script.at(t)
        aside, asked = self._steer(now, state.aside, dt)
        reach = _FASTEST_WHEEL * dt
        moved = state.steering_wheel + jnp.clip(asked - state.steering_wheel, -reach, reach)
        moved = jnp.where(cue.steering == CLOSED, moved, state.steering_wheel)
        moved = jnp.where(cue.steering == OPEN, cue.steering_wheel, moved)
        integral, throttle, brake = self._pedals(state, now, cue, dt)
        throttle = jnp.where(cue.pedals == CLOSED, throttle, state.throttle)
        brake = jnp.where(cue.pedals == CLOSED, brake, state.brake)
        throttle = jnp.where(cue.pedals == OPEN, cue.throttle, throttle)
        brake = jnp.where(cue.pedals == OPEN, cue.brake, brake)
        after = DriverState(integral, aside, moved, throttle, brake)
        # what the pedals mean to a plant whose wheels do not turn: the slip for that acceleration;
        # brakes hold, and do not push
        against = jnp.clip(now.speed / _NEARLY_STANDING, -1, 1)
        meant = throttle * self._full_throttle(now.speed) - against * brake * self.brake_accel
        slip = jnp.clip(meant / (self.slip_stiffness * GRAVITY), -_LARGEST_SLIP, _LARGEST_SLIP)
        rolling = jnp.where(cue.gear == NEUTRAL, jnp.minimum(slip, 0), slip)
        return after, Controls.make(
            steering_wheel=moved, throttle=throttle, brake=brake, gear=cue.gear, wheel_slip=rolling
        )

    def _full_throttle(self, speed: Any) -> Any:
        return jnp.minimum(self.drive_accel, self.drive_power / jnp.maximum(speed, 0.1))

    def _steer(self, now: Seen, summed: Any, dt: float) -> tuple[Any, Any]:
        speed = jnp.maximum(now.speed, 0)
        here, ahead = self.path.at(now.s), now.s + _LEAD * speed
        wanted = self.path.at(ahead).curvature + self.road.at(ahead, jnp.zeros_like(ahead)).curvature
        course = now.heading + jnp.arctan2(now.velocity_y, jnp.maximum(speed, 1.0))
        distance = jnp.maximum(_HORIZON * speed, _SHORTEST)
        aside, askew = now.d - here.d, course - jnp.arctan(here.slope)
        summed = jnp.clip(summed + aside * dt, -_LARGEST_SUM, _LARGEST_SUM)
        curvature = wanted - (aside + _INTEGRAL * summed) / distance**2 - _DAMPING * askew / distance
        angle = jnp.arctan(self.wheelbase * curvature) + self.understeer * speed**2 * curvature
        return summed, jnp.clip(self.steering_ratio * angle, -_LARGEST_WHEEL, _LARGEST_WHEEL)

    def _pedals(self, state: DriverState, now: Seen, cue: Any, dt: float) -> tuple[Any, Any, Any]:
        full = self._full_throttle(now.speed)
        uphill = GRAVITY * jnp.sin(now.grade)
        parked = (cue.speed < 0.05) & (now.speed < _NEARLY_STANDING)
        asked = _LAW.asked(state.integral, now.speed, cue.speed, cue.accel) + uphill
        asked = jnp.where(parked, 0.0, asked)
        throttle = jnp.clip(asked / full, 0, 1)
        brake = jnp.where(asked < -_COASTING, jnp.clip(-asked / self.brake_accel, 0, 1), 0.0)
        # on a hill the brake is let go as the engine takes over
        slow = (now.speed < 0.3) & (uphill > 0.05)
        taken = state.throttle * full / jnp.maximum(uphill, 0.05)
        brake = jnp.where(slow, jnp.maximum(brake, _HOLDING * jnp.clip(1.2 - taken, 0, 1)), brake)
        brake = jnp.where(parked, jnp.where(now.speed < 0.05, _HOLDING, _STOPPING), brake)
        share = -jnp.expm1(-dt / _PEDAL_LAG)
        moved = state.throttle + share * (throttle - state.throttle)
        pressed = state.brake + share * (brake - state.brake)
        pressed = jnp.where((brake == 0) & (pressed < 0.005), 0.0, pressed)
        frozen = parked | (asked > full) | (cue.pedals != CLOSED)
        integral = _LAW.advance(state.integral, now.speed, cue.speed, frozen, dt)
        return jnp.where(parked, 0.0, integral), moved, pressed
