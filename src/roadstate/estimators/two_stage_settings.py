"""How the two-stage estimator is set, and its two filters for such settings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.assembly.rows import Grouping
from roadstate.estimators.base import leaf, with_options
from roadstate.estimators.contact import STEER_STD
from roadstate.estimators.force_filter import ForceFilter, ForceModel, channel_loads
from roadstate.estimators.friction import normalized_tire
from roadstate.estimators.friction_of_forces import ForcesInput, LastingErrors
from roadstate.filters import ExtendedHInfinity, Forgetting, GateRule, Window
from roadstate.filters.adaptive import AdaptiveNoise
from roadstate.filters.base import Filter
from roadstate.filters.marginal import MarginalUKF
from roadstate.tires import TireModel
from roadstate.vehicles.three_dof_contact import ThreeDofContact

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle


class Settings(NamedTuple):
    """How the estimator is set.

    Attributes:
        grouping: which wheels share a friction.
        mean: prior mean of μ.
        shared_std, own_std: 1σ of the prior: of the part that all groups share, of each group's own.
        shared_walk, own_walk: 1σ of the random walk over 1 m of way, likewise.
        step_std: 1σ of each group's own random walk over one step, whatever its length: the paper's √Q.
        sensor_std: 1σ of each accelerometer's sample (m/s², rad/s²): the paper's √R; ``None`` has it from the
            vehicle file, and lets errors last.
        gamma: γ of the H∞ filters; in shares of an axle's standing load over √2, as printed in N.
        motion: intensity of the random walk of the normalised forces' rates, in loads, 1/s/√s: of F_x, of the
            front axle's F_y (steering), of the rear's; what inertial sensors tell is not in it.
        rate_time: s over which such a rate keeps its value.
        smooths: false switches the first stage off.
        adapts: false keeps the second stage's R.
        direct: read v_x and v_y as measured, where they are, and free nothing of pitch and roll.
        steer_std: 1σ of the mean road-wheel angle, rad: in all (offset and compliance too), and white noise.
        relaxes: whether lateral forces follow slip angles after the file's relaxation length, as real tires'
            do; the paper's follow at once.
        known_friction: μ taken for known when forces are given, F = μ F⁰; ``None`` takes the estimated one.
    """

    grouping: Grouping = "front_rear"
    mean: float = 0.8
    shared_std: float = 0.3
    own_std: float = 0.1
    shared_walk: float = 0.01
    own_walk: float = 0.003
    step_std: float = 0.0
    sensor_std: float | None = None
    gamma: float = 0.3
    motion: tuple[float, float, float] = (0.5, 3.0, 0.2)
    rate_time: float = 0.5
    smooths: bool = True
    adapts: bool = True
    direct: bool = False
    steer_std: tuple[float, float] = (STEER_STD, 5e-4)
    relaxes: bool = True
    known_friction: float | None = None


PRINTED = Settings(
    grouping="four",
    mean=1.0,
    shared_std=0.0,
    own_std=1.0,
    shared_walk=0.0,
    own_walk=0.0,
    step_std=0.1,
    sensor_std=1.0,
    gamma=3.2,
    motion=(0.0, 0.0, 0.0),
    rate_time=1.0,
    direct=True,
    relaxes=False,
)
"""Paper 000, which prints R and Q of the first stage alone."""
_PRINTED_STD = (10.0**0.5,) * 4 + (1.0,) * 4  # √R of the first stage (§3.1), N
_PRINTED_WALK = 0.1  # √Q
_PRINTED_WINDOW = 50  # L


def first_stage(
    vehicle: Vehicle, chosen: Settings, as_printed: bool, direct: bool, tire: TireModel | None
) -> ForceFilter:
    """The H∞ filters, for a vehicle file; ``direct`` says that v_x and v_y are read as measured."""
    front, rear = vehicle.static_axle_loads
    load = jnp.asarray(0.5 * np.array([front, front, rear, rear]))
    size, file = channel_loads(load), vehicle.sensors
    velocity = (file.speed.noise, file.velocity_y.noise) if direct else (0.0, 0.0)
    states = ("force",) if as_printed else ("force", "force_rate")
    start = float(jnp.max(size)) * np.array([0.5, 0.5])[: len(states)]
    bound = jnp.full(8, chosen.gamma) if as_printed else chosen.gamma * size
    return ForceFilter(
        filters=ExtendedHInfinity(theta=1 / bound**2, weight=jnp.tile(jnp.eye(1, len(states)), (8, 1))),
        channel=ForceModel(states, ("force",), leaf(chosen.rate_time), jnp.asarray(start)),
        vehicle=ThreeDofContact.from_vehicle(vehicle, normalized_tire(vehicle) if tire is None else tire),
        wheel_radius=jnp.full(4, vehicle.wheels.radius),
        load=load,
        white_std=jnp.asarray(
            np.array([*velocity, chosen.steer_std[1], *[file.wheel_speed.noise] * 4, file.yaw_rate.noise])
        ),
        yaw_bias=leaf(file.yaw_rate.bias),
        motion=jnp.asarray(np.repeat(np.array(chosen.motion)[[0, 0, 1, 2]], 2)),
        step_std=jnp.full(8, _PRINTED_WALK if as_printed else 0.0),
        sample_std=jnp.asarray(np.array(_PRINTED_STD)) if as_printed else None,
        relaxation=jnp.full(4, vehicle.tires.relaxation_length if chosen.relaxes else 0.0),
        smooths=chosen.smooths,
    )


def second_stage(chosen: Settings, as_printed: bool, options: dict[str, Any]) -> Filter[Any]:
    """The friction's filter."""
    inner: MarginalUKF
    if as_printed:
        inner = MarginalUKF()
        usual = {
            "average": Window(_PRINTED_WINDOW),
            "minimum": _PRINTED_WINDOW,
            "full": True,
            "centered": False,
            "floor": 1e-6,
            "ceiling": 1e6,
        }
    else:
        inner = LastingErrors(gate=GateRule())
        usual = {
            "average": Forgetting(0.99),
            "minimum": 50,
            "floor": 0.1,
            "ceiling": 1e3,
            "excited": _teaches,
        }
    return with_options(AdaptiveNoise, {"filter": inner} | usual | options) if chosen.adapts else inner


def _teaches(model: Any, x: Float[Array, " n"], u: ForcesInput) -> Bool[Array, " m"]:
    """Which sensors' residuals tell of their noise."""
    return u.excited
