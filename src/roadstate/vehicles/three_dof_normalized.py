"""Planar motion under tire forces that are given up to their friction: F = μ F⁰."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx

from roadstate.tires.base import as_leaf
from roadstate.tires.smooth import Numbers
from roadstate.vehicles.model import per_wheel
from roadstate.vehicles.three_dof_forces import ThreeDofForces


class ThreeDofNormalized(ThreeDofForces):
    """v_x, v_y, r with the normalised forces F⁰ as inputs; each contact's force is μ_i F⁰_i.

    What the papers' second stages see: everything is linear in the friction of the four wheels.

    Attributes as :class:`roadstate.vehicles.model.VehicleModel`, and:
        friction: (4,) μ under each wheel.
    """

    name = "three_dof_normalized"
    summary = "planar motion, normalised tire forces as inputs, linear in friction"
    inputs: ClassVar[tuple[str, ...]] = (
        "steer",
        "steer_rear",
        *per_wheel("normalized_force_x"),
        *per_wheel("normalized_force_y"),
    )

    friction: Numbers = eqx.field(converter=as_leaf)

    def _tire_forces(self, u: Numbers) -> tuple[Numbers, Numbers]:
        return self.friction * u[2:6], self.friction * u[6:10]
