"""Logs that begin in the midst of wheel slip, or of a bend: what `joint` says from its first sample on.

Run from the project's root: python -m benchmarks.starts [--drives 30]

Drives drawn at random, as `benchmarks.drawn` has them. Some are cut where at least one tire slips by more
than an eighth: under traction control or anti-lock brakes, on ice mostly. Nothing is known of the speed then
but what wheels tell that do not roll. Others, on winding roads, where a bend pulls the car aside by more than
2 m/s²: nobody has seen how its lateral forces grew.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from benchmarks.accuracy.measures import interval
from benchmarks.accuracy.progress import shown
from benchmarks.accuracy.run import without
from benchmarks.accuracy.scenarios import VEHICLES
from benchmarks.drawn.__main__ import LACKING, recorded
from benchmarks.drawn.drives import MIXED, WINDING, Roads
from numpy.typing import NDArray

from roadstate.core import WHEELS, Estimates, Log, reference
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build
from roadstate.run import batch
from roadstate.vehicles import Vehicle

Array = NDArray[np.float64]
_SLIP, _PULL, _MOVING = 0.125, 2.0, 3.0  # of a tire, m/s², and m/s, from which a log may begin
_CUTS, _SECONDS = 4, 10.0  # logs of each drive, and how long they are
_CHANNELS = ("bus", "receiver", "no torques")
_TIMES = ((0.0, 0.5), (0.5, 2.0), (2.0, 5.0), (5.0, _SECONDS))  # s since the first sample


def slips(log: Log) -> NDArray[np.bool_]:
    """(T,) where a tire slips."""
    return np.max([np.abs(log[f"ref_slip_{w}"]) for w in WHEELS], axis=0) > _SLIP


def turns(log: Log) -> NDArray[np.bool_]:
    """(T,) where a bend pulls the car aside."""
    return np.abs(log["accel_y"]) > _PULL


class Start(NamedTuple):
    """How logs begin.

    Attributes:
        name: in one word.
        roads: of the drives.
        begins: where, in a drive.
        quantities: what is told of them, the name of its error, and what makes a figure the error's.
    """

    name: str
    roads: Roads
    begins: Callable[[Log], NDArray[np.bool_]]
    quantities: tuple[tuple[str, str, Callable[[Array], Array]], ...]


def per_cent(share: Array) -> Array:
    """A share as per cent."""
    return 100 * share


_OF_SLIPS = (("speed", "speed, m/s", np.asarray), ("grade", "slope, %", per_cent))
_OF_BENDS = (("friction_peak", "ln friction", np.log), ("velocity_y", "v_y, m/s", np.asarray))
STARTS = (Start("slip", MIXED, slips, _OF_SLIPS), Start("bend", WINDING, turns, _OF_BENDS))


def cuts(log: Log, begins: NDArray[np.bool_], rng: np.random.Generator) -> Iterator[Log]:
    """Parts of a drive that begin, on the move, where ``begins`` (T,) says."""
    fast = log["ref_velocity_x"] > _MOVING
    places = np.flatnonzero(begins & fast & (log.time < log.time[-1] - _SECONDS))
    for i in np.unique(rng.choice(places, _CUTS)) if len(places) else ():
        yield log.between(log.time[i], log.time[i] + _SECONDS)


def rows(said: Estimates, log: Log, start: Start) -> Array:
    """(times, quantities, 2): mean squared error, and share of samples whose interval holds the truth."""
    since = log.time - log.time[0]
    found = []
    for quantity, _, figure in start.quantities:
        truth, ends = reference(quantity, log.channels), interval(said, quantity)
        assert truth is not None
        assert ends is not None
        squared = (figure(said.values[quantity]) - figure(truth)) ** 2
        inside = (ends[0] < truth) & (truth < ends[1])
        parts = [(since >= begin) & (since < end) for begin, end in _TIMES]
        found.append([(float(np.mean(squared[p])), float(np.mean(inside[p]))) for p in parts])
    return np.swapaxes(np.array(found), 0, 1)


def study(start: Start, count: int) -> dict[str, Array]:
    """Channels → (logs, times, quantities, 2)."""
    rng = np.random.default_rng(0)
    found: dict[str, list[Array]] = defaultdict(list)
    with shown() as tell:
        for i, vehicle in enumerate(VEHICLES):
            parts: list[tuple[Log, Vehicle]] = []
            for k, (log, car) in enumerate(recorded(vehicle, count, start.roads)):
                tell(f"{start.name}, {vehicle}: drive {k + 1}", i * count + k, count * len(VEHICLES))
                parts += [(part, car) for part in cuts(log, start.begins(log), rng)]
            for channels in _CHANNELS if parts else ():
                own = [without(part, LACKING[channels]) for part, _ in parts]
                built = [build("joint", car, own[0].available) for _, car in parts]
                said = zip(batch(built, own), own, strict=True)
                found[channels] += [rows(estimates, log, start) for estimates, log in said]
    return {channels: np.array(each) for channels, each in found.items()}


def table(start: Start, found: dict[str, Array]) -> str:
    """In Markdown."""
    columns = [f"{label}: RMSE | of 9 in 10 logs | inside" for _, label, _ in start.quantities]
    lines = [f"| channels | s | {' | '.join(columns)} |", "|" + "---|" * (2 + 3 * len(columns))]
    for channels, logs in found.items():
        for (begin, end), part in zip(_TIMES, np.moveaxis(logs, 1, 0), strict=True):
            cells = [f"{begin:g}–{end:g}"]
            for squared, inside in np.moveaxis(part, (0, 1, 2), (2, 0, 1)):
                rms, nine = np.sqrt(squared.mean()), np.sqrt(np.percentile(squared, 90))
                cells += [f"{rms:.2f}", f"{nine:.2f}", f"{100 * inside.mean():.0f} %"]
            lines.append("| " + " | ".join([channels, *cells]) + " |")
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.starts", description=__doc__)
    parser.add_argument("--drives", type=int, default=30, help="of each vehicle")
    given = parser.parse_args()
    if given.drives < 1:
        parser.error("--drives: give 1 or more")
    use_compilation_cache()
    print(
        "# Logs that begin in the midst of wheel slip, or of a bend\n\n"
        "`python -m benchmarks.starts`: the drives of `benchmarks.drawn`, cut at up to"
        f" {_CUTS} moments at which a tire slips by more\nthan {_SLIP:g},"
        " under traction control or anti-lock brakes, on ice mostly; and those on winding roads, where a bend"
        f" pulls\nthe car aside by more than {_PULL:g} m/s². `joint` reads {_SECONDS:g} s from there on."
        " Channels as there. Inside: samples whose 95 %\ninterval (of friction: 5 % to 95 % bounds) holds the"
        " truth. Of 9 in 10 logs: RMSE that one in ten exceeds."
    )
    for start in STARTS:
        found = study(start, given.drives)
        count = len(next(iter(found.values()), ()))
        print(f"\n## Begins in the midst of a {start.name}: {count} logs\n\n{table(start, found)}")


if __name__ == "__main__":
    main()
