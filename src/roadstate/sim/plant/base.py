"""What every plant offers: a car that is put on a road, driven by its controls, and tells the truth."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from roadstate.core import numerics as numerics  # float64 before the first array
from roadstate.sim.plant.vectors import cross

AUTOMATIC = 100
"""Gear request that leaves the choice to the gearbox."""
NEUTRAL = 0
REVERSE = -1


class RoadPoint(Protocol):
    """What a plant asks of a road at points: arrays of the points' shape, m, rad and 1/m."""

    @property
    def x(self) -> Any:
        """East."""

    @property
    def y(self) -> Any:
        """North."""

    @property
    def z(self) -> Any:
        """Up, unevenness included."""

    @property
    def heading(self) -> Any:
        """Direction of the centreline, rad, from x towards y."""

    @property
    def curvature(self) -> Any:
        """Curvature of the centreline, 1/m, positive to the left."""

    @property
    def dz_ds(self) -> Any:
        """∂z/∂s."""

    @property
    def dz_dd(self) -> Any:
        """∂z/∂d."""

    @property
    def friction(self) -> Any:
        """Peak friction coefficient."""


class Road(Protocol):
    """A surface over a centreline; s (m) is its length in plan view, d (m) the distance to its left."""

    def at(self, s: Any, d: Any) -> Any:
        """The :class:`RoadPoint` at points."""


class Controls(NamedTuple):
    """What the driver, or whoever stands in for one, does; scalars unless said otherwise.

    Attributes:
        steering_wheel: angle of the steering wheel, rad, positive to the left.
        throttle: accelerator pedal, 0 to 1.
        brake: brake pedal, 0 to 1.
        gear: 1 … G, :data:`NEUTRAL`, :data:`REVERSE` or :data:`AUTOMATIC`.
        wheel_torque: (4,) drive torque asked of each wheel on top of the pedal's, N·m. An engine
            gives the sum, as far as its gear and differentials let it.
        brake_pressure: (4,) line pressure asked of each wheel on top of the pedal's, Pa.
        wheel_slip: (4,) for the plant whose wheels do not turn: their practical slip κ; else without effect.
    """

    steering_wheel: Float[Array, ""]
    throttle: Float[Array, ""]
    brake: Float[Array, ""]
    gear: Float[Array, ""]
    wheel_torque: Float[Array, " 4"]
    brake_pressure: Float[Array, " 4"]
    wheel_slip: Float[Array, " 4"]

    @classmethod
    def make(
        cls,
        *,
        steering_wheel: ArrayLike = 0.0,
        throttle: ArrayLike = 0.0,
        brake: ArrayLike = 0.0,
        gear: ArrayLike = AUTOMATIC,
        wheel_torque: ArrayLike = 0.0,
        brake_pressure: ArrayLike = 0.0,
        wheel_slip: ArrayLike = 0.0,
    ) -> Controls:
        """Controls from what is not zero; scalars or (T,), and (4,) or (T, 4) where per wheel."""
        numbers = jnp.result_type(float)
        scalars = (steering_wheel, throttle, brake, gear)
        wheels = (wheel_torque, brake_pressure, wheel_slip)
        columns = [jnp.asarray(a, numbers) for a in scalars]
        rows = [jnp.asarray(a, numbers) for a in wheels]
        shape = jnp.broadcast_shapes(*(a.shape for a in columns), *(a.shape[:-1] for a in rows))
        return cls(
            *(jnp.broadcast_to(a, shape) for a in columns), *(jnp.broadcast_to(a, (*shape, 4)) for a in rows)
        )


