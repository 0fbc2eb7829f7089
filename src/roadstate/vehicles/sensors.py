"""How well a car measures, and how well its figures and its roads are known before the drive.

Every default is a choice for an ordinary production car's signals, on the cautious side; a vehicle file
states its own where they are known. A standard deviation of zero is refused where an estimator divides by it.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict

from roadstate.core.quantity import Quantity

_AccelerationDensity = Annotated[float, Quantity("m/s^2/Hz^0.5", 1e-6, 10)]
_Acceleration = Annotated[float, Quantity("m/s^2", 0, 20)]
_Place = Annotated[float, Quantity("m", -20, 20)]
_PlaceError = Annotated[float, Quantity("m", 0.01, 20)]
_YawRateNoise = Annotated[float, Quantity("rad/s", 1e-6, 1)]
_YawRateBias = Annotated[float, Quantity("rad/s", 0, 1)]
_YawAccelerationNoise = Annotated[float, Quantity("rad/s^2", 1e-6, 100)]
_WheelSpeedNoise = Annotated[float, Quantity("rad/s", 1e-6, 10)]
_SpeedNoise = Annotated[float, Quantity("m/s", 1e-6, 50)]
_TorqueNoise = Annotated[float, Quantity("N*m", 0, 1e5)]
_AltitudeNoise = Annotated[float, Quantity("m", 1e-4, 1000)]
_Share = Annotated[float, Quantity("-", 0, 1)]
_Grade = Annotated[float, Quantity("rad", 1e-4, 0.5, is_slope=True)]
_RoadLength = Annotated[float, Quantity("m", 1, 1e5)]
_RollingCoefficient = Annotated[float, Quantity("-", 0, 0.1)]
_PitchGradient = Annotated[float, Quantity("rad/(m/s^2)", 0, 0.05)]
_SteerError = Annotated[float, Quantity("rad", 0, 0.2)]
_WindSpeed = Annotated[float, Quantity("m/s", 0, 50)]
_Duration = Annotated[float, Quantity("s", 0.1, 1e5)]
_ShapeError = Annotated[float, Quantity("-", 0, 0.5)]


class Section(BaseModel):
    """A section of the vehicle file: frozen, no keys but its own, each field's docstring in the schema."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Accelerometer(Section):
    """The accelerometer, as it is on the road: the body's vibration counts as noise."""

    noise_density: _AccelerationDensity = 0.03
    """White noise n: the integral over t seconds has 1σ = n √t, a sample at f Hz has 1σ = n √f"""
    bias: _Acceleration = 0.1
    """1σ of the constant error, mounting angle included (0.1 m/s² is 1 % of grade)"""
    ahead: _Place = 0.0
    """How far ahead of the centre of gravity it sits (used by `joint`)"""
    ahead_std: _PlaceError = 0.3
    """1σ of that"""


class YawRateSensor(Section):
    """The yaw-rate sensor."""

    noise: _YawRateNoise = 0.005
    """1σ of a sample"""
    bias: _YawRateBias = 0.005
    """1σ of the constant error"""


class WheelSpeedSensor(Section):
    """The wheel-speed sensors."""

    noise: _WheelSpeedNoise = 0.1
    """1σ of a sample"""
    scale: _Share = 0.01
    """1σ of the relative error of the speed, from a rolling radius that is not known exactly"""


class SpeedSensor(Section):
    """The speed signal, where there is no wheel speed."""

    noise: _SpeedNoise = 0.15
    """1σ of a sample, rounding included"""


class LateralVelocitySensor(Section):
    """The lateral velocity, where an optical sensor or an inertial navigation measures it."""

    noise: _SpeedNoise = 0.05
    """1σ of a sample"""


class YawAccelerationSensor(Section):
    """The rate of change of the yaw rate, where it is a signal of its own."""

    noise: _YawAccelerationNoise = 0.1
    """1σ of a sample"""


