"""Running estimators on logs, for the commands that do."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from threading import Event
from typing import TYPE_CHECKING, Any

from roadstate.core import REFERENCES, Estimates, InputError, Log

if TYPE_CHECKING:
    from roadstate.cli.logs import Source
    from roadstate.cli.progress import Work
    from roadstate.estimators import Estimator
    from roadstate.lateness import Late
    from roadstate.metrics import Metrics
    from roadstate.vehicles import Vehicle


@dataclass(frozen=True)
class Run:
    """What came of one log.

    Attributes:
        name: of the log.
        log: the channels the estimators saw.
        results: estimator → estimates.
        metrics: estimator → quantity → errors; empty where the log has no reference.
        late: channels that come late throughout.
    """

    name: str
    log: Log
    results: dict[str, Estimates]
    metrics: dict[str, dict[str, Metrics]]
    late: list[Late]


def run_log(
    name: str,
    log: Log,
    vehicle: Vehicle,
    estimators: Sequence[str],
    work: Work,
    *,
    settle: float = 0.0,
    smooth: bool = False,
) -> Run:
    """Run estimators on a log and compare them with its references.

    Args:
        name: of the log.
        log: its channels.
        vehicle: the car.
        estimators: names; none means all that the channels allow.
        work: told of the progress.
        settle: seconds at the start that the metrics leave out.
        smooth: let each sample know of those after it, too.

    Raises:
        InputError: an estimator's channels are missing, it cannot be smoothed, or there is none that the
            channels would do for.
    """
    from roadstate.core.numerics import use_compilation_cache
    from roadstate.lateness import lateness
    from roadstate.metrics import evaluate
    from roadstate.run.smooth import smoothable

    use_compilation_cache()
    chosen = list(dict.fromkeys(estimators)) or _all_that_run(log, smooth)
    built = [_built(one, vehicle, log) for one in chosen]
    if smooth:
        for estimator in built:
            smoothable(estimator)
    work.begin(f"{name}: {', '.join(chosen)}")
    results = dict(zip(chosen, _run_together(built, log, work, smooth), strict=True))
    metrics = {one: evaluate(estimates, log, settle=settle) for one, estimates in results.items()}
    return Run(name, log, results, {one: m for one, m in metrics.items() if m}, lateness(log, vehicle))


def _built(name: str, vehicle: Vehicle, log: Log) -> Estimator[Any]:
    """An estimator for the channels there; a refusal names a channel that is there but empty."""
    from roadstate.cli.left_out import LOOK_AT_IT
    from roadstate.estimators import build

    try:
        return build(name, vehicle, log.available)
    except InputError as refusal:
        empty = sorted(c for c in set(log.channels) - log.available if c in refusal.what)
        if not empty:
            raise
        what = f"{refusal.what}, and {' and '.join(empty)} has no sample that is a number"
        raise InputError(what, where=refusal.where, mend=LOOK_AT_IT) from refusal


def _run_together(built: Sequence[Estimator[Any]], log: Log, work: Work, smooth: bool) -> list[Estimates]:
    """Run all estimators at once: compiling and running one leaves the other cores idle."""
    from roadstate import run

    over = run.smooth if smooth else run.scan
    done = [0] * len(built)
    stop = Event()

    def run_one(i: int) -> Estimates:
        def progress(samples: int, total: int) -> None:
            if stop.is_set():
                raise InterruptedError
            done[i] = samples
            work.advance(sum(done), total * len(built))

        return over(built[i], log, progress=progress)

    with ThreadPoolExecutor(min(len(built), os.cpu_count() or 1)) as pool:
        futures = [pool.submit(run_one, i) for i in range(len(built))]
        try:
            return [future.result() for future in futures]
        except BaseException:
            stop.set()  # the others end at their next chunk, and leaving the pool waits for that
            raise


def run_all(
    source: Source,
    vehicle: Vehicle,
    estimators: Sequence[str],
    work: Work,
    *,
    settle: float = 0.0,
    smooth: bool = False,
    needs_reference: bool = False,
) -> Iterator[Run]:
    """Read and run one log after another, so that only one is in memory.

    Args:
        source: the logs.
        vehicle: the car.
        estimators: names; none means all that the channels allow.
        work: told of the progress.
        settle: seconds at the start that the metrics leave out.
        smooth: let each sample know of those after it, too.
        needs_reference: refuse a log without one.

    At its end the canonical channels that are in the files but could not be read, are empty or are spelt
    otherwise are named on standard error, and those whose samples are repeated from row to row or come late.

    Raises:
        InputError: names the file at fault.
    """
    from roadstate.cli.left_out import blaming, missed_channels, notes
    from roadstate.cli.logs import naming

    groups, mapping = source.groups(), source.load_mapping()
    noted: list[InputError] = []
    work.begin(f"reading {', '.join(groups)}")
    for name, log in source.logs(vehicle):
        file = groups[name][0]
        with naming(file), blaming(missed_channels(log.metadata, mapping)):
            if needs_reference:
                _check_reference(log, settle)
            run = run_log(name, log, vehicle, estimators, work, settle=settle, smooth=smooth)
        yield run
        noted += notes(file, log, mapping, run.late)
        work.begin("reading")
    for note in noted:  # not before the last log is done, since a refusal is to be the only line
        print(note, file=sys.stderr)


def _check_reference(log: Log, settle: float) -> None:
    if not any(log.available.issuperset(r.channels) for r in REFERENCES.values()):
        raise InputError(
            "no reference to compare with (ref_grade, ref_velocity_x, ref_friction_* of a wheel …)",
            mend="map one under 'reference:' in the mapping file, or use 'roadstate estimate'",
        )
    if settle > log.duration:  # said before any estimator has run
        raise InputError(
            f"no sample is left to compare after {settle:g} s",
            mend=f"use a shorter settle; the last one lies at {log.duration:.6g} s",
        )


def _all_that_run(log: Log, smooth: bool) -> list[str]:
    from roadstate.estimators import all_estimators, runnable

    kinds = {n: e for n, e in all_estimators().items() if e.smoothable is not None or not smooth}
    names = [name for name in runnable(log.available) if name in kinds]
    if not names:
        missing = {
            name: [need for need in e.needs if not need.is_met(log.available)] for name, e in kinds.items()
        }
        least = min(len(m) for m in missing.values())
        needs = "; ".join(f"{name} needs {needs_text(m)}" for name, m in missing.items() if len(m) == least)
        raise InputError(f"no estimator can run on the channels there ({needs})", mend="map the missing ones")
    return names


def needs_text(needs: Sequence[Any]) -> str:
    """What an estimator needs, in words."""
    return " and ".join(need.what for need in needs)