class Truth(NamedTuple):
    """What is really so at one instant; SI, ISO 8855, wheels fl, fr, rl, rr.

    What a plant does not have is NaN from first to last, and no sensor records it.

    Attributes:
        position: (3,) centre of gravity (CG) in the world, z up, m.
        attitude: (3,) yaw ψ, pitch θ (positive nose down) and roll φ (positive right side down), applied in
            that order, rad.
        road: (2,) s and d of the CG, m.
        velocity: (3,) of the CG along the body's axes, m/s.
        angular_rate: (3,) roll, pitch and yaw rate about the body's axes, rad/s.
        specific_force: (3,) what an ideal accelerometer at the CG, fixed to the body, reads, m/s².
        angular_accel: (3,) derivative of ``angular_rate``, rad/s².
        planar_velocity: (2,) v_x and v_y in the road plane along the car's heading, m/s: what planar models
            call so.
        grade: slope of the road under the car along its heading, rad, positive uphill.
        bank: bank of the road under the car, rad, positive with the left side higher.
        wheel_speed: (4,) speed of the wheels against their carriers, as a sensor sees it, rad/s.
        steer: (4,) angle of each wheel to the body, rad.
        force_x, force_y, load: (4,) force of the road in the wheels' frames (along the wheel in the
            road plane, across it, normal to the road), N.
        force_body: (4, 3) the same force in the body's axes, N.
        slip: (4,) practical slip κ.
        slip_angle: (4,) slip angle α, rad.
        camber: (4,) inclination against the road, rad, positive when the top leans to the right.
        friction: (4,) peak friction coefficient under each wheel.
        drive_torque, brake_torque: (4,) on each wheel, N·m; the brake's with the sign of what it does.
        brake_pressure: (4,) at each wheel, Pa.
        travel: (4,) of the suspension, m, positive in bump.
        engine_speed: rad/s; NaN where there are motors in the wheels.
        engine_torque: net, at its shaft, N·m; of motors in the wheels their sum.
        gear: in mesh; 0 is neutral.
        gear_ratio: engine speed over wheel speed of the gear in mesh with the clutch closed, else 0.
    """

    position: Float[Array, " 3"]
    attitude: Float[Array, " 3"]
    road: Float[Array, " 2"]
    velocity: Float[Array, " 3"]
    angular_rate: Float[Array, " 3"]
    specific_force: Float[Array, " 3"]
    angular_accel: Float[Array, " 3"]
    planar_velocity: Float[Array, " 2"]
    grade: Float[Array, ""]
    bank: Float[Array, ""]
    wheel_speed: Float[Array, " 4"]
    steer: Float[Array, " 4"]
    force_x: Float[Array, " 4"]
    force_y: Float[Array, " 4"]
    load: Float[Array, " 4"]
    force_body: Float[Array, "4 3"]
    slip: Float[Array, " 4"]
    slip_angle: Float[Array, " 4"]
    camber: Float[Array, " 4"]
    friction: Float[Array, " 4"]
    drive_torque: Float[Array, " 4"]
    brake_torque: Float[Array, " 4"]
    brake_pressure: Float[Array, " 4"]
    travel: Float[Array, " 4"]
    engine_speed: Float[Array, ""]
    engine_torque: Float[Array, ""]
    gear: Float[Array, ""]
    gear_ratio: Float[Array, ""]

    def specific_force_at(self, mounting: ArrayLike) -> Float[Array, "... 3"]:
        """What an ideal accelerometer reads that is fixed to the body elsewhere, along the body's axes, m/s².

        f + ω̇ × r + ω × (ω × r).

        Args:
            mounting: (3,) r, its place seen from the CG along the body's axes, m.
        """
        r = jnp.broadcast_to(jnp.asarray(mounting, self.velocity.dtype), self.velocity.shape)
        spun = cross(self.angular_rate, r, axis=-1)
        turned = cross(self.angular_accel, r, axis=-1)
        return self.specific_force + turned + cross(self.angular_rate, spun, axis=-1)


class Plant(Protocol):
    """A car to be driven. Pure; every parameter is a leaf of the plant: ``vmap`` works over any."""

    def init(self, road: Road, speed: ArrayLike, s: ArrayLike = 0.0, d: ArrayLike = 0.0) -> Any:
        """The state of a car in equilibrium, heading along the road.

        Args:
            road: that it stands on.
            speed: of the CG, m/s; at zero it is held by its brakes.
            s, d: where its CG is, m.
        """

    def step(self, road: Road, state: Any, controls: Controls, dt: float) -> Any:
        """The state ``dt`` seconds later, the controls held meanwhile.

        Args:
            road: that it drives on.
            state: from ``init`` or ``step``.
            controls: of scalars and (4,).
            dt: a multiple of the plant's inner step, s.
        """

    def truth(self, road: Road, state: Any, controls: Controls) -> Truth:
        """What is so at this instant under these controls."""
