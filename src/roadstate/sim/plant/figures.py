"""What a plant needs beyond a vehicle file: figures that may be given, the rest scaled to the vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from roadstate.core.constants import GRAVITY
from roadstate.core.errors import InputError
from roadstate.core.quantity import Quantity
from roadstate.core.yaml_text import read_yaml
from roadstate.vehicles.parameters import Vehicle
from roadstate.vehicles.sensors import Section

_TRUCK = Path(__file__).parent / "truck.yaml"

_Share = Annotated[float, Quantity("-", 0, 1)]
_Multiple = Annotated[float, Quantity("-", 0.05, 5)]
_Radius = Annotated[float, Quantity("-", 0.05, 1)]
_Frequency = Annotated[float, Quantity("Hz", 0.3, 20)]
_Damping = Annotated[float, Quantity("-", 0, 2)]
_Length = Annotated[float, Quantity("m", -2, 2)]
_Travel = Annotated[float, Quantity("m", 0.005, 0.5)]
_Rate = Annotated[float, Quantity("rad/m", -5, 5)]
_Angle = Annotated[float, Quantity("rad", -0.5, 0.5)]
_Stiffness = Annotated[float, Quantity("N/m", 1e3, 1e8)]
_Rotational = Annotated[float, Quantity("N*m/rad", 10, 1e8)]
_Lift = Annotated[float, Quantity("-", -3, 3)]
_Time = Annotated[float, Quantity("s", 1e-3, 5)]
_Torque = Annotated[float, Quantity("N*m", 0, 1e6)]
_Speed = Annotated[float, Quantity("rad/s", 10, 5e3)]
_Pressure = Annotated[float, Quantity("Pa", 1e5, 5e7)]
_Relaxation = Annotated[float, Quantity("m", 0, 5)]
_Text = Annotated[str, Field(max_length=4000)]


class Suspension(Section):
    """Springs, dampers and the paths on which they guide the wheels; one axle."""

    kind: Literal["independent", "rigid_axle"] = "independent"
    """`rigid_axle`: the wheels of the axle move sideways, lean and turn as one body, upright on the road"""
    ride_frequency: _Frequency = 1.3
    """Natural frequency of the body over the axle's springs"""
    damping_bump: _Damping = 0.2
    """Damping ratio of the body over the axle, wheel moving up"""
    damping_rebound: _Damping = 0.4
    """Damping ratio of the body over the axle, wheel moving down"""
    bump_travel: _Travel = 0.07
    """Travel from standing to the bump stop"""
    rebound_travel: _Travel = 0.08
    """Travel from standing to the rebound stop"""
    roll_centre_height: _Length = 0.08
    """Height of the roll centre over the road"""
    camber_per_travel: _Rate | None = None
    """Lean of the wheel's top inwards per travel in bump (cars 0.3…0.7), not of a rigid axle; default 0.45"""
    toe_per_travel: _Rate = 0.0
    """Turn of the wheel inwards per travel in bump"""
    anti_pitch_drive: _Share = 0.2
    """Share of the pitch under drive that the wheel centre's path takes: anti-lift front, anti-squat rear"""
    anti_pitch_brake: _Share = 0.25
    """Share of the pitch under braking that the contact's path takes: anti-dive front, anti-lift rear"""
    unsprung_mass: Annotated[float, Quantity("kg", 1, 5000)] | None = None
    """Mass of one wheel with what moves with it; default 5 % of the car's half (10 % of the car in sum)"""
    spring_track: _Share = 1.0
    """Distance of a rigid axle's springs over its track: what they bear of roll falls with its square"""


class SteeringFigures(Section):
    """Geometry and elasticity of the steering."""

    caster: _Angle = 0.07
    """Angle by which the steering axis leans backwards"""
    kingpin_inclination: _Angle = 0.0
    """Angle by which the steering axis leans inwards"""
    ackermann: _Share = 0.5
    """Share of the difference between the wheels' angles with which both would roll freely on a circle"""
    stiffness: _Rotational | None = None
    """From steering wheel to both road wheels; default: what gives the file's front cornering stiffness"""
    frequency: _Frequency = 12.0
    """Natural frequency of the road wheels on that stiffness"""
    damping: _Damping = 0.5
    """Damping ratio of it"""


