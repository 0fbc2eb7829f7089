"""What may stand in a mapping file: its sections, checked key by key."""

from __future__ import annotations

from collections.abc import Mapping as AbstractMapping
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    Tag,
    field_validator,
    model_validator,
)

from roadstate.core import CHANNELS, InputError, channel
from roadstate.core.channels import RATES, SPECIFIC_FORCES
from roadstate.core.quantity import Quantity
from roadstate.core.units import convert
from roadstate.io.lever_arm import LeverArm
from roadstate.io.mapping_channel import ChannelMap, Section, Text, check_units
from roadstate.io.rotation import Rotation

IMU_CHANNELS = {"accel": SPECIFIC_FORCES, "gyro": RATES}
"""The channels that each kind of inertial sensor becomes, in the order x, y, z of the car."""


class Axes(Section):
    """A sensor's three axes, as the sensor names them; those not needed may be left out.

    Settings of a channel (``unit``, ``valid``, ``delay`` …) written beside the axes hold for each of them
    that does not say otherwise.
    """

    x: ChannelMap | None = None
    y: ChannelMap | None = None
    z: ChannelMap | None = None

    @model_validator(mode="before")
    @classmethod
    def _share_settings(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        shared = {k: v for k, v in value.items() if k not in cls.model_fields}
        axes = {
            k: {"from": v} if isinstance(v, str | list) else v for k, v in value.items() if k not in shared
        }
        merged = {k: {**shared, **v} if isinstance(v, dict) else v for k, v in axes.items()}
        return merged or value

    @model_validator(mode="after")
    def _some(self) -> Axes:
        if self.x is None and self.y is None and self.z is None:
            raise InputError("no axis is given", mend="give x, y and z")
        return self


class Imu(Section):
    """An inertial sensor whose axes the rotation turns into the car's.

    Attributes:
        accel: specific force along the sensor's axes → ``accel_x``, ``accel_y``, ``accel_z``.
        gyro: rotation rates about the sensor's axes → ``roll_rate``, ``pitch_rate``, ``yaw_rate``.
    """

    accel: Axes | None = None
    gyro: Axes | None = None

    @model_validator(mode="after")
    def _fitting_units(self) -> Imu:
        if self.accel is None and self.gyro is None:
            raise InputError("no sensor is given", mend="give accel, gyro or both")
        for kind, names in IMU_CHANNELS.items():
            for axis in "xyz":
                if (spec := getattr(getattr(self, kind), axis, None)) is not None:
                    check_units(spec, names[0], f"{kind}.{axis}")
        return self


class SlopeMap(Section):
    """A grade derived from height over travelled distance (see :mod:`roadstate.io.reference`).

    Attributes:
        slope_of: the height, in m.
        speed: the speed whose integral is the distance.
        over: m of road, centred, over which the slope is taken.
        min_speed: m/s below which there is none.
    """

    slope_of: ChannelMap
    speed: ChannelMap
    over: Annotated[float, Quantity("m", 1, 10_000)]
    min_speed: Annotated[float, Quantity("m/s", 0.1, 100)] = 5.0

    @model_validator(mode="after")
    def _fitting_units(self) -> SlopeMap:
        check_units(self.slope_of, "altitude", "slope_of")
        check_units(self.speed, "speed", "speed")
        return self


class TimeMap(Section):
    """How time is read.

    Attributes:
        column: name of the time column of a tabular file.
        unit: its unit, where its header gives none.
        repair: ``error`` refuses time that repeats or runs backward, ``drop`` leaves such samples out.
        held: what becomes of samples that a slower signal repeats until its next one: ``drop`` takes each
            once, ``keep`` takes every row for a sample.
    """

    column: Text | None = None
    unit: Text | None = None
    repair: Literal["error", "drop"] = "error"
    held: Literal["drop", "keep"] = "drop"

    @field_validator("unit")
    @classmethod
    def _is_time(cls, unit: str | None) -> str | None:
        if unit is not None:
            convert(0.0, unit, "s")
        return unit


def _fill_from(section: Any) -> Any:
    """Give channels that name no signal their own name to look for; an empty section has none."""
    if not isinstance(section, dict):
        return {} if section is None else section
    return {
        k: {"from": k, **v} if isinstance(v, dict) and not {"from", "slope_of"} & v.keys() else v
        for k, v in section.items()
    }


def _check_names(section: AbstractMapping[str, Any]) -> AbstractMapping[str, Any]:
    for name, spec in section.items():
        channel(name)
        if name == "time":
            raise InputError("time is no channel", mend="use the section 'time:' instead")
        if isinstance(spec, ChannelMap):
            check_units(spec, name, name)
        elif name != "ref_grade":
            raise InputError("slope_of makes a grade", where=name, mend="list it under ref_grade")
    return section


def _kind(value: Any) -> str:
    is_slope = isinstance(value, SlopeMap) or (isinstance(value, dict) and "slope_of" in value)
    return "slope" if is_slope else "map"


ReferenceMap = Annotated[
    Annotated[ChannelMap, Tag("map")] | Annotated[SlopeMap, Tag("slope")], Discriminator(_kind)
]


class Sections(Section):
    """The whole of a mapping file.

    Attributes:
        time: how time is read.
        channels: canonical channel → where it comes from.
        rotation: from the axes of the sensors under ``imu`` to the car's.
        imu: inertial sensors whose axes are not the car's.
        lever_arm: from the centre of gravity to the accelerometer.
        reference: truth to compare with: ``ref_*`` channels, as they are or derived.
        only_listed: ignore signals that carry a canonical name but are not listed.
    """

    time: TimeMap = TimeMap(column=None, unit=None)
    channels: Annotated[dict[str, ChannelMap], BeforeValidator(_fill_from)] = Field(default_factory=dict)
    rotation: Rotation | None = None
    imu: Imu | None = None
    lever_arm: LeverArm | None = None
    reference: Annotated[dict[str, ReferenceMap], BeforeValidator(_fill_from)] = Field(default_factory=dict)
    only_listed: bool = False

    @field_validator("channels", "reference")
    @classmethod
    def _known_names(cls, section: dict[str, Any]) -> dict[str, Any]:
        _check_names(section)
        return section

    @model_validator(mode="after")
    def _consistent(self) -> Sections:
        plain = [n for n in self.reference if not CHANNELS[n].is_reference]
        if plain:
            raise InputError(f"{plain[0]} is no reference", where="reference", mend="move it to 'channels:'")
        if twice := sorted(self.channels.keys() & self.reference.keys()):
            raise InputError(f"{twice[0]} is also listed under channels", where="reference", mend="keep one")
        if self.rotation is not None and self.imu is None:
            raise InputError(
                "there is no imu to rotate", where="rotation", mend="list the sensor's axes under 'imu:'"
            )
        made = {n for kind, names in IMU_CHANNELS.items() if getattr(self.imu, kind, None) for n in names}
        if twice := sorted(self.channels.keys() & made):
            raise InputError(
                f"{twice[0]} is also made from imu", where="channels", mend="take it from one of the two"
            )
        return self


def json_schema() -> dict[str, Any]:
    """JSON Schema of the mapping file, for editors: the short forms that the file may use included."""
    schema = Sections.model_json_schema()
    forms = schema["$defs"]
    settings = forms.pop("ChannelMap")
    candidate = {"anyOf": [{"type": "string"}, {"$ref": "#/$defs/Candidate"}]}
    candidates = {"type": "array", "items": candidate, "minItems": 1}
    properties = settings["properties"]
    properties["scale"]["default"] = 1.0
    properties["from"] = {"anyOf": [*candidate["anyOf"], candidates]}
    for name in ("valid", "invalid"):
        properties[name] = {"anyOf": [properties[name]["items"], properties[name]]}
    del settings["required"]  # a channel that names no signal is looked for by its own name
    forms["ChannelSettings"] = settings
    forms["ChannelMap"] = {"anyOf": [{"type": "string"}, candidates, {"$ref": "#/$defs/ChannelSettings"}]}
    forms["Axes"]["properties"] |= {k: v for k, v in properties.items() if k != "from"}
    schema["properties"]["channels"]["propertyNames"] = {"enum": [n for n in CHANNELS if n != "time"]}
    references = [n for n, c in CHANNELS.items() if c.is_reference]
    schema["properties"]["reference"]["propertyNames"] = {"enum": references}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": "roadstate mapping file",
    }
