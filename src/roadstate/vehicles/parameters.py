"""A car's parameters: frozen, validated, floats in SI. What the vehicle file holds, section by section."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, StringConstraints, model_validator

from roadstate.core.constants import GRAVITY
from roadstate.core.quantity import Quantity, refusal
from roadstate.vehicles.sensors import Prior, Section, Sensors

_Name = Annotated[str, StringConstraints(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f\x7f]*$")]
_Text = Annotated[str, StringConstraints(max_length=4000, pattern=r"^[^\x00-\x08\x0b-\x1f\x7f]*$")]
_Mass = Annotated[float, Quantity("kg", 50, 200e3)]
_YawInertia = Annotated[float, Quantity("kg*m^2", 10, 5e6)]
_PartInertia = Annotated[float, Quantity("kg*m^2", 0, 100)]
_AxleDistance = Annotated[float, Quantity("m", 0.1, 10)]
_Height = Annotated[float, Quantity("m", 0.1, 4)]
_Track = Annotated[float, Quantity("m", 0.5, 4)]
_Radius = Annotated[float, Quantity("m", 0.1, 1.5)]
_AttitudeGradient = Annotated[float, Quantity("rad/(m/s^2)", -0.05, 0.05)]
_SteeringRatio = Annotated[float, Quantity("-", 1, 60)]
_DragCoefficient = Annotated[float, Quantity("-", 0.05, 3)]
_Area = Annotated[float, Quantity("m^2", 0.1, 20)]
_Density = Annotated[float, Quantity("kg/m^3", 0.5, 2)]
_RollingCoefficient = Annotated[float, Quantity("-", 0, 0.5)]
_RollingSpeedCoefficient = Annotated[float, Quantity("s^2/m^2", 0, 1e-4)]
_GearRatio = Annotated[float, Quantity("-", 0.05, 100)]
_Efficiency = Annotated[float, Quantity("-", 0.1, 1)]
_BrakeGain = Annotated[float, Quantity("N*m/Pa", 0, 0.1)]
_CorneringStiffness = Annotated[float, Quantity("1/rad", 1, 100)]
_SlipStiffness = Annotated[float, Quantity("-", 1, 200)]
_Friction = Annotated[float, Quantity("-", 0.02, 3)]
_RelaxationLength = Annotated[float, Quantity("m", 0, 5)]
_Shape = Annotated[float, Quantity("-", 1.05, 1.95)]


class Geometry(Section):
    """Where the centre of gravity (CG) and the wheels are."""

    cg_to_front_axle: _AxleDistance
    """Distance from the CG to the front axle, along x"""
    cg_to_rear_axle: _AxleDistance
    """Distance from the CG to the rear axle, along x"""
    cg_height: _Height
    """Height of the CG above the road"""
    track_front: _Track
    """Distance between the centres of the front wheels"""
    track_rear: _Track
    """Distance between the centres of the rear wheels (of the pairs, with dual tires)"""

    @property
    def wheelbase(self) -> float:
        """L = l_f + l_r in m."""
        return self.cg_to_front_axle + self.cg_to_rear_axle

    @property
    def half_tracks(self) -> tuple[float, float, float, float]:
        """How far to the left each wheel stands, m."""
        front, rear = self.track_front / 2, self.track_rear / 2
        return front, -front, rear, -rear


class Body(Section):
    """How the body leans on its springs: an accelerometer in it then sees a part of gravity."""

    pitch_gradient: _AttitudeGradient = 0.0
    """Nose-up pitch of the body against the wheels, per forward specific force (squat; cars 0.001…0.005)"""
    roll_gradient: _AttitudeGradient = 0.0
    """Roll of the body against the road (right side down) per specific force to the left (0.005…0.014)"""


class Wheels(Section):
    """The wheels; front and rear alike."""

    radius: _Radius
    """Effective rolling radius: speed over wheel speed of a wheel that rolls freely"""
    inertia: _PartInertia
    """Spin inertia of one wheel with tire and brake disc (in-wheel motor: with its rotor)"""
    dual_rear: bool = False
    """Whether each rear wheel position carries two wheels"""


class Steering(Section):
    """The steering."""

    ratio: _SteeringRatio
    """Steering-wheel angle over mean front road-wheel angle"""


class Aerodynamics(Section):
    """Air drag ½ ρ c_d A v²."""

    drag_coefficient: _DragCoefficient
    """Drag coefficient c_d"""
    frontal_area: _Area
    """Frontal area A"""
    air_density: _Density = 1.205
    """Density of the air ρ (1.205 at 20 °C and sea level)"""


class RollingResistance(Section):
    """Rolling resistance over load: f = coefficient + speed_coefficient v²."""

    coefficient: _RollingCoefficient = 0.011
    """Rolling resistance over load at low speed (cars on asphalt 0.008…0.015, trucks 0.005…0.009)"""
    speed_coefficient: _RollingSpeedCoefficient = 0.0
    """Growth of it with the square of the speed"""


class Driveline(Section):
    """From the engine or the motors to the wheels."""

    driven: Literal["front", "rear", "all"]
    """Driven axle"""
    kind: Literal["engine", "in_wheel"] = "engine"
    """`engine`: one engine or motor and its gears; `in_wheel`: a motor in each driven wheel"""
    gear_ratios: Annotated[tuple[_GearRatio, ...], Field(max_length=24)] = ()
    """Ratios of the forward gears, first gear first, without the final drive"""
    reverse_ratio: _GearRatio | None = None
    """Ratio of the reverse gear, given as a positive number"""
    final_drive: _GearRatio = 1.0
    """Ratio of the final drive (1 where gear_ratios are total ratios)"""
    efficiency: _Efficiency = 0.92
    """Power at the wheels over power at the engine, when driving"""
    engine_inertia: _PartInertia = 0.0
    """Inertia of what turns at engine speed: crankshaft, flywheel, clutch or converter"""

    @property
    def drives(self) -> tuple[bool, bool, bool, bool]:
        """Whether a drive acts on each wheel, FL, FR, RL, RR."""
        front, rear = self.driven != "rear", self.driven != "front"
        return front, front, rear, rear

    @property
    def total_ratios(self) -> tuple[float, ...]:
        """Engine speed over wheel speed in each forward gear; empty where no ratios are given."""
        return tuple(ratio * self.final_drive for ratio in self.gear_ratios)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.kind == "in_wheel":
            if self.gear_ratios or self.reverse_ratio is not None:
                key = "gear_ratios" if self.gear_ratios else "reverse_ratio"
                raise refusal(
                    "in-wheel motors have no gearbox",
                    "remove it; a hub reduction is given by 'final_drive'",
                    key,
                )
            if self.engine_inertia:
                raise refusal(
                    "in-wheel motors have no engine", "add the rotor to 'wheels.inertia'", "engine_inertia"
                )
        if any(b >= a for a, b in zip(self.gear_ratios, self.gear_ratios[1:], strict=False)):
            raise refusal("ratios do not fall", "list them from first to top gear", "gear_ratios")
        if len(self.gear_ratios) > 1 and "final_drive" not in self.model_fields_set:
            raise refusal(
                "is missing",
                "give the final drive's ratio (1 if gear_ratios are total ratios)",
                "final_drive",
            )
        return self


class Brakes(Section):
    """Brake torque of one wheel per line pressure."""

    torque_per_pressure_front: _BrakeGain
    """Torque at one front wheel per line pressure (a car's disc: about 20 N*m/bar)"""
    torque_per_pressure_rear: _BrakeGain
    """Torque at one rear wheel per line pressure (a car's disc: about 10 N*m/bar)"""


class Tires(Section):
    """The tires. Stiffnesses are normalised by load, so that axle load × stiffness is the axle's."""

    model: Literal["linear", "dugoff", "modified_dugoff", "normalized_dugoff", "brush"] = "dugoff"
    """Tire model these figures are meant for"""
    cornering_stiffness_front: _CorneringStiffness = 11.0
    """C_α/F_z of the front axle, with its suspension and steering (softer than the rear: understeer)"""
    cornering_stiffness_rear: _CorneringStiffness = 17.0
    """C_α/F_z of the rear axle, with its suspension"""
    slip_stiffness: _SlipStiffness = 22.0
    """C_κ/F_z: longitudinal force per slip and load at small slip"""
    friction: _Friction = 0.9
    """Peak friction coefficient on dry asphalt (0.8 to 0.9: Wong, Theory of Ground Vehicles, tab. 1.3)"""
    shape: _Shape = 1.45
    """Shape factor C of F/(μF_z) = sin(C atan(x/C)), x = slip × stiffness/μ (passenger cars 1.3…1.7)"""
    relaxation_length: _RelaxationLength = 0.4
    """Distance rolled in which the lateral force builds up to 63 %"""


class Vehicle(Section):
    """A car, as its vehicle file describes it.

    Frozen; every figure a float in SI. Construct it by :func:`roadstate.vehicles.load_vehicle`, whose
    refusals are one line for people; the constructor itself raises pydantic's ``ValidationError``.
    """

    name: _Name
    """What the car is called"""
    description: _Text = ""
    """What car it is, in a line"""
    source: _Text = "not stated"
    """Where the figures come from"""
    mass: _Mass
    """Mass of the car as driven, with people and load"""
    yaw_inertia: _YawInertia
    """Moment of inertia about the vertical axis through the CG"""
    geometry: Geometry
    """Where the CG and the wheels are"""
    body: Body = Body()
    """How the body leans on its springs"""
    wheels: Wheels
    """Wheels"""
    steering: Steering | None = None
    """Steering; needed only to use the steering-wheel angle"""
    aerodynamics: Aerodynamics
    """Air drag"""
    rolling_resistance: RollingResistance = RollingResistance()
    """Rolling resistance"""
    driveline: Driveline
    """From the engine to the wheels"""
    brakes: Brakes | None = None
    """Brakes; needed only to use brake pressures"""
    tires: Tires = Tires()
    """Tires"""
    sensors: Sensors = Sensors()
    """How well the car measures"""
    prior: Prior = Prior()
    """What is known before the drive"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        scale = self.mass * self.geometry.cg_to_front_axle * self.geometry.cg_to_rear_axle
        if not 0.1 <= self.yaw_inertia / scale <= 5:
            raise refusal(
                f"{self.yaw_inertia:g} kg*m^2 is {self.yaw_inertia / scale:.2g} times mass·l_f·l_r "
                f"({scale:.0f} kg*m^2); cars lie near 1",
                "check the figure and its unit",
                "yaw_inertia",
            )
        return self

    @property
    def wheelbase(self) -> float:
        """L = l_f + l_r in m."""
        return self.geometry.wheelbase

    @property
    def static_axle_loads(self) -> tuple[float, float]:
        """Load of the front and the rear axle, standing on a level road, in N: m g l_r/L and m g l_f/L."""
        per_metre = self.mass * GRAVITY / self.wheelbase
        return per_metre * self.geometry.cg_to_rear_axle, per_metre * self.geometry.cg_to_front_axle

    @property
    def axle_cornering_stiffness(self) -> tuple[float, float]:
        """Lateral force per slip angle of the front and the rear axle at their static loads, in N/rad."""
        front, rear = self.static_axle_loads
        return front * self.tires.cornering_stiffness_front, rear * self.tires.cornering_stiffness_rear

    @property
    def understeer_gradient(self) -> float:
        """Extra road-wheel angle per lateral acceleration, in rad/(m/s²), positive for understeer.

        K = m l_r/(L C_f) − m l_f/(L C_r), which for stiffness proportional to load is (1/c_f − 1/c_r)/g
        (Gillespie, *Fundamentals of Vehicle Dynamics*, ch. 6).
        """
        return (1 / self.tires.cornering_stiffness_front - 1 / self.tires.cornering_stiffness_rear) / GRAVITY

    @property
    def drag_area(self) -> float:
        """c_d A in m²."""
        return self.aerodynamics.drag_coefficient * self.aerodynamics.frontal_area

    @property
    def drag_factor(self) -> float:
        """½ ρ c_d A in kg/m: air drag over the speed's square."""
        return 0.5 * self.aerodynamics.air_density * self.drag_area

    def effective_mass(self, total_ratio: float = 0.0) -> float:
        """Mass that a longitudinal force has to accelerate, rotating parts included, in kg.

        m + (n I_w + I_e i²)/R² with n wheels, four or, with dual rear tires, six (Gillespie,
        *Fundamentals of Vehicle Dynamics*, ch. 2).

        Args:
            total_ratio: engine speed over wheel speed in mesh; 0 with the driveline open.
        """
        wheels = (6 if self.wheels.dual_rear else 4) * self.wheels.inertia
        rotating = wheels + self.driveline.engine_inertia * total_ratio**2
        return self.mass + rotating / self.wheels.radius**2
