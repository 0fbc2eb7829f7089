"""Maximum likelihood: Fisher scoring, what it finds, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from roadstate.calibration.likelihood import Curvature, Evaluation, Likelihood
from roadstate.calibration.parameters import Parameter, moved, select
from roadstate.calibration.uncertainty import (
    HARDLY,
    Mask,
    Numbers,
    covariance,
    dispersion,
    undetermined,
    unseen,
)
from roadstate.core import InputError, Log
from roadstate.estimators import all_estimators
from roadstate.vehicles import Vehicle

DEFAULT_ESTIMATOR = "joint"
SHORTEST = 30.0
"""Seconds that the logs have to last together."""
_MOST = 12  # evaluations of the likelihood without refusing anything
_NEAR = 0.02  # squared distance to the optimum, in standard deviations, that is near enough
_LONGEST = 2.0  # prior standard deviations of one step
_EDGE = 1e-6
# Figures of a section hang on these groups' as well. A car's bends tell its tires by how fast it turns in: a
# yaw inertia 7.5 % too large, or a mass too small, makes them 2.5 to 3.5 % stiffer. The force of a torque,
# and so the mass that it moves, is as exact as the radius at which it pushes.
_BESIDE: Mapping[str, tuple[str, ...]] = {"tires": ("inertia", "mass"), "mass": ("radius",)}
_FAR = 0.5  # prior standard deviations from where the curvature was taken, from which on it is taken anew
_DAMPING = (0.3, 8.0, 1e4)  # the first, its growth, and where to give up

Progress = Callable[[int, float], None]


@dataclass(frozen=True)
class Learned:
    """A figure after the fit.

    Attributes:
        parameter: which.
        value: the figure, in its own unit.
        std: its 1σ.
        relative: 1σ in the terms of its prior: a share where the logarithm was fitted, else ``std``.
    """

    parameter: Parameter
    value: float
    std: float
    relative: float


@dataclass(frozen=True)
class Calibration:
    """What a fit found.

    Attributes:
        vehicle: with the learned figures.
        estimator: whose likelihood it was.
        learned: figures that the data determine.
        refused: figure → why it stays as it was.
        logs: name → samples.
        uses_prior: a posteriori (with the file's own uncertainties) or of likelihood alone.
        evaluations: of the likelihood.
        converged: no step would gain any more.
        road_friction: that was taken for known.
    """

    vehicle: Vehicle
    estimator: str
    learned: tuple[Learned, ...]
    refused: Mapping[str, str]
    logs: Mapping[str, int]
    uses_prior: bool
    evaluations: int
    converged: bool
    road_friction: float | None = None


def calibrate(
    vehicle: Vehicle,
    logs: Mapping[str, Log],
    groups: Sequence[str] = (),
    *,
    tune: bool = False,
    estimator: str = DEFAULT_ESTIMATOR,
    use_prior: bool = True,
    road_friction: float | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Fit a car's figures to logs by the likelihood of an estimator's own filter.

    Args:
        vehicle: the car as its file has it.
        logs: name → log.
        groups: of :data:`roadstate.calibration.GROUPS`.
        tune: the noise levels as well.
        estimator: its name.
        use_prior: take the file's own uncertainties for a prior (maximum a posteriori).
        road_friction: peak friction of the road, the same in all logs, where it has been measured.
        progress: called after each evaluation with their number and the distance to the optimum, in standard
            deviations.

    Raises:
        InputError: nothing to learn or to learn it from, a channel that the estimator needs is missing, the
            estimator cannot be told of the road's friction, the filter fails, or the data determine none of
            the figures.
    """
    total = sum(log.duration for log in logs.values())
    if total < SHORTEST:
        raise InputError(
            f"{total:.10g} s are too short to learn from",
            where=", ".join(logs),
            mend=f"give logs of {SHORTEST:g} s at least",
        )
    if estimator not in all_estimators():
        raise InputError(
            f"no estimator is called '{estimator}'", mend=f"there are {', '.join(all_estimators())}"
        )
    selection = select(vehicle, groups, tune=tune)
    refused = dict(selection.refused)
    unused = Likelihood(vehicle, selection.parameters, logs, estimator, road_friction).unused()
    parameters = [p for p in selection.parameters if p.name not in unused]
    # nobody asked for one noise level or another by its name
    refused |= {p.name: unused[p.name] for p in selection.parameters if p.name in unused and not p.is_noise}
    if not parameters:
        raise _nothing(refused)
    likelihood = Likelihood(vehicle, parameters, logs, estimator, road_friction)
    start = likelihood.start()
    first = likelihood(start, np.ones(len(parameters), bool))
    hardly = unseen(first.information)
    refused |= {parameters[i].name: HARDLY for i in hardly}
    left = [i for i in range(len(parameters)) if i not in hardly]
    if not left:
        raise _nothing(refused)
    if hardly:
        likelihood = Likelihood(vehicle, [parameters[i] for i in left], logs, estimator, road_friction)
    fit = _Fit(likelihood, use_prior=use_prior, progress=progress)
    place = fit.run(start[left], first.curvature.of(left))
    refused |= {fit.parameters[i].name: why for i, why in fit.refused.items()}
    if place is None:
        raise _nothing(refused)
    return _result(fit, place, _spread(fit, place, logs), vehicle, logs, refused)


def _nothing(refused: Mapping[str, str]) -> InputError:
    reasons = "; ".join(f"{name} {why}" for name, why in refused.items())
    return InputError(f"nothing can be learned ({reasons})", mend="learn other groups, or give other logs")


@dataclass(frozen=True)
class _Place:
    """Where a fit stands.

    Attributes:
        free: (p,) changes in prior standard deviations.
        here: the likelihood there.
        J: (p, p) dispersion of its scores.
    """

    free: Numbers
    here: Evaluation
    J: Numbers

    def slope(self, active: Mask, prior: float) -> tuple[Numbers, Numbers]:
        """Gradient (a,) of the active parameters, and how it falls (a, a)."""
        gradient = (self.here.gradient - prior * self.free)[active]
        return gradient, self.here.information[np.ix_(active, active)] + prior * np.eye(active.sum())

    def distance(self, active: Mask, prior: float) -> float:
        """Squared distance to the optimum in its own standard deviations."""
        gradient, M = self.slope(active, prior)
        step = np.linalg.pinv(M) @ gradient
        spread = covariance(self.here.information, self.J, active, use_prior=prior > 0)
        return float(step @ np.linalg.pinv(spread) @ step)


class _Fit:
    """A fit at work: where it stands and what it has refused."""

    def __init__(self, likelihood: Likelihood, *, use_prior: bool, progress: Progress | None) -> None:
        self.likelihood, self._progress = likelihood, progress
        self.parameters, self.use_prior = likelihood.parameters, use_prior
        self.active: Mask = np.ones(len(self.parameters), bool)
        self.refused: dict[int, str] = {}
        self.evaluations = 0
        self.converged = False
        self._lower, self._upper = np.array([p.limits() for p in self.parameters]).T

    def run(self, start: Numbers, curvature: Curvature) -> _Place | None:
        """Fit, refuse, and fit again what is left; ``None`` where that is nothing.

        The prior takes part until it is settled what the data determine: without it, what they do not would
        run away and take the rest along.

        Args:
            start: (p,) where to begin.
            curvature: of :class:`Evaluation`, about there.
        """
        place = self._evaluate(start, curvature)
        found: dict[int, str] = {}
        while True:
            if found:
                self.refused |= found
                self.active[list(found)] = False
                if not self.active.any():
                    return None
                # the filter has been told that they are exact, which they are no longer
                place = self._evaluate(np.where(self.active, place.free, 0.0), place.here.curvature)
            place = self._climb(place, 1.0)
            found = self._at_edges(place.free) or self._undetermined(place)
            if not found:
                return place if self.use_prior else self._climb(place, 0.0)

    def _undetermined(self, place: _Place) -> dict[int, str]:
        return undetermined(place.here.information, place.J, self.parameters, self.active)

    def _at_edges(self, free: Numbers) -> dict[int, str]:
        found = {}
        for i in np.flatnonzero(self.active):
            if min(free[i] - self._lower[i], self._upper[i] - free[i]) < _EDGE:
                parameter = self.parameters[i]
                unit = "" if parameter.unit == "-" else f" {parameter.unit}"
                found[int(i)] = f"runs to the edge of what makes sense ({parameter.value(free[i]):g}{unit})"
        return found

    def _evaluate(self, free: Numbers, curvature: Curvature | None, prior: float = 1.0) -> _Place:
        here = self.likelihood(free, self.active, curvature)
        place = _Place(free, here, dispersion(here.scores, self.likelihood.times))
        self.evaluations += 1
        if self._progress is not None:
            self._progress(self.evaluations, place.distance(self.active, prior) ** 0.5)
        return place

    def _climb(self, place: _Place, prior: float) -> _Place:
        """Fisher scoring with Levenberg's damping, to where the optimum is as good as reached.

        Where a step has gone too far, the gradient falling faster than the information says, its direction is
        stiffened by a symmetric update of rank one (Nocedal & Wright, *Numerical Optimization*, 2nd ed.,
        § 6.2).
        """
        on, damping, most = self.active, 0.0, self.evaluations + _MOST
        stiffer = np.zeros((on.sum(), on.sum()))
        begin, self.converged = place, place.distance(on, prior) <= _NEAR
        while not self.converged and self.evaluations < most and damping < _DAMPING[2]:
            gradient, M = place.slope(on, prior)
            M = M + stiffer
            step = np.linalg.pinv(M + damping * np.diag(np.diag(M))) @ gradient
            step *= min(1.0, _LONGEST / np.abs(step).max())
            free = place.free.copy()
            free[on] = np.clip(free[on] + step, self._lower[on], self._upper[on])
            if np.array_equal(free, place.free):  # at an edge
                break
            there, gained = None, 0.0
            known: Curvature | None = place.here.curvature
            if np.abs(free - place.here.curvature.at).max() > _FAR:
                known = None
            try:
                there = self._evaluate(free, known, prior)
            except InputError:
                if damping > _DAMPING[1]:  # fails not only far out
                    raise
            else:
                way, ahead = (free - place.free)[on], there.slope(on, prior)[0]
                gained = float(way @ (gradient + ahead))
                more = gradient - ahead - M @ way
                if way @ ahead < 0 < more @ way:
                    stiffer = stiffer + np.outer(more, more) / (more @ way)
                else:
                    stiffer = np.zeros_like(stiffer)
            if there is not None and gained > 0:
                place, damping = there, 0.0
                self.converged = place.distance(on, prior) <= _NEAR
            else:
                damping = max(_DAMPING[1] * damping, _DAMPING[0])
        return place if place is begin else self._evaluate(place.free, None, prior)


def _spread(fit: _Fit, place: _Place, logs: Mapping[str, Log]) -> Numbers:
    """(a, a) covariance of what is learned, with the error of figures of the file that it hangs on."""
    own = fit.likelihood
    learned = {p.path[0] for p, is_active in zip(fit.parameters, fit.active, strict=True) if is_active}
    groups = [group for section, others in _BESIDE.items() if section in learned for group in others]
    found = select(own.vehicle, groups, tune=False).parameters if groups else ()
    names = {p.name for p in fit.parameters}
    slopes = [np.zeros((len(place.free), 0))]
    for parameter in (p for p in found if p.name not in names):
        less, more = (
            Likelihood(
                moved(own.vehicle, [parameter], np.full(1, change)),
                fit.parameters,
                logs,
                own.estimator,
                own.road_friction,
            )(place.free, fit.active, place.here.curvature).gradient
            for change in (-1.0, 1.0)
        )
        slopes.append(0.5 * (more - less)[:, None])
    beside = np.hstack(slopes)
    return covariance(place.here.information, place.J, fit.active, use_prior=fit.use_prior, beside=beside)


def _result(
    fit: _Fit,
    place: _Place,
    spread: Numbers,
    vehicle: Vehicle,
    logs: Mapping[str, Log],
    refused: Mapping[str, str],
) -> Calibration:
    on = fit.active
    std = np.zeros_like(place.free)
    std[on] = np.sqrt(np.diag(spread))
    learned = tuple(
        Learned(p, float(p.value(free)), float(p.value_std(free, own)), float(p.std * own))
        for p, free, own, is_active in zip(fit.parameters, place.free, std, on, strict=True)
        if is_active
    )
    return Calibration(
        vehicle=moved(vehicle, [one.parameter for one in learned], place.free[on]),
        estimator=fit.likelihood.estimator,
        learned=learned,
        refused=refused,
        logs={name: len(log) for name, log in logs.items()},
        uses_prior=fit.use_prior,
        evaluations=fit.evaluations,
        converged=fit.converged,
        road_friction=fit.likelihood.road_friction,
    )
