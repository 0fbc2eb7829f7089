"""How long ``roadstate estimate`` takes and how much memory, as a user meets it: whole processes.

Run: python -m benchmarks.estimate [--runs N] [--json] [--save]
Budgets: --help 0.5 s; for the two simplest estimators a 60 s log at 100 Hz 3 s the first time and 1.5 s with
a warm compilation cache, and the estimation of one hour at 100 Hz 2 s; for joint, 300 times real time, 12 s;
a one-hour log of 20 channels below 1 GB.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from benchmarks.machine import processor

from roadstate.core import Log
from roadstate.io import write
from roadstate.sim import GradeProfile, SpeedPlan, simulate
from roadstate.vehicles import load_vehicle

VEHICLE = "family-car"
RESULTS = Path(__file__).parent / "results" / "estimate.md"
_SIMPLE = ("kmbe", "debe")
_LEFT_OUT = ("latitude", "longitude", "brake")  # of 23 channels
_ALONE = """
import sys, time
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build
from roadstate.io import read_all
from roadstate.io.mapping import DEFAULT_MAPPING
from roadstate.run import scan
from roadstate.vehicles import load_vehicle
use_compilation_cache()
log = DEFAULT_MAPPING.apply(read_all([sys.argv[1]])).resample()
estimator = build(sys.argv[2], load_vehicle(sys.argv[3]), log.available)
wall, cpu = time.perf_counter(), time.process_time()
scan(estimator, log)
print(time.perf_counter() - wall, time.process_time() - cpu)
"""


@dataclass(frozen=True)
class Row:
    """One thing measured.

    Attributes:
        what: in words.
        median: over the runs, in ``unit``.
        least: of the runs.
        most: of the runs.
        cpu: median processor time of all threads, s; what a busy machine cannot stretch.
        budget: in ``unit``; ``None`` where none is set.
        unit: s or MB.
    """

    what: str
    median: float
    least: float
    most: float
    cpu: float
    budget: float | None
    unit: str = "s"

    @classmethod
    def of(cls, what: str, ends: Sequence[End], budget: float | None, *, memory: bool = False) -> Row:
        """A row from the runs of a process: its time, or its memory."""
        values = [end.peak if memory else end.wall for end in ends]
        figures = statistics.median(values), min(values), max(values)
        return cls(
            what, *figures, statistics.median(end.cpu for end in ends), budget, "MB" if memory else "s"
        )


@dataclass(frozen=True)
class End:
    """What a process took: wall and processor time in s, peak memory in MB; and what it printed."""

    wall: float
    cpu: float
    peak: float
    out: str


def hour_of_driving() -> Log:
    """One hour at 100 Hz over random hills in changing traffic: 20 channels."""
    random = np.random.default_rng(1)
    knots = np.cumsum(random.uniform(80.0, 400.0, 400))
    road = GradeProfile(np.r_[0.0, knots], np.r_[0.0, random.normal(0.0, 0.03, 400)], 300.0)
    times = np.r_[0.0, np.cumsum(random.uniform(8.0, 25.0, 400))]
    times = np.r_[times[times < 3600.0], 3600.0]
    speeds = random.uniform(5.0, 28.0, len(times))
    speeds[random.random(len(times)) < 0.1] = 0.0
    log = simulate(load_vehicle(VEHICLE), SpeedPlan(tuple(times), tuple(speeds)), road=road)
    return log.select(set(log.channels) - set(_LEFT_OUT))


def timed(argv: Sequence[str], cache: Path) -> End:
    """Run a child process.

    Raises:
        RuntimeError: it failed.
    """
    environment = {**os.environ, "ROADSTATE_CACHE": str(cache)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # no user's Python compiles its sources at each start
    with tempfile.TemporaryFile() as out:
        begin = time.perf_counter()
        child = subprocess.Popen(argv, stdout=out, env=environment)
        _, status, usage = os.wait4(child.pid, 0)
        wall = time.perf_counter() - begin
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        text = out.read().decode()
    if child.returncode != 0:
        raise RuntimeError(f"{' '.join(argv)} ended with status {child.returncode}")
    to_mb = 1e6 if sys.platform == "darwin" else 1e3
    return End(wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / to_mb, text)


def measure(folder: Path, runs: int) -> list[Row]:
    """All rows."""
    command = [sys.executable, "-m", "roadstate"]
    hour = hour_of_driving()
    long_csv = write(hour, folder / "hour.csv")
    long_parquet = write(hour, folder / "hour.parquet")
    short = write(hour.between(0.0, 60.0), folder / "minute.csv")
    warm = folder / "warm"

    def estimate(log: Path, cache: Path, names: Sequence[str], *more: str) -> End:
        words = ["estimate", str(log), "--vehicle", VEHICLE, "--out", str(folder / "out"), *more]
        return timed([*command, *words, *(f"--estimator={name}" for name in names)], cache)

    def alone(name: str) -> End:
        end = timed([sys.executable, "-c", _ALONE, str(long_parquet), name, VEHICLE], warm)
        wall, cpu = (float(word) for word in end.out.split())
        return End(wall, cpu, end.peak, "")

    helps = [timed([*command, "--help"], warm) for _ in range(runs)]
    rows = [Row.of("`roadstate --help`", helps, 0.5)]
    none, joint = (None, None), ("joint",)
    for names, more, budgets in ((_SIMPLE, (), (3.0, 1.5)), (joint, (), none), (joint, ("--smooth",), none)):
        told = f"`estimate` ({', '.join((*names, *more))}), 60 s at 100 Hz"
        estimate(short, warm, names, *more)  # fills the cache, and the operating system's
        caches = [folder / f"empty-{names[0]}{len(more)}-{i}" for i in range(runs)]
        first = [estimate(short, cache, names, *more) for cache in caches]
        again = [estimate(short, warm, names, *more) for _ in range(runs)]
        rows.append(Row.of(f"{told}, first time", first, budgets[0]))
        rows.append(Row.of(f"{told}, warm cache", again, budgets[1]))
    for name in (*_SIMPLE, "joint"):
        alone(name)  # joint has another program for long logs
        ends = [alone(name) for _ in range(runs)]
        budget = 2.0 if name in _SIMPLE else 12.0
        rows.append(Row.of(f"estimation alone ({name}), 1 h at 100 Hz, warm cache", ends, budget))
    whole = [estimate(long_csv, warm, _SIMPLE) for _ in range(max(1, runs // 2))]
    size = f"1 h of 20 channels (CSV of {long_csv.stat().st_size / 1e6:.0f} MB)"
    what = f"`estimate` ({', '.join(_SIMPLE)}), {size}"
    rows.append(Row.of(what, whole, None))
    rows.append(Row.of(f"{what}: peak memory", whole, 1000.0, memory=True))
    return rows


def as_table(rows: Sequence[Row], runs: int) -> str:
    """Markdown."""
    import jax

    lines = [
        "# `roadstate estimate`: time and memory",
        "",
        f"`python -m benchmarks.estimate --runs {runs}` on {os.cpu_count()} cores ({processor()}), "
        f"Python {platform.python_version()}, JAX {jax.__version__}. Whole processes unless said otherwise.",
        "",
        "| what | median | least | most | processor time | budget |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        digits = 2 if row.unit == "s" else 0
        shown = [f"{v:.{digits}f} {row.unit}" for v in (row.median, row.least, row.most)]
        budget = "–" if row.budget is None else f"{row.budget:g} {row.unit}"
        lines.append(f"| {row.what} | {' | '.join(shown)} | {row.cpu:.2f} s | {budget} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=5, help="repetitions of each (default 5)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--save", action="store_true", help=f"write the table to {RESULTS.name}, too")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = measure(Path(folder), args.runs)
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
