"""The simpler plants: what the papers' estimators assume, driven through the same interface."""

from __future__ import annotations

from typing import Any, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from roadstate.core.channels import WHEELS
from roadstate.core.constants import GRAVITY
from roadstate.core.errors import InputError
from roadstate.sim.plant.base import Controls, Road, Truth
from roadstate.sim.plant.figures import full_pedal, usual_figures
from roadstate.sim.plant.vectors import rotation
from roadstate.tires.base import TireModel, as_leaf
from roadstate.tires.smooth import Numbers
from roadstate.vehicles.integrate import Integrator, LinearlyImplicit
from roadstate.vehicles.kinematics import to_body as wheel_to_body
from roadstate.vehicles.loads import gravity_part
from roadstate.vehicles.parameters import Vehicle
from roadstate.vehicles.seven_dof import SevenDof
from roadstate.vehicles.three_dof import ThreeDof

_LAUNCH = 0.5  # largest drive force over weight, as the reference plant's
_PRESSURE = 1.2e7  # Pa with which brakes stop the car that are in no file


class PlanarState(NamedTuple):
    """What a planar plant remembers.

    Attributes:
        x: (7,) or (3,) states of the vehicle model.
        pose: (3,) x, y (m) and heading (rad) in the world.
        road: (2,) s and d of the CG, m.
    """

    x: Float[Array, " n"]
    pose: Float[Array, " 3"]
    road: Float[Array, " 2"]


class _Under(NamedTuple):
    """The road under a car: (2,) its slopes ahead and aside, heading, curvature, z, and friction (4,)."""

    slope: Numbers
    heading: Numbers
    curvature: Numbers
    z: Numbers
    friction: Numbers


