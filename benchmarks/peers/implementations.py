"""Which implementations there are, what they can do, and over how many samples each is run."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from benchmarks.peers import friction, grade, ours, tfobe, with_c
from benchmarks.peers.problems import Method, Problem
from benchmarks.peers.program import Program


@dataclass(frozen=True)
class Size:
    """How much is run.

    Attributes:
        steps: samples of a log.
        slow: samples for implementations that take a hundred times as long.
        batch: samples of each log of a batch.
        logs: of a batch.
        repeats: rounds over all implementations.
        compared: samples on which particle filters are compared.
        many: particles of the filter that stands for the truth there.
    """

    steps: int = 11_000
    slow: int = 500
    batch: int = 1000
    logs: int = ours.LOGS
    repeats: int = 7
    compared: int = 500
    many: int = 50_000


FULL = {
    "tfobe-lower-ukf": Size(),
    "friction-ukf": Size(),
    "friction-pf-1000": Size(steps=2200, slow=100, batch=50),
    "kf-2": Size(),
}
# long enough that the cost of a call as such, some 0.1 ms, does not count
QUICK = {
    "tfobe-lower-ukf": Size(steps=600, slow=40, batch=100, logs=64, repeats=3),
    "friction-ukf": Size(steps=2000, slow=60, batch=500, logs=64, repeats=3),
    "friction-pf-1000": Size(steps=200, slow=20, batch=10, logs=64, repeats=3, compared=100, many=10_000),
    "kf-2": Size(slow=300, batch=2000, logs=64, repeats=3),
}

PROBLEMS: dict[str, tuple[Method, Callable[[int], Problem]]] = {
    "tfobe-lower-ukf": ("ukf", tfobe.problem),
    "friction-ukf": ("ukf", partial(friction.problem, "ukf")),
    "friction-pf-1000": ("pf", partial(friction.problem, "pf")),
    "kf-2": ("kf", grade.problem),
}
"""Name → what is run, and the problem with a log of so many samples."""


@dataclass(frozen=True)
class Library:
    """Another library.

    Attributes:
        module: of this package, that runs it.
        methods: it has.
        slow: it loops in Python.
    """

    module: str
    methods: tuple[Method, ...]
    slow: tuple[Method, ...] = ()


LIBRARIES = {
    "dynamax": Library("with_dynamax", ("kf", "ukf")),
    "filterpy": Library("with_filterpy", ("kf", "ukf", "pf"), ("kf", "ukf", "pf")),
    "pykalman": Library("with_pykalman", ("kf", "ukf"), ("kf", "ukf")),
    "cuthbert": Library("with_cuthbert", ("kf", "ukf", "pf"), ("pf",)),
    "stonesoup": Library("with_stonesoup", ("kf", "ukf", "pf"), ("kf", "ukf", "pf")),
}


def programs(problem: Problem, size: Size, tell: Callable[[str], None]) -> Iterator[tuple[str, Program]]:
    """Every implementation that can do the problem and is installed, made ready.

    Args:
        problem: with the whole log.
        size: how many samples of it slow ones take, and batches of what size.
        tell: called with a line for each implementation that is left out.
    """
    try:
        yield "c", with_c.program(problem)
    except FileNotFoundError as error:
        tell(f"c: left out, {error}")
    short = problem.first(size.batch)
    yield "roadstate-scan", ours.scan(problem)
    yield "roadstate-batch", ours.batch(short, logs=size.logs)
    yield "roadstate-stream", ours.stream(problem)
    if problem.linear:
        yield "roadstate-scan-marginal", ours.scan(problem, marginal=True)
        yield "roadstate-batch-marginal", ours.batch(short, marginal=True, logs=size.logs)
    for name, library in LIBRARIES.items():
        if problem.method not in library.methods:
            continue
        try:
            module = importlib.import_module(f"benchmarks.peers.{library.module}")
        except ModuleNotFoundError as error:
            if error.name is None or error.name.startswith(("benchmarks", "roadstate")):
                raise
            tell(f"{name}: left out, {error.name} is not installed; pip install 'roadstate[peers]'")
            continue
        slow = problem.method in library.slow
        yield name, module.program(problem.first(size.slow) if slow else problem)
