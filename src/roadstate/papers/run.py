"""Running papers: every condition on every plant, every method with both settings, over many noise seeds."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from threading import Event, Lock

import numpy as np

from roadstate.core import REFERENCES, Estimates, InputError, Log
from roadstate.papers.base import MATCHED, PLANTS, VARIANTS, Build, Cell, Condition, Figure, Paper, Variant
from roadstate.papers.plants import drive_on, recordings, told
from roadstate.run import batch

Progress = Callable[[str, int, int], None]
"""Called with what has just been done, how many pieces of work are done, and how many there are."""
_MOST_WORKERS = 4  # each holds the logs of one condition on one plant


@dataclass(frozen=True)
class Spread:
    """A number over noise seeds.

    Attributes:
        mean, std: over the seeds where it is finite; the standard deviation is the sample's (n − 1).
            ``None`` where there are none, or for the latter fewer than two.
        lost: seeds where it is not finite, as of a filter that diverged.
    """

    mean: float | None
    std: float | None
    lost: int

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Of one value per seed."""
        every = np.asarray(values, float)
        good = every[np.isfinite(every)]
        mean = float(np.mean(good)) if len(good) else None
        std = float(np.std(good, ddof=1)) if len(good) > 1 else None
        return cls(mean, std, len(every) - len(good))


@dataclass(frozen=True)
class Outcome:
    """A cell on one plant.

    Attributes:
        cell: of the paper.
        seeds: noise seeds.
        as_printed, best: ours, by settings; ``None`` where there is none.
        bound: the cell's, of the first seed's log; ``None`` where it has none.
        reason: why something is missing; empty where nothing is.
    """

    cell: Cell
    seeds: int
    as_printed: Spread | None
    best: Spread | None
    bound: float | None
    reason: str

    @property
    def meets_paper(self) -> bool:
        """Whether the mean with the best settings is no larger than the paper's figure, no seed lost."""
        mean = None if self.best is None or self.best.lost else self.best.mean
        return mean is not None and self.cell.paper is not None and mean <= self.cell.paper


@dataclass(frozen=True)
class Drawing:
    """What a figure shows on one plant: the first seed's run.

    Attributes:
        figure: of the paper.
        plant: its name.
        variant: which settings.
        log: the truth in it.
        results: method → estimates; those are missing that could not run.
    """

    figure: Figure
    plant: str
    variant: Variant
    log: Log
    results: dict[str, Estimates]


@dataclass(frozen=True)
class PaperResult:
    """A paper as it came out here.

    Attributes:
        paper: what was run.
        seeds: noise seeds.
        cells: plant → outcomes, in the paper's order.
        drawings: in the paper's order of figures, then by plant and settings.
    """

    paper: Paper
    seeds: int
    cells: dict[str, list[Outcome]]
    drawings: list[Drawing]


def run_papers(
    papers: Sequence[Paper],
    *,
    plants: Sequence[str] = PLANTS,
    seeds: int = 20,
    progress: Progress | None = None,
) -> list[PaperResult]:
    """Drive, record and estimate all that papers ask for; the same arguments give the same numbers.

    Each condition is driven once on the matched plant and once on the reference plant, and recorded with
    every seed. What cannot run, for want of a channel say, is left out with its reason.

    Args:
        papers: to run.
        plants: of :data:`roadstate.papers.base.PLANTS`.
        seeds: noise seeds, 0 and up.
        progress: told of each piece of work; from several threads, one at a time.
    """
    jobs = _jobs(papers, plants, seeds)
    tally = _Tally(sum(job.size for job in jobs), progress)
    workers = max(1, min(os.cpu_count() or 1, len(jobs), _MOST_WORKERS))
    with ThreadPoolExecutor(workers) as pool:
        threads = max(1, (os.cpu_count() or 1) // workers)
        futures = [pool.submit(job.run, tally, threads) for job in jobs]
        try:
            wait(futures, return_when=FIRST_EXCEPTION)
            for failed in (f for f in futures if f.done() and f.exception()):
                failed.result()
            found = [future.result() for future in futures]
        except BaseException:
            tally.stop.set()  # the others end at their next piece, and leaving the pool waits for that
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    runs = {key: run for part in found for key, run in part.items()}
    return [_collected(paper, plants, seeds, runs) for paper in papers]


def _jobs(papers: Sequence[Paper], plants: Sequence[str], seeds: int) -> list[_Job]:
    """What one thread does at a time, ordered so that neighbours seldom wait for the same compilation."""
    shared = [p for p in PLANTS if p in plants and p != MATCHED]
    groups = [group for group in (shared, [MATCHED] if MATCHED in plants else []) if group]
    most = max((len(paper.conditions) for paper in papers), default=0)
    rounds = [(group, i, paper) for group in groups for i in range(most) for paper in papers]
    jobs: list[_Job] = []
    for group, i, paper in rounds:
        for condition in paper.conditions[i : i + 1]:
            methods = _methods(paper, condition)
            if methods:
                turn = len(jobs) % len(methods)
                jobs.append(_Job(paper, condition, group, methods[turn:] + methods[:turn], seeds))
    return jobs


def _methods(paper: Paper, condition: Condition) -> list[str]:
    """Names of the methods that some cell or figure shows under a condition, in the paper's order."""
    used = {c.method for c in paper.cells if c.condition == condition.name}
    used |= {m for f in paper.figures if f.condition == condition.name for m in f.methods}
    return [name for name in paper.methods if name in used]


@dataclass
class _Tally:
    """How much is done, and whether to go on."""

    total: int
    progress: Progress | None
    done: int = 0
    lock: Lock = field(default_factory=Lock)
    stop: Event = field(default_factory=Event)

    def add(self, what: str, count: int = 1) -> None:
        if self.stop.is_set():
            raise InterruptedError
        with self.lock:
            self.done += count
            if self.progress is not None:
                self.progress(what, self.done, self.total)


@dataclass
class _Run:
    """A condition on a plant: values per seed of each cell, the first seed's run, and what failed."""

    log: Log | None = None
    values: dict[tuple[Cell, Variant], list[float]] = field(default_factory=dict)
    bounds: dict[Cell, float] = field(default_factory=dict)
    first: dict[tuple[str, Variant], Estimates] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)  # by method; "" is all of them


