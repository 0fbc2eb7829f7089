"""The contract of a vehicle model: a body that moves in the road plane under the forces of four tires."""

from __future__ import annotations

import dataclasses
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from roadstate.core.channels import WHEELS
from roadstate.core.errors import InputError
from roadstate.tires.base import TireModel, as_leaf
from roadstate.tires.smooth import Numbers, soft_abs
from roadstate.vehicles.kinematics import Planar, to_body, wheel_positions
from roadstate.vehicles.loads import gravity_part, load_slope, vertical_loads
from roadstate.vehicles.named import check_name, named_leaves, with_leaves
from roadstate.vehicles.parameters import Vehicle

# m/s or rad/s below which dry friction fades, so that a derivative exists at rest
_REST = 0.1


def per_wheel(name: str) -> tuple[str, ...]:
    """``name_fl``, ``name_fr``, ``name_rl``, ``name_rr``."""
    return tuple(f"{name}_{wheel}" for wheel in WHEELS)


PLANAR_STATES = ("speed", "velocity_y", "yaw_rate")
"""v_x and v_y of the centre of gravity (m/s), r (rad/s)."""

BODY_OUTPUTS = (
    *PLANAR_STATES,
    *("accel_x", "accel_y", "kinematic_accel_x", "kinematic_accel_y", "yaw_accel"),
    *per_wheel("force_x"),
    *per_wheel("force_y"),
    *per_wheel("load"),
)
"""What every model can tell: see :meth:`VehicleModel.measure`."""


def soft_sign(value: ArrayLike) -> Numbers:
    """The sign of a speed (m/s or rad/s), exact from 0.1 on and C¹ through zero."""
    speed = jnp.asarray(value)
    return speed / soft_abs(speed, _REST)


class Motion(NamedTuple):
    """What the forces do to the body at one instant.

    Attributes:
        accel_x, accel_y: specific force in the body frame: what an accelerometer at the centre of gravity
            reads, the gravity part of a slope included, m/s².
        yaw_accel: ṙ, rad/s².
        F_x, F_y: (4,) tire forces in the wheels' frames, N.
        load: (4,) vertical loads, N.
    """

    accel_x: Numbers
    accel_y: Numbers
    yaw_accel: Numbers
    F_x: Numbers
    F_y: Numbers
    load: Numbers


class Stiff(NamedTuple):
    """What an integrator needs to stay stable with steps far longer than the time constants.

    Attributes:
        derivative: (n,) ẋ.
        dry: (n,) deceleration by dry friction (brakes, rolling resistance) while a state moves, ≥ 0; ẋ holds
            −dry·soft_sign(x).
        damping: (n, n) a matrix that stands in for ∂ẋ/∂x: tire forces over their sliding velocities.
    """

    derivative: Float[Array, " n"]
    dry: Float[Array, " n"]
    damping: Float[Array, "n n"]


