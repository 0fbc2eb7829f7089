"""The same filters on the same data, with roadstate, in C and with other libraries, side by side.

Run: python -m benchmarks.peers [--quick] [--json] [--write] [--problem NAME]…
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import jax
from benchmarks.peers.implementations import FULL, PROBLEMS, QUICK, Size, programs
from benchmarks.peers.measure import Row, measure, truth
from benchmarks.peers.tables import markdown, show
from rich.console import Console

from roadstate.core.tabular import atomic_path

RESULTS = Path(__file__).parent.parent / "results" / "peers.md"


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def run(name: str, size: Size) -> dict[str, Row]:
    """All implementations of one problem."""
    _tell(f"{name} …")
    problem = PROBLEMS[name][1](size.steps)
    return measure(dict(programs(problem, size, _tell)), truth(problem, size), size.repeats)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.peers",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help="short logs and few rounds: about a minute")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--write", action="store_true", help=f"write {RESULTS.name}, too")
    parser.add_argument(
        "--problem",
        action="append",
        choices=PROBLEMS,
        metavar="NAME",
        help=f"only this: {', '.join(PROBLEMS)}",
    )
    options = parser.parse_args()
    # a first call is to show what compiling costs
    jax.config.update("jax_enable_compilation_cache", False)
    sizes = QUICK if options.quick else FULL
    results = {name: run(name, sizes[name]) for name in options.problem or PROBLEMS}
    if options.write:
        words = [word for word in sys.argv[1:] if word != "--json"]
        repeats = max(sizes[name].repeats for name in results)
        page = markdown(results, repeats, " ".join(["python -m benchmarks.peers", *words]))
        with atomic_path(RESULTS) as path:
            path.write_text(page, encoding="utf-8")
        _tell(f"written: {RESULTS.name}")
    if options.json:
        print(json.dumps(results, indent=2, allow_nan=False))
    else:
        show(results, Console())


if __name__ == "__main__":
    main()
