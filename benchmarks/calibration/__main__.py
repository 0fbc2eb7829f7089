"""Whether what ``roadstate calibrate`` learns is as exact as it says, and what it is good for.

Run from the project's root: python -m benchmarks.calibration [--seeds 20] [--only STUDY …] [--save]
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from pathlib import Path

from benchmarks.machine import processor

_RESULTS = Path(__file__).parent.parent / "results" / "calibration.md"
_STUDIES = ("honesty", "friction")
_FEWER = 5  # a fifth of the seeds for friction, six at least


def _arguments() -> argparse.Namespace:
    from benchmarks.accuracy.scenarios import VEHICLES

    parser = argparse.ArgumentParser(prog="python -m benchmarks.calibration", description=__doc__)
    parser.add_argument(
        "--seeds", type=int, default=20, help="cars of each vehicle; for friction a fifth, 6 at least"
    )
    parser.add_argument("--vehicles", nargs="+", default=list(VEHICLES), metavar="NAME")
    parser.add_argument("--only", nargs="+", default=list(_STUDIES), choices=_STUDIES, metavar="STUDY")
    parser.add_argument("--cache", type=Path, help="folder that keeps logs, outside the project")
    parser.add_argument("--save", action="store_true", help=f"write {_RESULTS.name}")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    given = parser.parse_args()
    if given.seeds < 2:
        parser.error("--seeds: give 2 or more")
    return given


def main() -> None:
    """Measure, and print or save."""
    from benchmarks.accuracy.progress import shown
    from benchmarks.calibration import friction, honesty, page

    from roadstate.core.numerics import use_compilation_cache
    from roadstate.core.tabular import atomic_path
    from roadstate.vehicles import load_vehicle

    given = _arguments()
    use_compilation_cache()
    sections, whole = {}, {"seeds": given.seeds}
    with shown() as progress:
        for done, name in enumerate(given.only):
            begin, busy = time.perf_counter(), time.process_time()

            def tell(what: str, done: int = done) -> None:
                progress(what, done, len(given.only))

            if name == "honesty":
                cars = [load_vehicle(vehicle) for vehicle in given.vehicles]
                found = honesty.study(cars, given.seeds, tell)
                spent = time.perf_counter() - begin, time.process_time() - busy
                sections[page.HONESTY] = page.honest(found, _about(given, name, given.seeds, *spent))
                whole |= page.plain(found, None)
            else:
                fewer = min(given.seeds, max(6, -(-given.seeds // _FEWER)))
                road = friction.study(given.vehicles, fewer, given.cache, tell)
                spent = time.perf_counter() - begin, time.process_time() - busy
                sections[page.FRICTION] = page.of_friction(road, _about(given, name, fewer, *spent))
                whole |= page.plain(None, road)
    text = page.page(sections, _RESULTS.read_text("utf-8") if given.save and _RESULTS.is_file() else "")
    if given.save:
        with atomic_path(_RESULTS) as temporary:
            temporary.write_text(text, encoding="utf-8")
    print(json.dumps(whole) if given.json else text)


def _about(given: argparse.Namespace, study: str, seeds: int, seconds: float, busy: float) -> str:
    import jax

    from roadstate import __version__

    return (
        f"`python -m benchmarks.calibration --seeds {given.seeds} --only {study}`: {seeds} seeds of each "
        f"vehicle ({', '.join(given.vehicles)}); roadstate {__version__}, JAX {jax.__version__}, "
        f"Python {platform.python_version()}, {processor()}; {seconds / 60:.1f} min, {busy / 60:.1f} min of "
        "processor time. Multibody plant, production sensors (preset `automotive`), estimator `joint`; each "
        "seed has a vehicle file of its own, whose mass, yaw inertia, height of the centre of gravity, "
        "stiffnesses and friction of the tires, drag, rolling resistance and lean are off by 5 to 10 %."
    )


if __name__ == "__main__":
    main()