class SteerSensor(Section):
    """The steering angle, as an angle of the front road wheels."""

    noise: _SteerError = 0.002
    """1σ of a sample, with what elastic parts and play change"""
    bias: _SteerError = 0.003
    """1σ of the constant error"""


class TorqueSensor(Section):
    """A torque the car reports."""

    noise: _TorqueNoise = 5.0
    """1σ of the part that does not depend on the torque"""
    bias: _TorqueNoise = 2.0
    """1σ of the constant error: what is told where there is no torque"""
    relative: _Share = 0.05
    """1σ as a share of the torque"""


class WheelTorqueSensor(TorqueSensor):
    """A torque the car reports for a wheel."""

    noise: _TorqueNoise = 20.0
    """1σ of the part that does not depend on the torque"""
    bias: _TorqueNoise = 5.0
    """1σ of the constant error: what is told where there is no torque"""
    relative: _Share = 0.03
    """1σ as a share of the torque"""


class AltitudeSensor(Section):
    """The height from GNSS or barometer."""

    noise: _AltitudeNoise = 2.0
    """1σ of a sample"""
    wander: _AltitudeNoise = 2.0
    """1σ of the error that lasts"""
    wander_time: _Duration = 60.0
    """How long it lasts (its correlation falls to 1/e)"""


class VerticalSpeedSensor(Section):
    """The rate of climb from GNSS."""

    noise: _SpeedNoise = 0.15
    """1σ of a sample"""


class Sensors(Section):
    """How well the car measures."""

    accel: Accelerometer = Accelerometer()
    """Accelerometer"""
    yaw_rate: YawRateSensor = YawRateSensor()
    """Yaw-rate sensor"""
    wheel_speed: WheelSpeedSensor = WheelSpeedSensor()
    """Wheel-speed sensors"""
    speed: SpeedSensor = SpeedSensor()
    """Speed signal"""
    velocity_y: LateralVelocitySensor = LateralVelocitySensor()
    """Lateral velocity"""
    yaw_accel: YawAccelerationSensor = YawAccelerationSensor()
    """Yaw acceleration"""
    steer: SteerSensor = SteerSensor()
    """Steering angle"""
    engine_torque: TorqueSensor = TorqueSensor()
    """Engine's (or motor's) torque as the car reports it"""
    wheel_torque: WheelTorqueSensor = WheelTorqueSensor()
    """Drive torque of a wheel as the car reports it"""
    altitude: AltitudeSensor = AltitudeSensor()
    """Height"""
    vertical_speed: VerticalSpeedSensor = VerticalSpeedSensor()
    """Rate of climb"""


class Prior(Section):
    """What is known before the drive: the roads' grade, and how exact the figures of this file are (1σ)."""

    grade_std: _Grade = 0.08
    """1σ of the grade of the roads driven; 4 % is hilly, 2 % flat country"""
    grade_correlation_length: _RoadLength = 160.0
    """Distance over which the grade of the road stays alike (its correlation falls to one half)"""
    bank_std: _Grade = 0.06
    """1σ of the bank of the roads driven; bends are banked by up to 8 %, straights by 2.5 % to drain"""
    mass_relative: _Share = 0.08
    """1σ of the mass, as a share of it (one to five people and their luggage)"""
    drag_relative: _Share = 0.1
    """1σ of drag coefficient × area × air density, as a share of it (wind not included)"""
    wind_std: _WindSpeed = 2.5
    """1σ of the wind along the car, as high above the road as it is (3.1 m/s from anywhere, SAE J1252)"""
    rolling_resistance_std: _RollingCoefficient = 0.002
    """1σ of the rolling-resistance coefficient"""
    pitch_gradient_std: _PitchGradient = 0.002
    """1σ of the body's pitch gradient"""
    stiffness_relative: _Share = 0.12
    """1σ of the tires' cornering and slip stiffness, as a share of it"""
    tire_shape_std: _ShapeError = 0.15
    """1σ of the tires' shape factor"""
    friction_relative: _Share = 0.15
    """1σ of the tires' peak friction on dry asphalt, as a share of it"""