class TireFigures(Section):
    """The tires, beyond their property file."""

    like: Literal["passenger", "truck"] = "passenger"
    """Which of the package's tires is scaled to the vehicle"""
    loaded: _Multiple = 0.9
    """Mean static load over the nominal load of the scaled tire"""
    dual_spacing: Annotated[float, Quantity("m", 0.1, 0.6)] = 0.3
    """Distance between the centres of dual tires"""
    vertical_stiffness: _Stiffness | None = None
    """Of one tire; default: 50 times its mean static load per metre (200 kN/m at 4 kN)"""
    vertical_damping: _Damping = 0.05
    """Damping ratio of the unsprung mass on the tire"""
    relaxation_length: _Relaxation | None = None
    """Lateral relaxation length at the static load; default: the vehicle file's"""


class Powertrain(Section):
    """Engine, clutch and gearbox; what does not concern motors in the wheels has no effect there."""

    peak_torque: _Torque | None = None
    """Largest torque of engine or all motors; default: what pushes with `launch` in first gear"""
    launch: _Multiple = 0.5
    """Largest drive force in first gear over the weight"""
    peak_speed: _Speed | None = None
    """Engine speed of it; default 0.45 of the largest"""
    largest_speed: _Speed | None = None
    """Engine speed at which its torque has fallen to zero; default 650, heavy trucks 280"""
    idle_speed: _Speed = 80.0
    """Engine speed held without throttle"""
    lag: _Time = 0.1
    """Time constant of the torque"""
    shift_time: _Time = 0.5
    """From the clutch's opening to its closing"""
    shift_up: _Share = 0.6
    """Share of the largest engine speed at which the automatic gearbox shifts up"""
    shift_down: _Share = 0.25
    """Share of the largest engine speed at which it shifts down"""
    front_share: _Share = 0.5
    """Share of the front axle in the drive torque of an all-wheel drive"""
    limited_slip: Annotated[float, Quantity("N*m*s/rad", 0, 1e5)] = 0.0
    """Torque between the wheels of a driven axle per difference of their speeds; 0 is an open differential"""
    limited_slip_torque: _Torque = 1000.0
    """Largest such torque"""


class Hydraulics(Section):
    """The brake system."""

    largest_pressure: _Pressure | None = None
    """Line pressure at full pedal; default 12 MPa, or what brakes with `hardest` if that is less"""
    hardest: _Multiple = 2.5
    """Brake force at full pedal over the weight, at most"""
    lag: _Time = 0.06
    """Time constant of the pressure at the wheels"""


class Lift(Section):
    """Aerodynamic lift over ½ρAv²."""

    front: _Lift = 0.05
    """Lift coefficient at the front axle, positive upwards"""
    rear: _Lift = 0.08
    """Lift coefficient at the rear axle"""


class Inertia(Section):
    """Radii of gyration of the sprung mass about its centre."""

    roll: _Radius = 0.37
    """Over the mean track"""
    pitch: _Radius = 0.45
    """Over the wheelbase"""


class PlantFigures(Section):
    """All of a plant that no vehicle file holds; every key has a default that suits the vehicle."""

    description: _Text = ""
    """Where the figures come from"""
    front: Suspension = Suspension()
    """Front suspension"""
    rear: Suspension = Suspension(ride_frequency=1.45, roll_centre_height=0.12)
    """Rear suspension"""
    steering: SteeringFigures = SteeringFigures()
    """Steering"""
    tires: TireFigures = TireFigures()
    """Tires"""
    powertrain: Powertrain = Powertrain()
    """Engine, gearbox, differentials"""
    brakes: Hydraulics = Hydraulics()
    """Brakes"""
    lift: Lift = Lift()
    """Lift"""
    inertia: Inertia = Inertia()
    """Inertia"""


