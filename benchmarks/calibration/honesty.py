"""Are the standard deviations that ``roadstate calibrate`` states honest? Many cars, each learned anew."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from benchmarks.accuracy.measures import AXLES
from benchmarks.calibration.drives import recorded
from benchmarks.calibration.friction import ASPHALT

from roadstate.calibration import calibrate
from roadstate.core import InputError, Log
from roadstate.vehicles import Vehicle

CASES: Mapping[str, tuple[str, ...]] = {
    "mass,aero": ("straight-variable-speed",),
    "friction,tire": ("slalom", "double-lane-change-85-0.8", "straight-0.8"),
}
"""What is learned, and the drives it is learned from."""
Progress = Callable[[str], None]


@dataclass
class Seen:
    """A figure of one vehicle over the seeds.

    Attributes:
        reference: what it should come to; NaN where nothing says.
        told, learned: (n,) of the seeds in which it was learned, over the reference: logarithms.
        std: (n,) stated, of the logarithm.
        refused: reasons, and how often.
    """

    reference: float
    told: list[float] = field(default_factory=list)
    learned: list[float] = field(default_factory=list)
    std: list[float] = field(default_factory=list)
    refused: Counter[str] = field(default_factory=Counter)


Found = dict[tuple[str, str], Seen]  # (figure, vehicle)


def study(vehicles: Sequence[Vehicle], seeds: int, progress: Progress) -> Found:
    """Learn every seed's car from its own recordings.

    Args:
        vehicles: to drive.
        seeds: cars of each.
        progress: told what is being done.
    """
    found: Found = {}
    for vehicle in vehicles:
        for groups, names in CASES.items():
            drives = {name: recorded(vehicle, name, seeds) for name in names}
            reference = _reference(vehicle, groups, {name: drive.ideal for name, drive in drives.items()})
            for seed in range(seeds):
                progress(f"{vehicle.name}: {groups}, seed {seed}")
                told = next(iter(drives.values())).told[seed]
                logs = {name: drive.logs[seed] for name, drive in drives.items()}
                _add(found, vehicle, told, logs, groups, reference)
    return found


def _reference(vehicle: Vehicle, groups: str, logs: Mapping[str, Log]) -> dict[str, float]:
    """What each figure should come to.

    Mass, drag and friction are the plant's. Of a tire's stiffness steering, suspension and load transfer take
    a part: its reference is that of the axle in the plant, :func:`axle_stiffness`, which no estimator has a
    part in.
    """
    if "mass" in groups:
        return {"mass": vehicle.mass, "aerodynamics.drag_coefficient": vehicle.aerodynamics.drag_coefficient}
    return {"tires.friction": ASPHALT, **axle_stiffness(vehicle, logs["slalom"])}


def axle_stiffness(vehicle: Vehicle, log: Log) -> dict[str, float]:
    """Lateral force over load by slip angle, 1/rad, of each axle as the body sees it, below 0.25 of the load.

    The slip angle is that between where the road wheels point by the steering wheel's angle and where the
    axle goes, so compliance and roll are in it. Geometric mean of both regressions, as neither is free of
    lag.

    Args:
        vehicle: that was driven.
        log: of a slalom by ideal sensors, with the truth.
    """
    geometry, turn = vehicle.geometry, log["yaw_rate"]
    steer = log["steering_wheel"] / vehicle.steering.ratio
    found = {}
    for axle, arm, angle in (
        ("front", geometry.cg_to_front_axle, steer),
        ("rear", -geometry.cg_to_rear_axle, np.zeros_like(steer)),
    ):
        force, load = (sum(log[f"ref_{kind}_{w}"] for w in AXLES[axle]) for kind in ("force_y", "load"))
        share = force / load
        slip = angle - np.arctan((log["ref_velocity_y"] + arm * turn) / log["ref_velocity_x"])
        small = np.isfinite(slip) & (np.abs(share) < 0.25)
        slip, share = slip[small], share[small]
        found[f"tires.cornering_stiffness_{axle}"] = float(np.sqrt(np.sum(share**2) / np.sum(slip**2)))
    return found


def _add(
    found: Found,
    vehicle: Vehicle,
    told: Vehicle,
    logs: Mapping[str, Log],
    groups: str,
    reference: Mapping[str, float],
) -> None:
    def seen(figure: str) -> Seen:
        return found.setdefault((figure, vehicle.name), Seen(reference.get(figure, math.nan)))

    try:
        fit = calibrate(told, logs, groups.split(","))
    except InputError as error:
        for figure in reference:
            seen(figure).refused[error.what] += 1
        return
    for one in fit.learned:
        figure = seen(one.parameter.name)
        figure.told.append(math.log(one.parameter.start / figure.reference))
        figure.learned.append(math.log(one.value / figure.reference))
        figure.std.append(one.relative)
    for name, why in fit.refused.items():
        seen(name).refused[why] += 1
