"""A race car at its limit: sideslip, axle forces and friction by the estimators that its channels allow.

``python -m benchmarks.race_car`` prints the table of ``benchmarks/results/race_car.md``.
"""

from __future__ import annotations

import numpy as np
from benchmarks.real_logs import DATA, load
from numpy.typing import NDArray

from roadstate.core import Estimates, Log
from roadstate.core.constants import GRAVITY
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build, runnable
from roadstate.metrics import NORMAL_95
from roadstate.run import scan
from roadstate.vehicles import Vehicle
from roadstate.vehicles.sensors import Accelerometer

Array = NDArray[np.float64]
SETTLE = 5.0  # s
SMOOTHING = 0.2  # s: the accelerometers shake with the engine, and no tire force follows that
CLASSES = ((0.0, 0.3), (0.3, 0.6), (0.6, 0.8), (0.8, 1.0), (1.0, 1.4))


def smooth(values: Array, time: Array) -> Array:
    """Centred mean over :data:`SMOOTHING`."""
    count = round(SMOOTHING / float(np.median(np.diff(time))))
    return np.convolve(values, np.ones(count) / count, "same")


def axle_forces(log: Log, car: Vehicle) -> dict[str, Array]:
    """Lateral force of each axle (N) from a_y and the yaw acceleration alone: no tire, no sideslip in it.

    F_yf cos δ = (m a_y l_r + I_z ṙ)/L, F_yr = (m a_y l_f − I_z ṙ)/L.
    """
    across, turning = smooth(log["accel_y"], log.time), smooth(log["yaw_accel"], log.time)
    front, rear = car.geometry.cg_to_front_axle, car.geometry.cg_to_rear_axle
    moment = car.yaw_inertia * turning / car.wheelbase
    return {
        "force_y_front": (car.mass * across * rear / car.wheelbase + moment) / np.cos(log["steer"]),
        "force_y_rear": car.mass * across * front / car.wheelbase - moment,
    }


def row(name: str, estimates: Estimates, log: Log, car: Vehicle) -> list[str]:
    """The estimator's line of the first table."""
    late = log.time - log.time[0] >= SETTLE
    cells = [name, "", "", ""]
    if "velocity_y" in estimates.values:
        slip = np.rad2deg(np.arctan2(estimates.values["velocity_y"], log["speed"]))
        truth = np.rad2deg(np.arctan2(log["ref_velocity_y"], log["speed"]))
        error = (estimates.values["velocity_y"] - log["ref_velocity_y"]) / estimates.std["velocity_y"]
        inside = 100 * np.mean(np.abs(error[late]) < NORMAL_95)
        r = np.corrcoef(slip[late], truth[late])[0, 1]
        cells[1:] = [f"{_rmse(slip - truth, late):.2f}", f"{r:.3f}", f"{inside:.0f} %"]
    for quantity, force in axle_forces(log, car).items():
        if quantity in estimates.values:
            size = float(np.percentile(np.abs(force[late]), 99))
            cells.append(f"{100 * _rmse(estimates.values[quantity] - force, late) / size:.1f} %")
        else:
            cells.append("")
    return cells


def friction_rows(estimates: Estimates, log: Log) -> list[str]:
    """Peak friction by how much of it was used."""
    used = smooth(np.hypot(log["accel_x"], log["accel_y"]), log.time) / GRAVITY
    late = log.time - log.time[0] >= SETTLE
    cells = []
    for low, high in CLASSES:
        here = late & (used >= low) & (used < high)
        value, std = estimates.values["friction_peak"][here], estimates.std["friction_peak"][here]
        cells.append(f"{value.mean():.2f} ± {std.mean():.2f}")
    return cells


def told_otherwise(car: Vehicle) -> dict[str, Vehicle]:
    """Vehicle files that are wrong by what such figures are wrong by."""

    def changed(section: str, **figures: object) -> Vehicle:
        return car.model_copy(update={section: getattr(car, section).model_copy(update=figures)})

    front, rear = car.tires.cornering_stiffness_front, car.tires.cornering_stiffness_rear
    quiet = car.sensors.accel.model_copy(update={"noise_density": Accelerometer().noise_density})
    return {
        "as in the file": car,
        "tires 15 % softer": changed(
            "tires", cornering_stiffness_front=0.85 * front, cornering_stiffness_rear=0.85 * rear
        ),
        "tires 15 % stiffer": changed(
            "tires", cornering_stiffness_front=1.15 * front, cornering_stiffness_rear=1.15 * rear
        ),
        "front stiffer, rear softer by 10 %": changed(
            "tires", cornering_stiffness_front=1.1 * front, cornering_stiffness_rear=0.9 * rear
        ),
        "friction 0.9": changed("tires", friction=0.9),
        "friction 1.3": changed("tires", friction=1.3),
        "yaw inertia 20 % larger": car.model_copy(update={"yaw_inertia": 1.2 * car.yaw_inertia}),
        "accelerometer's noise not told": changed("sensors", accel=quiet),
    }


def main() -> None:
    """Print the tables."""
    files = [DATA / "revs_250lm" / "run_20140222_01_01_03.csv.gz"]
    if not files[0].is_file():
        raise SystemExit("the real recordings (../shared/data) are not on this machine")
    use_compilation_cache()
    log, car = load("revs_250lm", files, [], "vehicle.yaml", "mapping.yaml")
    names = [n for n in runnable(log.available) if n not in ("kmbe", "debe")]
    results = {n: scan(build(n, car, log.available), log) for n in names}
    print("# A race car at its limit\n\nMade by `python -m benchmarks.race_car`.\n")
    print("| estimator | sideslip RMSE, ° | r | v_y in its 95 % interval | F_y front | F_y rear |")
    print("|---|---|---|---|---|---|")
    for name, estimates in results.items():
        print("| " + " | ".join(row(name, estimates, log, car)) + " |")
    print("\nForces: RMSE against a_y and yaw acceleration alone, over the largest (99th percentile).\n")
    print("| peak friction while used friction is | " + " | ".join(f"{a:g}–{b:g}" for a, b in CLASSES) + " |")
    print("|---|" + "---|" * len(CLASSES))
    for name, estimates in results.items():
        print(f"| {name} | " + " | ".join(friction_rows(estimates, log)) + " |")
    names = ["joint", "friction-ukf"]
    print(f"\n| sideslip RMSE, °, and its interval, with the vehicle file's | {' | | '.join(names)} | |")
    print("|---|" + "---|---|" * len(names))
    for what, other in told_otherwise(car).items():
        told = results if other is car else {n: scan(build(n, other, log.available), log) for n in names}
        found = (row(n, told[n], log, other) for n in names)
        print(f"| {what} | " + " | ".join(f"{cells[1]} | {cells[3]}" for cells in found) + " |")


def _rmse(error: Array, where: NDArray[np.bool_]) -> float:
    return float(np.sqrt(np.mean(error[where] ** 2)))


if __name__ == "__main__":
    main()
