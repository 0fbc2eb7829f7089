"""How fast the plants run, and how well their books balance.

Run: python -m benchmarks.plant [--runs N] [--json] [--save]
Goals: one car at 1 kHz with truth at 100 Hz 20 times real time on one core; 256 at once 100 times in sum; at
most 10 s to compile. Least wall time of the runs: on a shared machine the others are the neighbours'.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from roadstate.core.numerics import use_compilation_cache
from roadstate.sim.plant import Controls, multibody_plant
from roadstate.sim.plant.planar import PlanarPlant
from roadstate.sim.plant.rollout import open_loop
from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.vehicles import load_vehicle

RESULTS = Path(__file__).parent / "results" / "plant.md"
_SECONDS, _DT, _BATCH = 10.0, 0.01, 256


@dataclass(frozen=True)
class Row:
    """One plant.

    Attributes:
        what: in words.
        compiling: processor time until the first result, less a run, s; without a cache.
        microseconds: wall time per inner step and car, least of the runs.
        processor: likewise, processor time of all threads.
        real_time: simulated seconds of all cars over wall seconds.
    """

    what: str
    compiling: float
    microseconds: float
    processor: float
    real_time: float


def _controls(seconds: float) -> Controls:
    t = np.arange(round(seconds / _DT)) * _DT
    return Controls.make(steering_wheel=0.6 * np.sin(2 * t), throttle=0.3, brake=np.where(t > 8, 0.3, 0.0))


def _row(what: str, plant: Any, road: Any, runs: int, cars: int = 1) -> Row:
    controls = _controls(_SECONDS if cars == 1 else 2.0)

    def drive(plant: Any, friction: Any) -> Any:
        here = eqx.tree_at(lambda r: r.friction.cells, road, friction * jnp.ones((1, 1)))
        state = plant.init(here, 20.0)
        return open_loop(plant, here, state, controls, _DT)[1]

    whole = drive if cars == 1 else eqx.filter_vmap(drive, in_axes=(None, 0))
    frictions = jnp.asarray(0.8) if cars == 1 else jnp.linspace(0.2, 1.0, cars)
    compiled = eqx.filter_jit(whole)
    begin = time.process_time()
    jax.block_until_ready(compiled(plant, frictions))
    first = time.process_time() - begin
    walls, used = [], []
    for _ in range(runs):
        begin, spent = time.perf_counter(), time.process_time()
        jax.block_until_ready(compiled(plant, frictions))
        walls.append(time.perf_counter() - begin)
        used.append(time.process_time() - spent)
    simulated = cars * controls.throttle.shape[0] * _DT
    wall = min(walls)
    steps = simulated / plant.inner_step / 1e6
    return Row(what, first - min(used), wall / steps, min(used) / steps, simulated / wall)


def measure(runs: int) -> list[Row]:
    """All rows."""
    use_compilation_cache("")
    jax.config.update("jax_enable_compilation_cache", False)
    road = make_road([Bend(1000.0)], friction=uniform(0.8))
    car = load_vehicle("family-car")
    rows = [
        _row(f"multibody, {name}", multibody_plant(load_vehicle(name)), road, runs)
        for name in ("family-car", "in-wheel-ev")
    ]
    rows.append(_row("7-DOF, Dugoff", PlanarPlant.seven_dof(car), road, runs))
    rows.append(_row("3-DOF, Dugoff", PlanarPlant.three_dof(car), road, runs))
    rows.append(_row(f"multibody, {_BATCH} frictions at once", multibody_plant(car), road, runs, _BATCH))
    return rows


def as_table(rows: list[Row], runs: int) -> str:
    """Markdown."""
    lines = [
        "# Plants: speed",
        "",
        f"`python -m benchmarks.plant --runs {runs}` on {os.cpu_count()} cores, Python "
        f"{platform.python_version()}, JAX {jax.__version__}. 10 s (a batch: 2 s) of slalom and braking, "
        "trim included; inner step 1 ms, truth at 100 Hz. Least of the runs; other work ran on the machine.",
        "",
        "| plant | compiling (processor time) | per step and car | its processor time | times real time |",
        "|---|---:|---:|---:|---:|",
    ]
    for row in rows:
        times = f"{row.microseconds:.1f} µs | {row.processor:.1f} µs | {row.real_time:.0f}"
        lines.append(f"| {row.what} | {row.compiling:.1f} s | {times} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="repetitions of each (default 5)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--save", action="store_true", help=f"write the table to {RESULTS.name}, too")
    args = parser.parse_args()
    rows = measure(args.runs)
    table = as_table(rows, args.runs)
    if args.save:
        RESULTS.parent.mkdir(exist_ok=True)
        RESULTS.write_text(table, encoding="utf-8")
    if args.json:
        print(json.dumps({"runs": args.runs, "rows": [asdict(row) for row in rows]}, indent=2))
    else:
        print(table, end="")


if __name__ == "__main__":
    main()