_Key = tuple[str, str, str]  # paper, condition, plant


@dataclass(frozen=True)
class _Job:
    """A condition on the plants that share a drive, and the methods in their turn."""

    paper: Paper
    condition: Condition
    plants: list[str]
    methods: list[str]
    seeds: int

    @property
    def size(self) -> int:
        """Pieces of work: a recording on each plant, and each method with each settings."""
        return len(self.plants) * (1 + len(VARIANTS) * len(self.methods))

    def run(self, tally: _Tally, threads: int) -> dict[_Key, _Run]:
        title = f"{self.paper.name}: {self.condition.name}"
        found = {(self.paper.name, self.condition.name, plant): _Run() for plant in self.plants}
        try:
            tally.add(f"{title}: driving", 0)
            driven = drive_on(self.condition, matched=self.plants == [MATCHED])
        except InputError as error:
            for run in found.values():
                run.reasons[""] = str(error)
            tally.add(title, self.size)
            return found
        for plant, run in zip(self.plants, found.values(), strict=True):
            logs = []
            for log in recordings(driven, self.condition, plant, self.seeds):
                logs.append(log)
                tally.add(f"{title}, {plant}: recording", 0)
            tally.add(f"{title}, {plant}", 1)
            self._estimate(run, plant, logs, tally, threads)
        return found

    def _estimate(self, run: _Run, plant: str, logs: list[Log], tally: _Tally, threads: int) -> None:
        run.log = logs[0].select(logs[0].references)
        cells = [c for c in self.paper.cells if c.condition == self.condition.name]
        for bound in dict.fromkeys(c.bound for c in cells if c.bound is not None):
            same = [c for c in cells if c.bound is bound]
            try:
                run.bounds |= dict.fromkeys(same, bound(logs[0], self.condition.vehicle))
            except InputError as error:
                run.reasons |= {c.method: f"no bound: {error}" for c in same}
        for name in self.methods:
            for variant in VARIANTS:
                build: Build = getattr(self.paper.methods[name], variant)
                try:
                    estimates = self._batch(build, plant, logs, threads)
                    for cell in (c for c in cells if c.method == name):
                        run.values[cell, variant] = _measured(cell, estimates, logs)
                    run.first[name, variant] = estimates[0]
                except InputError as error:
                    run.reasons[name] = str(error)
                tally.add(f"{self.paper.name}: {self.condition.name}, {plant}: {name}")

    def _batch(self, build: Build, plant: str, logs: list[Log], threads: int) -> list[Estimates]:
        cars = [told(self.condition.vehicle, plant, seed) for seed in range(len(logs))]
        available = logs[0].available
        if all(car is cars[0] for car in cars):
            return batch(build(cars[0], available), logs, workers=threads)
        return batch([build(car, available) for car in cars], logs, workers=threads)


def _measured(cell: Cell, estimates: list[Estimates], logs: list[Log]) -> list[float]:
    with np.errstate(all="ignore"):  # what diverged overflows, and is then counted
        return [float(cell.measure(e, log)) for e, log in zip(estimates, logs, strict=True)]


def _collected(paper: Paper, plants: Sequence[str], seeds: int, runs: dict[_Key, _Run]) -> PaperResult:
    def outcome(cell: Cell, plant: str) -> Outcome:
        run = runs[paper.name, cell.condition, plant]
        ours = {v: run.values.get((cell, v)) for v in VARIANTS}
        as_printed, best = (None if v is None else Spread.of(v) for v in ours.values())
        reason = run.reasons.get("") or run.reasons.get(cell.method, "")
        return Outcome(cell, seeds, as_printed, best, run.bounds.get(cell), reason)

    cells = {p: [outcome(cell, p) for cell in paper.cells] for p in PLANTS if p in plants}
    drawings = []
    for figure in paper.figures:
        for plant in cells:
            run = runs[paper.name, figure.condition, plant]
            for variant in VARIANTS:
                shown = {m: run.first[m, variant] for m in figure.methods if (m, variant) in run.first}
                shown = {m: e for m, e in shown.items() if figure.quantity in e.values}
                if run.log is not None and shown:
                    needed = REFERENCES[figure.quantity].channels if figure.quantity in REFERENCES else ()
                    drawings.append(Drawing(figure, plant, variant, run.log.select(needed), shown))
    return PaperResult(paper, seeds, cells, drawings)