_PRESSURE = 1.2e7  # Pa at full pedal
_LARGEST = 100_000


def usual_figures(vehicle: Vehicle, given: PlantFigures | None = None) -> PlantFigures:
    """What is given, completed by what is usual for a vehicle of its kind.

    Args:
        vehicle: with dual rear tires it is taken for a truck: leaf springs on rigid axles, truck tires, a
            diesel engine, compressed-air brakes (``truck.yaml`` beside this module, a plant file itself).
        given: figures that hold whatever the vehicle; only those that were set.

    Raises:
        InputError: figures that do not go together, by themselves or with the usual ones.
    """
    usual = load_plant_figures(_TRUCK) if vehicle.wheels.dual_rear else PlantFigures()
    if given is None:
        return usual
    where = f"{vehicle.name}: plant figures"
    sections: dict[str, Any] = {}
    for name in PlantFigures.model_fields:
        base, own = getattr(usual, name), getattr(given, name)
        if name not in given.model_fields_set:
            sections[name] = base
        elif isinstance(base, Section):
            sections[name] = base.model_dump() | own.model_dump(exclude_unset=True)
        else:
            sections[name] = own
    figures = _validated(sections, where, {})
    for name, axle in (("front", figures.front), ("rear", figures.rear)):
        if axle.kind == "rigid_axle" and axle.camber_per_travel is not None:
            raise InputError(
                "a rigid axle keeps its wheels upright",
                where=f"{where}: {name}.camber_per_travel",
                mend="remove it, or set 'kind: independent'",
            )
        if axle.kind == "independent" and axle.spring_track != 1:
            raise InputError(
                "only a rigid axle has springs off its wheels",
                where=f"{where}: {name}.spring_track",
                mend="remove it, or set 'kind: rigid_axle'",
            )
    return figures


def full_pedal(vehicle: Vehicle, figures: PlantFigures, gains: np.ndarray) -> float:
    """Line pressure at full pedal, Pa.

    Args:
        vehicle: its weight and wheel radius.
        figures: completed ones.
        gains: (4,) torque per pressure of the wheels, N·m/Pa.
    """
    if figures.brakes.largest_pressure is not None:
        return figures.brakes.largest_pressure
    hardest = figures.brakes.hardest * vehicle.mass * GRAVITY * vehicle.wheels.radius
    return min(_PRESSURE, hardest / max(float(gains.sum()), 1e-12))


def load_plant_figures(path: str | Path) -> PlantFigures:
    """The figures that a YAML file gives, defaults for the rest.

    Args:
        path: the file; sections and keys are those of :class:`PlantFigures`, quantities as in a vehicle file.

    Raises:
        InputError: unreadable, not YAML, an unknown key or an impossible value; names key and line.
    """
    where = str(path)
    try:
        with Path(path).open("rb") as file:
            raw = file.read(_LARGEST + 1)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=where, mend="check the path") from error
    if len(raw) > _LARGEST:
        raise InputError(f"is larger than {_LARGEST // 1000} kB", where=where, mend="is it a plant file?")
    try:
        content = read_yaml(raw.decode("utf-8-sig"), where)
    except UnicodeDecodeError as error:
        raise InputError("is not text in UTF-8", where=where, mend="is it a plant file?") from error
    return _validated({k: v for k, v in content.data.items() if v is not None}, where, content.lines)


def _validated(sections: dict[str, Any], where: str, lines: Mapping[Any, int]) -> PlantFigures:
    try:
        return PlantFigures.model_validate(sections)
    except ValidationError as error:
        detail = error.errors(include_url=False, include_input=False)[0]
        key = detail["loc"]
        line = next((lines[key[:n]] for n in range(len(key), 0, -1) if key[:n] in lines), None)
        place = f"{where}, line {line}" if line else where
        name = ".".join(str(k)[:80] for k in key)
        raise InputError(detail["msg"], where=f"{place}: {name}", mend="see docs/plant.md") from None