class VehicleModel(eqx.Module):
    """A vehicle as ẋ = derivative(x, u), y = output(x, u): frozen, pure, every parameter a leaf.

    m(v̇_x − v_y r) = ΣF_x,body − ½ρ C_dA v_x|v_x| − F_roll − m g sin θ,
    m(v̇_y + v_x r) = ΣF_y,body − m g cos θ sin φ, I_z ṙ = Σ(x_i F_y,i,body − y_i F_x,i,body).

    The rolling resistance slows the body (F_roll) where a model has no wheels that turn; where it has, it is
    a moment on each wheel, and reaches the body through the tire force: once, not twice.

    Args of every method: x (n,) in the order of ``states``, u (k,) in the order of ``inputs``, SI.

    Attributes:
        name: for listings.
        summary: one line.
        states, inputs, outputs: names of the rows; those of canonical channels where there is one.
        optional_inputs: inputs taken as zero where nothing is said of them.
        mass: kg.
        yaw_inertia: kg·m².
        cg_to_front_axle, cg_to_rear_axle: l_f, l_r, m.
        cg_height: h, m.
        track_front, track_rear: m.
        front_roll_share: the front axle's share of the roll moment.
        drag_area: C_dA, m².
        air_density: ρ, kg/m³.
        grade: θ, rad, positive uphill.
        bank: φ, rad, positive with the left side higher.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    states: ClassVar[tuple[str, ...]] = PLANAR_STATES
    inputs: ClassVar[tuple[str, ...]]
    optional_inputs: ClassVar[tuple[str, ...]] = ("steer_rear",)
    outputs: ClassVar[tuple[str, ...]] = BODY_OUTPUTS

    mass: Numbers = eqx.field(converter=as_leaf)
    yaw_inertia: Numbers = eqx.field(converter=as_leaf)
    cg_to_front_axle: Numbers = eqx.field(converter=as_leaf)
    cg_to_rear_axle: Numbers = eqx.field(converter=as_leaf)
    cg_height: Numbers = eqx.field(converter=as_leaf)
    track_front: Numbers = eqx.field(converter=as_leaf)
    track_rear: Numbers = eqx.field(converter=as_leaf)
    front_roll_share: Numbers = eqx.field(converter=as_leaf)
    drag_area: Numbers = eqx.field(converter=as_leaf)
    air_density: Numbers = eqx.field(converter=as_leaf)
    grade: Numbers = eqx.field(converter=as_leaf)
    bank: Numbers = eqx.field(converter=as_leaf)

    @classmethod
    def from_vehicle(cls, vehicle: Vehicle, tire: TireModel | None = None, **parameters: ArrayLike) -> Self:
        """The model with the figures of a vehicle file.

        Args:
            vehicle: the file.
            tire: instead of the one the file names; for models with a tire only.
            parameters: dotted name → value instead of the file's, as :meth:`with_parameters`.

        Raises:
            InputError: a tire for a model without, a tire the file has no figures for, an unknown parameter.
        """
        from roadstate.vehicles.figures import figures, tire_of

        fields = {field.name for field in dataclasses.fields(cls)}
        chosen: dict[str, Any] = {name: value for name, value in figures(vehicle).items() if name in fields}
        if "tire" in fields:
            chosen["tire"] = tire_of(vehicle) if tire is None else tire
        elif tire is not None:
            raise InputError(
                f"'{cls.name}' has no tire: its tire forces are inputs", mend="leave out the tire"
            )
        return cls(**chosen).with_parameters(parameters)

    @property
    def parameters(self) -> dict[str, Numbers]:
        """Every parameter by its dotted name: ``mass``, ``friction``, ``tire.cornering_stiffness`` …"""
        return named_leaves(self)

    def with_parameters(self, values: Mapping[str, ArrayLike]) -> Self:
        """The same model with other parameters.

        Args:
            values: dotted name → value, broadcast to the parameter's shape.

        Raises:
            InputError: an unknown name, or a shape that does not fit.
        """
        return with_leaves(self, values) if values else self

    def input_vector(self, values: Mapping[str, ArrayLike]) -> Float[Array, " k"]:
        """u from its rows by name; those of ``optional_inputs`` may be left out.

        Raises:
            InputError: an input is unknown or missing.
        """
        for name in values:
            check_name(name, self.inputs, f"'{self.name}' has no input")
        missing = [n for n in self.inputs if n not in values and n not in self.optional_inputs]
        if missing:
            raise InputError(f"'{self.name}' lacks its input '{missing[0]}'", mend="give it a value")
        return jnp.stack([jnp.asarray(values.get(name, 0.0), jnp.result_type(float)) for name in self.inputs])

    @property
    def wheel_positions(self) -> Planar:
        """Places of the wheels seen from the centre of gravity: (4,) each, m."""
        return wheel_positions(self.cg_to_front_axle, self.cg_to_rear_axle, self.track_front, self.track_rear)

    def wheel_loads(self, accel_x: ArrayLike, accel_y: ArrayLike) -> Numbers:
        """(..., 4) vertical loads under the specific forces (m/s²), N."""
        return vertical_loads(self, accel_x, accel_y)

    @property
    def load_slope(self) -> Numbers:
        """(2, 4) load per specific force along x and y while all wheels stand on the road, N per m/s²."""
        return load_slope(self)

    @abstractmethod
    def motion(self, x: Float[Array, " n"], u: Float[Array, " k"]) -> Motion:
        """Forces and accelerations."""

    def derivative(self, x: Float[Array, " n"], u: Float[Array, " k"]) -> Float[Array, " n"]:
        """ẋ in the units of x per second."""
        return self._derivative(x, u, self.motion(x, u))

    def output(self, x: Float[Array, " n"], u: Float[Array, " k"]) -> Float[Array, " p"]:
        """Every output, in the order of ``outputs``."""
        values = self.measure(x, u)
        return jnp.stack([values[name] for name in self.outputs])

    def measure(self, x: Float[Array, " n"], u: Float[Array, " k"]) -> dict[str, Numbers]:
        """Every output by name, so that what is not read is not computed.

        ``accel_x``, ``accel_y`` are specific forces, as an accelerometer reads; ``kinematic_accel_x`` =
        v̇_x − v_y r and ``kinematic_accel_y`` = v̇_y + v_x r lack gravity. ``force_x``, ``force_y`` are in the
        wheels' frames.
        """
        return self._outputs(x, u, self.motion(x, u))

    def stiff(self, x: Float[Array, " n"], u: Float[Array, " k"]) -> Stiff:
        """ẋ with what an implicit step needs beside it; without tires in the model nothing is stiff."""
        n = len(self.states)
        return Stiff(self.derivative(x, u), jnp.zeros(n, x.dtype), jnp.zeros((n, n), x.dtype))

    @property
    def wheelbase(self) -> Numbers:
        """Distance of the axles, m."""
        return self.cg_to_front_axle + self.cg_to_rear_axle

    def drag(self, speed: ArrayLike) -> Numbers:
        """Air drag against the speed (m/s), N, with its sign."""
        v_x = jnp.asarray(speed)
        return 0.5 * self.air_density * self.drag_area * v_x * jnp.abs(v_x)

    def _body(self, F_x: Numbers, F_y: Numbers, steer: Numbers, resistance: Numbers) -> tuple[Numbers, ...]:
        """Specific forces along x and y and ṙ, from tire forces in the wheels' frames and a resistance."""
        force, place = to_body(F_x, F_y, steer), self.wheel_positions
        return (
            (jnp.sum(force.x) - resistance) / self.mass,
            jnp.sum(force.y) / self.mass,
            jnp.sum(place.x * force.y - place.y * force.x) / self.yaw_inertia,
        )

    def _kinematic(self, motion: Motion) -> tuple[Numbers, Numbers]:
        along, across, _ = gravity_part(self.grade, self.bank)
        return motion.accel_x - along, motion.accel_y - across

    def _derivative(self, x: Numbers, u: Numbers, motion: Motion) -> Numbers:
        accel_x, accel_y = self._kinematic(motion)
        return jnp.stack([accel_x + x[1] * x[2], accel_y - x[0] * x[2], motion.yaw_accel])

    def _outputs(self, x: Numbers, u: Numbers, motion: Motion) -> dict[str, Numbers]:
        kinematic_x, kinematic_y = self._kinematic(motion)
        scalars = (*x[:3], motion.accel_x, motion.accel_y, kinematic_x, kinematic_y, motion.yaw_accel)
        return dict(zip(BODY_OUTPUTS, (*scalars, *motion.F_x, *motion.F_y, *motion.load), strict=True))
