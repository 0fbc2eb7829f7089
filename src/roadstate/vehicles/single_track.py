"""The single-track ("bicycle") model: left and right wheels merged."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.tires.smooth import Numbers
from roadstate.vehicles.kinematics import Planar, wheel_positions
from roadstate.vehicles.loads import load_slope, vertical_loads
from roadstate.vehicles.three_dof import ThreeDof


class SingleTrack(ThreeDof):
    """v_x, v_y, r with both wheels of an axle on the centre line, sharing its load.

    The four tires remain (two in each place), so that friction and tire parameters keep their shapes and a
    tire that is not linear in load is still loaded as it is in the car. No load moves sideways. Slips of the
    axles are inputs that may be left out: free rolling.

    Attributes as :class:`roadstate.vehicles.tire_vehicle.TireVehicle`.
    """

    name = "single_track"
    summary = "planar motion, left and right wheels merged"
    inputs: ClassVar[tuple[str, ...]] = ("steer", "steer_rear", "slip_front", "slip_rear")
    optional_inputs: ClassVar[tuple[str, ...]] = ("steer_rear", "slip_front", "slip_rear")

    @property
    def wheel_positions(self) -> Planar:
        """Places of the wheels, all on the centre line: (4,) each, m."""
        none = jnp.zeros_like(self.cg_to_front_axle)
        return wheel_positions(self.cg_to_front_axle, self.cg_to_rear_axle, none, none)

    def wheel_loads(self, accel_x: ArrayLike, accel_y: ArrayLike) -> Numbers:
        """(..., 4) vertical loads, N, alike on the left and on the right."""
        return vertical_loads(self, accel_x, jnp.zeros_like(jnp.asarray(accel_y)))

    @property
    def load_slope(self) -> Numbers:
        """(2, 4) load per specific force, N per m/s²; none per that along y."""
        return load_slope(self).at[1].set(0.0)

    def _slip(self, u: Numbers) -> Numbers:
        return u[jnp.array([2, 2, 3, 3])]
