"""The estimator `joint` with what a diagnostic plug gives: the engine's torque instead of the wheels'.

``python -m benchmarks.engine_torque`` prints the table of ``benchmarks/results/engine_torque.md``: two cars
with an engine and gears on the multibody plant, automotive sensors, vehicle files that are off by 5 to 10 %.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

from benchmarks.accuracy.scenarios import SCENARIOS, on_plant
from benchmarks.real_logs import table
from benchmarks.slow_samples import judged

from roadstate.core.channels import WHEELS
from roadstate.core.numerics import use_compilation_cache

DRIVES = ("straight-constant-speed", "straight-variable-speed", "curve-variable-speed", "urban")
_VEHICLES = ("family-car", "suv")
_ALWAYS = ("accel_x", *(f"wheel_speed_{w}" for w in WHEELS))
SETS = {
    "engine torque and speed": ("engine_torque", "engine_speed"),
    "engine torque and gear": ("engine_torque", "gear_ratio"),
    "wheel torques": tuple(f"drive_torque_{w}" for w in WHEELS),
}
_SEEDS = 8


def study() -> Iterator[tuple[str, dict[str, float]]]:
    """Row after row: drive, car and what tells the drive; no row has brakes, satellites or a gyroscope."""
    for drive in DRIVES:
        for vehicle in _VEHICLES:
            print(f"{drive}, {vehicle}", file=sys.stderr)
            logs = on_plant(vehicle, SCENARIOS[drive], _SEEDS)
            references = [c for c in logs[0][0].channels if c.startswith("ref_")]
            for name, channels in SETS.items():
                kept = {*_ALWAYS, *channels, *references}
                found = judged([(log.select(kept), car) for log, car in logs])
                yield f"{drive}, {vehicle}, {name}", {c: found[c] for c in ("RMSE", "inside")}


def main() -> None:
    """Print the table."""
    use_compilation_cache()
    rows = dict(study())
    print(
        "# Engine torque instead of wheel torques\n\n`python -m benchmarks.engine_torque`: eight recordings"
        " of each drive, longitudinal accelerometer and\nwheel speeds beside what the row says; nothing tells"
        " of the brakes. Grade: RMSE in per cent of grade, and share (%) within the 95 % interval.\n"
    )
    print(table("joint", rows))


if __name__ == "__main__":
    main()
