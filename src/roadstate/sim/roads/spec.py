"""What a road file holds, checked key by key, and the road it describes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal, Self

import numpy as np
from pydantic import Field, StringConstraints, model_validator

from roadstate.core.errors import InputError
from roadstate.core.quantity import Quantity, refusal
from roadstate.vehicles.sensors import Section

if TYPE_CHECKING:
    from roadstate.sim.roads.centreline import Along
    from roadstate.sim.roads.friction import FrictionMap
    from roadstate.sim.roads.road import Road

_Name = Annotated[str, StringConstraints(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f\x7f]*$")]
_Text = Annotated[str, StringConstraints(max_length=4000, pattern=r"^[^\x00-\x08\x0b-\x1f\x7f]*$")]
_Place = Annotated[float, Quantity("m", -200e3, 200e3)]
_Offset = Annotated[float, Quantity("m", -100, 100)]
_Length = Annotated[float, Quantity("m", 0.01, 200e3)]
_Curvature = Annotated[float, Quantity("1/m", -0.5, 0.5)]
_Slope = Annotated[float, Quantity("rad", -0.7, 0.7, is_slope=True)]
_Height = Annotated[float, Quantity("m", -1000, 10_000)]
_Friction = Annotated[float, Quantity("-", 0.01, 3)]
_Edge = Annotated[float, Quantity("m", 0.001, 100)]
_Width = Annotated[float, Quantity("m", 1, 50)]
_Period = Annotated[float, Quantity("m", 100, 5000)]
_Seed = Annotated[float, Quantity("-", 0, 2**53)]
_Degrees = Annotated[float, Quantity("rad", -6.3, 6.3)]


class BendSpec(Section):
    """A section of the centreline; straight without curvature."""

    length: _Length
    """Length of the section"""
    curvature: _Curvature = 0.0
    """Curvature at its start, positive to the left: 1/radius"""
    end_curvature: _Curvature | None = None
    """Curvature at its end, where it changes along the section (a clothoid)"""


class GradeKnot(Section):
    """Grade at a place; between two of them its sine follows half a cosine."""

    at: _Place
    """Length along the centreline, in plan view"""
    grade: _Slope
    """Grade, uphill positive (`%` is rise over run)"""


class BankKnot(Section):
    """Bank at a place; between two of them its tangent follows half a cosine."""

    at: _Place
    """Length along the centreline, in plan view"""
    bank: _Slope
    """Bank, left side higher positive (`%` is rise over run)"""


class Roughness(Section):
    """Random unevenness after ISO 8608, alike in all directions."""

    road_class: Literal["A", "B", "C", "D", "E"]
    """Class of ISO 8608: A very good … E very poor"""
    seed: _Seed = 0.0
    """Of the random surface: same seed, same surface"""
    period: _Period = 500.0
    """Length after which the surface repeats itself"""
    width: _Width = 8.0
    """Width of the surface, centred; beyond it the outermost line goes on"""


class Patch(Section):
    """A rectangle of other friction; a bound that is left out lies at infinity."""

    start: _Place | None = None
    """First place along the road"""
    stop: _Place | None = None
    """Last place along the road"""
    right: _Offset | None = None
    """Right bound: offset to the left of the centreline"""
    left: _Offset | None = None
    """Left bound: offset to the left of the centreline"""
    friction: _Friction
    """Peak friction coefficient"""

    @property
    def rectangle(self) -> tuple[float, float, float, float, float]:
        """Start, stop, right, left (infinite where left out), friction."""
        low, high = -math.inf, math.inf
        return (
            low if self.start is None else self.start,
            high if self.stop is None else self.stop,
            low if self.right is None else self.right,
            high if self.left is None else self.left,
            self.friction,
        )


class FrictionSpec(Section):
    """Peak friction by place."""

    ground: _Friction = 0.85
    """Peak friction coefficient where no patch lies"""
    edge: _Edge = 0.2
    """Width over which friction changes at a patch's edge"""
    patches: Annotated[tuple[Patch, ...], Field(max_length=2000)] = ()
    """Rectangles of other friction; a later one covers earlier ones"""

    def build(self) -> FrictionMap:
        """The map.

        Raises:
            InputError: an empty patch, or edges nearer than their width.
        """
        from roadstate.sim.roads.friction import patches

        return patches(self.ground, [p.rectangle for p in self.patches], self.edge)


class RoadSpec(Section):
    """A road, as its road file describes it: frozen, every figure a float in SI."""

    name: _Name = "road"
    """What the road is called"""
    description: _Text = ""
    """What road it is, in a line"""
    start_altitude: _Height = 0.0
    """Height at the start of the centreline"""
    heading: _Degrees = 0.0
    """Heading at the start: from east towards north"""
    centreline: Annotated[tuple[BendSpec, ...], Field(max_length=5000)] = ()
    """Sections of the centreline, one after the other"""
    grade: Annotated[tuple[GradeKnot, ...], Field(max_length=5000)] = ()
    """Grade along the road; level where nothing is given"""
    bank: Annotated[tuple[BankKnot, ...], Field(max_length=5000)] = ()
    """Bank along the road; none where nothing is given"""
    roughness: Roughness | None = None
    """Unevenness; even where nothing is given"""
    friction: FrictionSpec = FrictionSpec()
    """Friction"""
    crg: _Text | None = None
    """OpenCRG file with plan, height and surface, beside the road file, instead of those given here"""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.crg is not None:
            given = {"centreline", "grade", "bank", "roughness", "start_altitude", "heading"}
            both = sorted(given & self.model_fields_set)
            if both:
                raise refusal(f"'{both[0]}' beside an OpenCRG file", "give one of them", both[0])
        elif not self.centreline:
            raise refusal("no centreline", "give 'centreline' with one section, or 'crg'", "centreline")
        return self

    def build(self) -> Road:
        """The road that is described here; one from an OpenCRG file is built by ``load_road``.

        Raises:
            InputError: places that do not increase, friction edges too near, a road too long.
        """
        from roadstate.sim.roads.centreline import Bend, half_cosine, level, make_road
        from roadstate.sim.roads.grade import GradeProfile
        from roadstate.sim.roads.roughness import rough_surface

        if self.crg is not None:
            raise InputError("the road lies in an OpenCRG file", mend="load it with load_road")
        height: Along = level
        bank: Along = level
        surface = None
        if self.grade:
            places, grades = [k.at for k in self.grade], [k.grade for k in self.grade]
            height = GradeProfile.in_plan(places, grades).over_plan
        if self.bank:
            bank = half_cosine([k.at for k in self.bank], [math.tan(k.bank) for k in self.bank])
        if self.roughness is not None:
            rough = self.roughness
            surface = rough_surface(rough.road_class, int(rough.seed), rough.period, rough.width)
        return make_road(
            [Bend(b.length, b.curvature, b.end_curvature) for b in self.centreline],
            height=_from(self.start_altitude, height),
            bank=bank,
            friction=self.friction.build(),
            surface=surface,
            pose=(0.0, 0.0, self.heading),
        )


def _from(altitude: float, height: Along) -> Along:
    """The same slopes from another height at s = 0."""
    return lambda s: (height(s)[0] - height(np.zeros(1))[0] + altitude, height(s)[1])
