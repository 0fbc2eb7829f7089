"""What a person wants to know of a drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from roadstate.sim.manoeuvres.path import STEP as PATH_STEP
from roadstate.sim.manoeuvres.script import CLOSED
from roadstate.sim.manoeuvres.script import STEP as CUE_STEP

if TYPE_CHECKING:
    from roadstate.sim.plant.base import Truth
    from roadstate.sim.run import Drive

Array = NDArray[np.float64]
_LASTING = 0.1  # s for which a share of the friction must be taken to count
_LIFTED = 0.05  # share of the mean load under which a wheel counts as lifted


def force_over_load(truth: Truth) -> tuple[Array, Array]:
    """F_x/F_z and F_y/F_z of each wheel, (T, 4) each; NaN where a wheel hardly touches the road.

    Args:
        truth: (T, …) of a drive.
    """
    load = np.asarray(truth.load, np.float64)
    on_road = np.where(load > _LIFTED * load.mean(), load, np.nan)
    return np.asarray(truth.force_x, np.float64) / on_road, np.asarray(truth.force_y, np.float64) / on_road


def off_path(driven: Drive) -> Array:
    """(T,) distance of the car's centre of gravity to the left of the path it is to follow, m.

    NaN while it is not the driver who steers.
    """
    path, place = driven.manoeuvre.path, np.asarray(driven.truth.road, np.float64)
    table = np.asarray(path.table)
    at = float(path.start) + PATH_STEP * np.arange(len(table))
    apart = place[:, 1] - np.interp(place[:, 0], at, table[:, 0])
    return np.where(cues(driven)[:, 6] == CLOSED, apart, np.nan)


def cues(driven: Drive) -> Array:
    """(T, 8) what the script says at each instant, as in :class:`roadstate.sim.manoeuvres.script.Cue`."""
    table = np.asarray(driven.manoeuvre.script.table, np.float64)
    row = np.floor(driven.time / CUE_STEP + 1e-6).astype(np.intp)
    picked: Array = table[np.clip(row, 0, len(table) - 1)]
    return picked


def drive_facts(driven: Drive) -> dict[str, float]:
    """Duration, distance and extremes in SI; angles in rad, friction used as a share of what there is."""
    truth, time = driven.truth, driven.time
    speed = np.linalg.norm(truth.velocity, axis=1)
    share = np.nan_to_num(np.hypot(*force_over_load(truth)) / np.asarray(truth.friction))
    count = min(max(1, round(_LASTING / float(time[1] - time[0]))), len(time))
    lasting = np.lib.stride_tricks.sliding_window_view(share, count, axis=0).min(axis=-1)
    apart = np.abs(off_path(driven))
    followed = {"off_path_most": float(np.nanmax(apart))} if np.isfinite(apart).any() else {}
    return {
        "duration": float(time[-1]),
        "distance": float(np.sum(speed[:-1] * np.diff(time))),
        "speed_least": float(speed.min()),
        "speed_most": float(speed.max()),
        "accel_x_most": float(np.abs(truth.specific_force[:, 0]).max()),
        "accel_y_most": float(np.abs(truth.specific_force[:, 1]).max()),
        "friction_used_most": float(min(lasting.max(), 1.0)),
        **followed,
    }
