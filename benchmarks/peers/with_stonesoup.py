"""Stone Soup: its predictors and updaters, called for each sample."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from benchmarks.peers.problems import Array, Problem
from benchmarks.peers.program import Program
from benchmarks.peers.reference import Run, linear_system
from stonesoup.base import Property
from stonesoup.models.base import GaussianModel, LinearModel
from stonesoup.models.control.linear import LinearControlModel
from stonesoup.models.measurement.base import MeasurementModel
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.base import TransitionModel
from stonesoup.predictor.kalman import KalmanPredictor, UnscentedKalmanPredictor
from stonesoup.predictor.particle import ParticlePredictor
from stonesoup.resampler.particle import SystematicResampler
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState, ParticleState, State
from stonesoup.updater.kalman import KalmanUpdater, UnscentedKalmanUpdater
from stonesoup.updater.particle import ParticleUpdater

_BEGIN = datetime(2000, 1, 1)
_POINTS = {"alpha": 1.0, "beta": 2.0, "kappa": 0.0}


def _noisy(model: Any, values: Array, noise: Any, kwargs: Any) -> Any:
    """A model's values as the library's vectors, with noise where it asks for it."""
    if noise is True:
        values = values + model.rvs(num_samples=values.shape[1], **kwargs)
    return values.view(StateVectors if values.shape[1] > 1 else StateVector)


class Transition(TransitionModel, GaussianModel):  # type: ignore[misc]
    """f of a problem; ``u`` is set before each step."""

    problem: Problem = Property()
    u: Any = None

    @property
    def ndim_state(self) -> int:
        """Number of states."""
        return len(self.problem.q)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        """The states one step later, for all points at once."""
        x = np.asarray(state.state_vector)
        return _noisy(self, self.problem.f(np, x, self.u, self.problem.dt), noise, kwargs)

    def covar(self, **kwargs: Any) -> Any:
        """Q."""
        return np.diag(self.problem.q**2)


class LinearTransition(TransitionModel, LinearModel, GaussianModel):  # type: ignore[misc]
    """F and Q."""

    F: Any = Property()
    Q: Any = Property()

    @property
    def ndim_state(self) -> int:
        """Number of states."""
        return len(self.F)

    def matrix(self, **kwargs: Any) -> Any:
        """F."""
        return self.F

    def covar(self, **kwargs: Any) -> Any:
        """Q."""
        return self.Q


class Sensors(MeasurementModel, GaussianModel):  # type: ignore[misc]
    """h of a problem; ``u`` is set before each step."""

    problem: Problem = Property()
    u: Any = None

    @property
    def ndim_meas(self) -> int:
        """Number of sensors."""
        return len(self.problem.r)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        """What the sensors read, for all points at once."""
        x = np.asarray(state.state_vector)
        return _noisy(self, self.problem.h(np, x, self.u), noise, kwargs)

    def covar(self, **kwargs: Any) -> Any:
        """R."""
        return np.diag(self.problem.r**2)


def program(problem: Problem) -> Program:
    """Its predict and update, called for each sample."""
    run: Callable[[Problem], Run] = _particle if problem.method == "pf" else _gaussian
    return Program(lambda: run(problem), lambda out: out[0], problem.steps)


def _gaussian(problem: Problem) -> Run:
    n, m = len(problem.q), len(problem.r)
    if problem.method == "kf":
        F, B, H = linear_system(problem)
        transition: Any = LinearTransition(F=F, Q=np.diag(problem.q**2))
        sensors: Any = LinearGaussian(n, _mapping(H), np.diag(problem.r**2))
        predictor: Any = KalmanPredictor(transition, LinearControlModel(B))
        updater: Any = KalmanUpdater(sensors)
    else:
        transition = Transition(problem=problem)
        sensors = Sensors(ndim_state=n, mapping=tuple(range(m)), problem=problem)
        predictor = UnscentedKalmanPredictor(transition, **_POINTS)
        updater = UnscentedKalmanUpdater(sensors, **_POINTS)
    state: Any = GaussianState(StateVector(problem.mean), np.diag(problem.std**2), timestamp=_BEGIN)
    means, stds = np.empty((2, problem.steps, n))
    for t, (u, z) in enumerate(zip(problem.inputs, problem.samples, strict=True)):
        now = _BEGIN + timedelta(seconds=(t + 1) * problem.dt)
        transition.u = sensors.u = u[:, None]
        control = {"control_input": State(StateVector(u))} if problem.method == "kf" else {}
        ahead = predictor.predict(state, timestamp=now, **control)
        state = updater.update(SingleHypothesis(ahead, Detection(StateVector(z), now, sensors)))
        means[t], stds[t] = np.ravel(state.mean), np.sqrt(np.diag(state.covar))
    return means, stds


def _mapping(H: Array) -> tuple[int, ...]:
    """Which state each sensor reads, for the library's linear sensors.

    Raises:
        ValueError: a sensor reads anything but one state.
    """
    if not (np.isin(H, [0.0, 1.0]).all() and (H.sum(axis=1) == 1).all()):
        raise ValueError("every sensor has to read one state")
    return tuple(int(i) for i in np.argmax(H, axis=1))


def _particle(problem: Problem) -> Run:
    n, count = len(problem.q), problem.particles
    transition = Transition(problem=problem, seed=0)
    sensors = Sensors(ndim_state=n, mapping=tuple(range(len(problem.r))), problem=problem)
    predictor, updater, resampler = (
        ParticlePredictor(transition),
        ParticleUpdater(sensors),
        SystematicResampler(),
    )
    cloud = problem.mean[:, None] + problem.std[:, None] * np.random.default_rng(0).standard_normal(
        (n, count)
    )
    state: Any = ParticleState(StateVectors(cloud), weight=np.full(count, 1 / count), timestamp=_BEGIN)
    means, stds = np.empty((2, problem.steps, n))
    for t, (u, z) in enumerate(zip(problem.inputs, problem.samples, strict=True)):
        now = _BEGIN + timedelta(seconds=(t + 1) * problem.dt)
        transition.u = sensors.u = u[:, None]
        ahead = predictor.predict(state, timestamp=now)
        state = updater.update(SingleHypothesis(ahead, Detection(StateVector(z), now, sensors)))
        share, points = np.exp(state.log_weight), np.asarray(state.state_vector)
        means[t] = points @ share
        stds[t] = np.sqrt((points - means[t][:, None]) ** 2 @ share)
        state = resampler.resample(state)
    return means, stds
