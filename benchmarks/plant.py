"""How fast the plants run, and how well their books balance.

Run: python -m benchmarks.plant [--runs N] [--only WORD] [--json] [--save]
Goals: one car at 1 kHz with truth at 100 Hz 20 times real time on one core; 256 at once 100 times in sum; at
most 10 s to compile. Least wall time of the runs: on a shared machine the others are the neighbours'.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from roadstate.core.numerics import jit_loop, use_compilation_cache
from roadstate.sim.batch import drive_many
from roadstate.sim.manoeuvres import manoeuvre
from roadstate.sim.plant import Controls, multibody_plant
from roadstate.sim.plant.planar import PlanarPlant
from roadstate.sim.plant.rollout import open_loop
from roadstate.sim.roads.centreline import Bend, make_road
from roadstate.sim.roads.friction import uniform
from roadstate.sim.run import drive
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
        per_processor: likewise, over seconds of processor time.
    """

    what: str
    compiling: float
    microseconds: float
    processor: float
    real_time: float
    per_processor: float


def _controls(seconds: float) -> Controls:
    t = np.arange(round(seconds / _DT)) * _DT
    return Controls.make(steering_wheel=0.6 * np.sin(2 * t), throttle=0.3, brake=np.where(t > 8, 0.3, 0.0))


def _row(what: str, plant: Any, road: Any, runs: int, cars: int = 1) -> Row:
    controls = _controls(_SECONDS if cars == 1 else 2.0)

    def ride(plant: Any, friction: Any) -> Any:
        here = eqx.tree_at(lambda r: r.friction.cells, road, friction * jnp.ones((1, 1)))
        state = plant.init(here, 20.0)
        return open_loop(plant, here, state, controls, _DT)[1]

    whole = ride if cars == 1 else eqx.filter_vmap(ride, in_axes=(None, 0))
    frictions = jnp.asarray(0.8) if cars == 1 else jnp.linspace(0.2, 1.0, cars)
    compiled = jit_loop(whole)
    simulated = cars * controls.throttle.shape[0] * _DT
    return _timed(what, lambda: jax.block_until_ready(compiled(plant, frictions)), simulated, plant, runs)


def _driven(what: str, plant: Any, runs: int, cars: int) -> Row:
    """Whole drives of a double lane change with its driver, rows as NumPy arrays included."""
    car, kind = load_vehicle("family-car"), manoeuvre("double-lane-change")
    chosen = [kind.prepare(car, friction=friction) for friction in np.linspace(0.8, 0.4, cars)]
    simulated = sum(one.duration for one in chosen)
    if cars == 1:
        return _timed(what, lambda: drive(plant, chosen[0], car, rate=200.0), simulated, plant, runs)
    return _timed(what, lambda: drive_many([plant], chosen, car), simulated, plant, runs)


def _timed(what: str, call: Callable[[], Any], simulated: float, plant: Any, runs: int) -> Row:
    begin = time.process_time()
    call()
    first = time.process_time() - begin
    walls, used = [], []
    for _ in range(runs):
        begin, spent = time.perf_counter(), time.process_time()
        call()
        walls.append(time.perf_counter() - begin)
        used.append(time.process_time() - spent)
    steps = simulated / plant.inner_step / 1e6
    wall, least = min(walls), min(used)
    return Row(what, first - least, wall / steps, least / steps, simulated / wall, simulated / least)


def measure(runs: int, only: str = "") -> list[Row]:
    """The rows whose name holds ``only``."""
    use_compilation_cache("")
    jax.config.update("jax_enable_compilation_cache", False)
    road = make_road([Bend(1000.0)], friction=uniform(0.8))
    car = load_vehicle("family-car")
    plant, many = multibody_plant(car), f"{_BATCH} frictions at once"
    rows: dict[str, Callable[[str], Row]] = {
        "multibody, family-car": lambda what: _row(what, plant, road, runs),
        "multibody, in-wheel-ev": lambda what: _row(
            what, multibody_plant(load_vehicle("in-wheel-ev")), road, runs
        ),
        "7-DOF, Dugoff": lambda what: _row(what, PlanarPlant.seven_dof(car), road, runs),
        "3-DOF, Dugoff": lambda what: _row(what, PlanarPlant.three_dof(car), road, runs),
        f"multibody, {many}": lambda what: _row(what, plant, road, runs, _BATCH),
        "with driver: `drive` at 200 Hz": lambda what: _driven(what, plant, runs, 1),
        f"with driver: `drive_many`, {many}": lambda what: _driven(what, plant, runs, _BATCH),
    }
    return [row(what) for what, row in rows.items() if only in what]


def as_table(rows: list[Row], runs: int) -> str:
    """Markdown."""
    lines = [
        "# Plants: speed",
        "",
        f"`python -m benchmarks.plant --runs {runs}` on {os.cpu_count()} cores, Python "
        f"{platform.python_version()}, JAX {jax.__version__}. 10 s (a batch: 2 s) of slalom and braking, "
        "trim included. With driver: whole drives of `double-lane-change`, rows as NumPy arrays included. "
        "Inner step 1 ms, truth at 100 Hz. Least of the runs; other work ran on the machine.",
        "",
        "| plant | compiling (processor time) | per step and car | its processor time | times real time "
        "| per processor second |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        times = f"{row.microseconds:.1f} µs | {row.processor:.1f} µs"
        speed = f"{row.real_time:.0f} | {row.per_processor:.0f}"
        lines.append(f"| {row.what} | {row.compiling:.1f} s | {times} | {speed} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="repetitions of each (default 5)")
    parser.add_argument("--only", default="", metavar="WORD", help="only rows whose name holds this")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--save", action="store_true", help=f"write the table to {RESULTS.name}, too")
    args = parser.parse_args()
    rows = measure(args.runs, args.only)
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
