"""The studies of faults and of speed as sections of the page, and in plain types."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from benchmarks.accuracy.faults import REDUNDANCY, SENSORS, Outcome, words
from benchmarks.accuracy.speed import LOGS, Speed
from benchmarks.accuracy.table import fitted, number

from roadstate.sim.sensors import KINDS

_FAULTS = """## Faults of single sensors: curve-variable-speed, 8 s from 63 s on (a `time_jump`, 0.5 s, stays)

Survived: finite throughout, and from 2 s after the fault on grade within 5 % of slope and the lower bound of
friction below the truth in 95 % of the samples. Flagged: `validity` says that a sensor is missing or at
fault, or that the filter failed, or the gate refuses more samples than without the fault, within 1 s of the
first sample that differs. Tellable: within this second the sensor is silent for a fifth of it, or deviates
from the truth by 3σ of what tells the same (last table); a smaller deviation looks like a road, a tire or a
vehicle file that is a little off, and is `hidden`. Goal: all survived, all that are tellable flagged."""


def faults_section(outcomes: Sequence[Outcome], subject: str) -> str:
    """How many faults each estimator survives and flags, and the matrix of the one that is judged.

    Args:
        outcomes: of all estimators.
        subject: whose matrix is shown; that of the first estimator where it is not among them.
    """
    names = list(dict.fromkeys(o.estimator for o in outcomes))
    rows = []
    for name in sorted(names, key=lambda n: (n != subject, n)):
        own = [o for o in outcomes if o.estimator == name]
        lost = [f"{o.sensor} {o.kind}" for o in own if not o.survived]
        soon = [o for o in own if o.flagged_s is not None and o.flagged_s <= 1.0]
        tellable = [o for o in own if o.tellable]
        found = [o for o in tellable if o in soon]
        verdict = "met" if len(found) == len(tellable) and not lost else "missed"
        kept = f"{len(own) - len(lost)}"
        rows.append([name, str(len(own)), kept, str(len(tellable)), str(len(found)), str(len(soon)), verdict])
    head = ["estimator", "faults", "survived", "tellable", "of them flagged", "flagged", "verdict"]
    counts = fitted(head, rows)
    shown = subject if subject in names else names[0]
    own = [o for o in outcomes if o.estimator == shown]
    read = [sensor for sensor in SENSORS if any(o.sensor == sensor for o in own)]
    cells = [
        [f"`{sensor}`", *(words([o for o in own if (o.sensor, o.kind) == (sensor, kind)]) for kind in KINDS)]
        for sensor in read
    ]
    drives = len({(o.vehicle, o.seed) for o in own})
    legend = (
        f"`{shown}`, the worst of {drives} drives of other vehicles and seeds: `ok`, or what is wrong after "
        "the fault (`GRADE`,\n`FRICTION`, `NAN`) and in how many drives; and when it was flagged (`≤ 1 s`: "
        "by the gate). Empty where\nthe fault changes nothing."
    )
    known = [[f"`{s}`", REDUNDANCY[s][0], f"{REDUNDANCY[s][1]:g}"] for s in read if s in REDUNDANCY]
    against = fitted(["sensor", "what tells the same", "1σ, in the channel's SI unit"], known)
    return "\n\n".join([_FAULTS, counts, legend, fitted(["sensor", *KINDS], cells), against])


def speed_section(speeds: Sequence[Speed], vehicle: str, subject: str) -> str:
    """A row for each estimator."""
    rows = [
        [s.estimator, number(s.scan_us), number(s.real_time), number(s.batch_us)]
        for s in sorted(speeds, key=lambda s: (s.estimator != subject, s.scan_us))
    ]
    head = ["estimator", "scan, µs a step", "× real time at 100 Hz", f"batch of {LOGS}, µs a step and log"]
    title = f"## Speed: a log of 60 s (`{vehicle}`), least of three; {LOGS} logs at once on all processors"
    return f"{title}\n\n{fitted(head, rows)}"


def plain(found: Sequence[Outcome] | Sequence[Speed]) -> list[dict[str, Any]]:
    """For JSON."""
    return [
        {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in asdict(one).items()}
        for one in found
    ]
