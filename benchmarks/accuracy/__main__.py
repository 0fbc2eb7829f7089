"""What every estimator reaches, over many seeds, on a plant that is not its own.

Run from the project's root: python -m benchmarks.accuracy [--seeds 50] [--quick] [--only GROUP …]
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.machine import processor

_RESULTS = Path(__file__).parent.parent / "results" / "accuracy.md"
_SUBJECT = "joint"
_STUDIES = ("real", "faults", "speed")
_ALIKE = ("friction-ekf", "friction-pf")  # the model of friction-ukf under another filter


def _arguments() -> argparse.Namespace:
    from benchmarks.accuracy.groups import GROUPS
    from benchmarks.accuracy.scenarios import QUICK, SCENARIOS, VEHICLES

    from roadstate.estimators import all_estimators

    names, groups = list(all_estimators()), [*GROUPS, *_STUDIES]
    usual = [name for name in names if name not in _ALIKE]
    parser = argparse.ArgumentParser(prog="python -m benchmarks.accuracy", description=__doc__)
    parser.add_argument("--seeds", type=int, default=50, help="recordings of each drive")
    parser.add_argument(
        "--quick", action="store_true", help="3 seeds, one vehicle, five drives, no studies unless asked for"
    )
    parser.add_argument("--vehicles", nargs="+", default=list(VEHICLES), metavar="NAME")
    parser.add_argument("--estimators", nargs="+", default=usual, choices=names, metavar="NAME")
    parser.add_argument(
        "--only", nargs="+", default=[], type=lambda name: name.replace("_", "-"), choices=groups,
        metavar="GROUP", help=", ".join(groups),
    )  # fmt: skip
    parser.add_argument("--drives", nargs="+", default=[], choices=list(SCENARIOS), metavar="NAME")
    parser.add_argument("--by-drive", action="store_true", help="friction also for each drive by itself")
    parser.add_argument("--subject", default=_SUBJECT, help="the estimator that is judged")
    parser.add_argument("--cache", type=Path, help="folder that keeps logs, outside the project")
    parser.add_argument("--save", action="store_true", help=f"write {_RESULTS.name}")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    given = parser.parse_args()
    if given.seeds < 1:
        parser.error("--seeds: give 1 or more")
    if given.quick:
        given.seeds, given.vehicles = 3, given.vehicles[:1]
        given.only, given.drives = given.only or list(GROUPS), given.drives or list(QUICK)
    return given


def main() -> None:
    """Measure, and print or save."""
    from benchmarks.accuracy import faults, real, speed
    from benchmarks.accuracy.groups import GROUPS
    from benchmarks.accuracy.progress import shown
    from benchmarks.accuracy.run import Results, run
    from benchmarks.accuracy.studies import faults_section, plain, speed_section
    from benchmarks.accuracy.table import as_json, markdown

    from roadstate.core.numerics import use_compilation_cache
    from roadstate.core.tabular import atomic_path
    from roadstate.run import smooth

    given = _arguments()
    use_compilation_cache()
    begin, busy = time.perf_counter(), time.process_time()
    wanted = given.only or [*GROUPS, *_STUDIES]
    groups = [name for name in GROUPS if name in wanted]
    first, judged = given.vehicles[0], given.subject if given.subject in given.estimators else None
    found, failed, timed = Results([], []), [], []
    with shown() as progress:
        if groups:
            found = run(
                given.vehicles,
                given.estimators,
                given.seeds,
                subject=judged,
                only=groups,
                drives=given.drives,
                by_drive=given.by_drive,
                cache=given.cache,
                smooth=smooth,
                progress=progress,
            )
        if "real" in wanted:
            found.scores.extend(real.study(given.estimators, lambda what: progress(what, 0, 1)))
        if "faults" in wanted:
            some = [judged] if judged else given.estimators
            seeds = min(given.seeds, faults.SEEDS)
            failed = faults.study(given.vehicles, some, seeds, lambda what: progress(what, 0, 1))
        if "speed" in wanted:
            timed = speed.study(first, given.estimators, lambda what: progress(what, 0, 1))
    about = _about(given, time.perf_counter() - begin, time.process_time() - busy)
    titles = {name: kind.title for name, kind in GROUPS.items()} | {real.GROUP: real.TITLE}
    sections = [faults_section(failed, given.subject)] if failed else []
    sections += [speed_section(timed, first, given.subject)] if timed else []
    page = markdown(
        titles, found.scores, found.notes, preamble=_preamble(about), sections=sections, subject=given.subject
    )
    if given.save:
        with atomic_path(_RESULTS) as temporary:
            temporary.write_text(page)
    whole = {**as_json(about, found.scores, found.notes), "faults": plain(failed), "speed": plain(timed)}
    print(json.dumps(whole, allow_nan=False) if given.json else page)


def _about(given: argparse.Namespace, seconds: float, busy: float) -> dict[str, Any]:
    import jax
    from benchmarks.accuracy.scenarios import few

    from roadstate import __version__

    return {
        "command": " ".join(["python -m benchmarks.accuracy", *_without_cache(sys.argv[1:])]),
        "seeds": given.seeds,
        "few": few(given.seeds),
        "vehicles": given.vehicles,
        "roadstate": __version__,
        "jax": jax.__version__,
        "python": platform.python_version(),
        "processor": processor(),
        "seconds": round(seconds),
        "processor_seconds": round(busy),
    }


def _without_cache(arguments: list[str]) -> list[str]:
    """What was asked for; where logs are kept changes nothing."""
    kept: list[str] = []
    for argument in arguments:
        if kept[-1:] == ["--cache"]:
            kept.pop()
        elif not argument.startswith("--cache="):
            kept.append(argument)
    return kept


def _preamble(about: dict[str, Any]) -> str:
    from benchmarks.accuracy.table import wrapped

    vehicles = ", ".join(about["vehicles"])
    text = (
        f"`{about['command']}`: {about['seeds']} seeds of each drive, {about['few']} of those over half a "
        f"minute and for estimators that are not judged; vehicles {vehicles}; "
        f"roadstate {about['roadstate']}, JAX {about['jax']}, Python {about['python']}, "
        f"{about['processor']}; {about['seconds'] / 60:.1f} "
        f"min, {about['processor_seconds'] / 60:.1f} min of processor time. Each drive is driven once on the "
        "multibody plant with anti-lock and traction control, then recorded with every seed's own production "
        "sensors (preset `automotive`); each seed's estimator is told a vehicle file of its own, whose mass, "
        "yaw inertia, height of the centre of gravity, stiffnesses and friction of the tires, drag, rolling "
        "resistance and lean are off by 5 to 10 %. "
        f"{' and '.join(f'`{name}`' for name in _ALIKE)} are run only when asked for: they are the model of "
        "`friction-ukf` under another filter."
    )
    return "# Accuracy\n\n" + wrapped(text)


if __name__ == "__main__":
    main()