class PlanarPlant(eqx.Module):
    """A planar vehicle model on a road: no body that moves on springs, torques and pressures without lag.

    The car lies in the tangent plane of the road under its CG; the road's vertical curvature is not felt.
    Torques act on the wheels: there is no engine and no gearbox, and of the gears only forward, neutral and
    reverse. Wheels whose slips are the controls do not turn: no speeds, torques or pressures.

    Attributes:
        model: :class:`SevenDof` or :class:`ThreeDof`; its grade, bank and friction come from the road.
        steering_ratio: steering-wheel angle over road-wheel angle.
        largest_torque: (4,) at full throttle, N·m.
        brake_gain: (4,) torque per pressure, N·m/Pa.
        largest_pressure: at full pedal, Pa.
        integrator: of the model.
        inner_step: s.
    """

    model: SevenDof | ThreeDof
    steering_ratio: Numbers = eqx.field(converter=as_leaf)
    largest_torque: Numbers = eqx.field(converter=as_leaf)
    brake_gain: Numbers = eqx.field(converter=as_leaf)
    largest_pressure: Numbers = eqx.field(converter=as_leaf)
    integrator: Integrator = eqx.field(default_factory=LinearlyImplicit)
    inner_step: float = eqx.field(default=0.001, static=True)

    @classmethod
    def seven_dof(cls, vehicle: Vehicle, tire: TireModel | None = None, **parameters: ArrayLike) -> Self:
        """v_x, v_y, r and four wheel spins: the papers' 7-DOF vehicle.

        Args:
            vehicle: the file.
            tire: instead of the one the file names, for instance a :class:`roadstate.tires.NormalizedDugoff`.
            parameters: as :meth:`roadstate.vehicles.VehicleModel.from_vehicle`.
        """
        return cls._of(SevenDof.from_vehicle(vehicle, tire, **parameters), vehicle)

    @classmethod
    def three_dof(cls, vehicle: Vehicle, tire: TireModel | None = None, **parameters: ArrayLike) -> Self:
        """v_x, v_y, r, with the wheels' slips as controls; arguments as :meth:`seven_dof`."""
        return cls._of(ThreeDof.from_vehicle(vehicle, tire, **parameters), vehicle)

    @classmethod
    def _of(cls, model: SevenDof | ThreeDof, vehicle: Vehicle) -> Self:
        if vehicle.steering is None:
            raise InputError("no steering", where=vehicle.name, mend="give 'steering.ratio'")
        share = {"front": (1, 1, 0, 0), "rear": (0, 0, 1, 1), "all": (0.5, 0.5, 0.5, 0.5)}
        weight = vehicle.mass * GRAVITY * vehicle.wheels.radius
        brakes = vehicle.brakes
        gains = np.full(2, 0.3 * weight / _PRESSURE)
        if brakes is not None:
            gains = np.array([brakes.torque_per_pressure_front, brakes.torque_per_pressure_rear])
        return cls(
            model=model,
            steering_ratio=as_leaf(vehicle.steering.ratio),
            largest_torque=as_leaf(0.5 * _LAUNCH * weight * np.array(share[vehicle.driveline.driven])),
            brake_gain=as_leaf(np.repeat(gains, 2)),
            largest_pressure=as_leaf(full_pedal(vehicle, usual_figures(vehicle), np.repeat(gains, 2))),
        )

    def _inputs(self, controls: Controls) -> dict[str, Any]:
        steer = {"steer": controls.steering_wheel / self.steering_ratio}
        if isinstance(self.model, ThreeDof):
            return steer | {f"slip_{w}": controls.wheel_slip[i] for i, w in enumerate(WHEELS)}
        direction = jnp.where(controls.gear == -1, -1.0, jnp.where(controls.gear == 0, 0.0, 1.0))
        drive = direction * controls.throttle * self.largest_torque + controls.wheel_torque
        brake = self.brake_gain * self._pressure(controls)
        torques = {f"drive_torque_{w}": drive[i] for i, w in enumerate(WHEELS)}
        return steer | torques | {f"brake_torque_{w}": brake[i] for i, w in enumerate(WHEELS)}

    def _pressure(self, controls: Controls) -> Numbers:
        return jnp.maximum(controls.brake * self.largest_pressure + controls.brake_pressure, 0)

    def _under(self, road: Road, state: PlanarState) -> _Under:
        s, d = state.road
        centre, places = road.at(s, d), self.model.wheel_positions
        turn = state.pose[2] - centre.heading
        cos, sin = jnp.cos(turn), jnp.sin(turn)
        ahead, aside = places.x * cos - places.y * sin, places.x * sin + places.y * cos
        along = ahead / jnp.maximum(1 - centre.curvature * (d + aside), 0.1)
        wheels = road.at(s + along, d + aside - 0.5 * centre.curvature * ahead * along)
        rise = centre.dz_ds / (1 - centre.curvature * d)
        slope = jnp.stack([rise * cos + centre.dz_dd * sin, centre.dz_dd * cos - rise * sin])
        return _Under(slope, centre.heading, centre.curvature, centre.z, wheels.friction)

    def _on(self, under: _Under) -> tuple[SevenDof | ThreeDof, Numbers, Numbers]:
        grade = jnp.arctan(under.slope[0])
        bank = jnp.arctan(under.slope[1] * jnp.cos(grade))
        fields = {"grade": grade, "bank": bank, "friction": under.friction}
        return self.model.with_parameters(fields), grade, bank

    def init(self, road: Road, speed: ArrayLike, s: ArrayLike = 0.0, d: ArrayLike = 0.0) -> PlanarState:
        """As :meth:`roadstate.sim.plant.base.Plant.init`."""
        v, s, d = (jnp.asarray(a, jnp.result_type(float)) for a in (speed, s, d))
        zero = jnp.zeros_like(v)
        x = jnp.stack([v, zero, zero])
        if isinstance(self.model, SevenDof):
            x = jnp.concatenate([x, v / self.model.wheel_radius])
        point = road.at(s, d)
        return PlanarState(x, jnp.stack([point.x, point.y, point.heading]), jnp.stack([s, d]))

    def _move(self, under: _Under, state: PlanarState, grade: Numbers) -> tuple[Numbers, Numbers]:
        v_x, v_y, r = state.x[:3]
        forward = v_x * jnp.cos(grade)  # seen from above
        yaw = state.pose[2]
        pose = jnp.stack(
            [forward * jnp.cos(yaw) - v_y * jnp.sin(yaw), forward * jnp.sin(yaw) + v_y * jnp.cos(yaw), r]
        )
        turn = yaw - under.heading
        ahead = forward * jnp.cos(turn) - v_y * jnp.sin(turn)
        aside = forward * jnp.sin(turn) + v_y * jnp.cos(turn)
        return pose, jnp.stack([ahead / (1 - under.curvature * state.road[1]), aside])

    def inner(self, road: Road, state: PlanarState, controls: Controls, dt: ArrayLike) -> PlanarState:
        """One step: the model by its integrator, the place by the trapezoidal rule."""
        h = jnp.asarray(dt, state.x.dtype)
        under = self._under(road, state)
        model, grade, _ = self._on(under)
        x = self.integrator.step(model, state.x, model.input_vector(self._inputs(controls)), h)
        pose, way = self._move(under, state, grade)
        ahead = PlanarState(x, state.pose + h * pose, state.road + h * way)
        turned = under._replace(heading=under.heading + under.curvature * h * way[0])
        pose_next, way_next = self._move(turned, ahead, grade)
        return PlanarState(x, state.pose + h / 2 * (pose + pose_next), state.road + h / 2 * (way + way_next))

    def step(self, road: Road, state: PlanarState, controls: Controls, dt: float) -> PlanarState:
        """As :meth:`roadstate.sim.plant.base.Plant.step`."""
        count = round(dt / self.inner_step)

        def one(now: PlanarState, _: None) -> tuple[PlanarState, None]:
            return self.inner(road, now, controls, self.inner_step), None

        return jax.lax.scan(one, state, None, length=count)[0]

    def truth(self, road: Road, state: PlanarState, controls: Controls) -> Truth:
        """As :meth:`roadstate.sim.plant.base.Plant.truth`; the body lies in the road plane."""
        under = self._under(road, state)
        model, grade, bank = self._on(under)
        inputs = self._inputs(controls)
        values = model.measure(state.x, model.input_vector(inputs))

        def wheels(name: str) -> Numbers:
            return jnp.stack([jnp.asarray(values[f"{name}_{w}"]) for w in WHEELS])

        zero, zeros = jnp.zeros((), state.x.dtype), jnp.zeros(4, state.x.dtype)
        absent = jnp.full_like(zero, jnp.nan)
        steer = jnp.stack([inputs["steer"], inputs["steer"], zero, zero])
        along, across, load = wheels("force_x"), wheels("force_y"), wheels("load")
        body = wheel_to_body(along, across, steer)
        attitude = jnp.stack([state.pose[2], -grade, bank])
        R = rotation(attitude)
        height = jnp.stack([zero, zero, self.model.cg_height])
        above = jnp.stack([state.pose[0], state.pose[1], under.z]) + R @ height
        speeds = drive = brake = pressure = jnp.full_like(zeros, jnp.nan)
        if isinstance(self.model, SevenDof):
            speeds, pressure = state.x[3:7], self._pressure(controls)
            drive = jnp.stack([inputs[f"drive_torque_{w}"] for w in WHEELS])
            brake = -self.brake_gain * pressure * jnp.sign(speeds)
        return Truth(
            position=above,
            attitude=attitude,
            road=state.road,
            velocity=jnp.stack([state.x[0], state.x[1], zero]),
            angular_rate=jnp.stack([zero, zero, state.x[2]]),
            specific_force=jnp.stack([values["accel_x"], values["accel_y"], gravity_part(grade, bank)[2]]),
            angular_accel=jnp.stack([zero, zero, jnp.asarray(values["yaw_accel"])]),
            planar_velocity=state.x[:2],
            grade=grade,
            bank=bank,
            wheel_speed=speeds,
            steer=steer,
            force_x=along,
            force_y=across,
            load=load,
            force_body=jnp.stack([body.x, body.y, load], axis=1),
            slip=wheels("slip"),
            slip_angle=wheels("slip_angle"),
            camber=zeros,
            friction=under.friction,
            drive_torque=drive,
            brake_torque=brake,
            brake_pressure=pressure,
            travel=zeros,
            engine_speed=absent,
            engine_torque=absent,
            gear=jnp.clip(controls.gear, -1.0, 1.0),
            gear_ratio=absent,
        )
