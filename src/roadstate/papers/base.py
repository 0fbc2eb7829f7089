"""What a paper is made of here: conditions to drive, methods to run, cells to fill, figures to draw."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from roadstate.core import Estimates, Log
from roadstate.estimators import Estimator
from roadstate.sim.manoeuvres.base import Manoeuvre
from roadstate.sim.plant.base import Plant
from roadstate.sim.sensors import SensorSuite
from roadstate.vehicles import Vehicle

MATCHED, FULL, MISMATCHED = PLANTS = ("matched", "full", "full-mismatched")
"""The estimator's own model; the reference plant; that with production sensors and figures that are off."""

Build = Callable[[Vehicle, Collection[str]], Estimator[Any]]
"""An estimator for a vehicle file and the channels of a log."""
Measure = Callable[[Estimates, Log], float]
"""One figure of one run, in the unit of its cell."""
Variant = Literal["as_printed", "best"]
VARIANTS: tuple[Variant, ...] = ("as_printed", "best")
"""Fields of :class:`Method`: the paper's own settings, our best ones."""


@dataclass(frozen=True)
class Condition:
    """One drive of a paper.

    Attributes:
        name: short, for programs and file names.
        title: one line: what is driven, and what of it the paper does not say and was chosen.
        vehicle: the vehicle file that plant and estimator are built from.
        manoeuvre: what to drive, for that vehicle.
        matched: the plant that is the estimators' own model.
        sensors: what is measured on the plants ``matched`` and ``full``.
        disturb: what else befalls a log (noise that changes, say); its own random numbers come with it.
    """

    name: str
    title: str
    vehicle: Vehicle
    manoeuvre: Callable[[Vehicle], Manoeuvre]
    matched: Callable[[Vehicle], Plant]
    sensors: SensorSuite
    disturb: Callable[[Log, np.random.Generator], Log] | None = None


@dataclass(frozen=True)
class Method:
    """An estimator twice: with the paper's own settings, and with the best ones of the same method."""

    as_printed: Build
    best: Build


@dataclass(frozen=True)
class Cell:
    """One number of a table: an error, or another number that is the better the smaller it is.

    Attributes:
        table, row, column: where it stands.
        unit: of the number, as people write it.
        paper: the paper's figure; ``None`` where it gives none.
        condition: name of the drive.
        method: name of the method.
        measure: how the number is had from a run.
        bound: the least that any estimator could reach there, from a log and the vehicle file, if computed.
        lost: what it means that a run gives no number.
    """

    table: str
    row: str
    column: str
    unit: str
    paper: float | None
    condition: str
    method: str
    measure: Measure
    bound: Callable[[Log, Vehicle], float] | None = None
    lost: str = "not finite"


@dataclass(frozen=True)
class Figure:
    """A picture as the paper draws it: one quantity over time, several methods, the truth.

    Attributes:
        name: for the file, such as ``fig-6a``.
        title: one line.
        condition: name of the drive.
        quantity: what is drawn.
        methods: names of the methods drawn.
        variant: which settings.
    """

    name: str
    title: str
    condition: str
    quantity: str
    methods: tuple[str, ...]
    variant: Variant = "as_printed"


@dataclass(frozen=True)
class Paper:
    """A paper: everything that ``roadstate papers`` needs to run it.

    Attributes:
        name: on the command line.
        title: authors, year and subject in one line.
        conditions, methods, cells, figures: see their classes.
        page: its page in the documentation, from the repository's root: ``docs/papers/NAME.md``.
    """

    name: str
    title: str
    conditions: tuple[Condition, ...]
    methods: dict[str, Method]
    cells: tuple[Cell, ...]
    figures: tuple[Figure, ...]
    page: str = field(default="")
