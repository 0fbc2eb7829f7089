"""What the papers on friction measure of a run: errors, convergence, chatter, and the bound on the error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from roadstate.core import WHEELS, Estimates, InputError, Log, reference
from roadstate.cramer_rao import cramer_rao_bound
from roadstate.estimators.friction import FrictionEstimator, normalized_tire
from roadstate.metrics import NORMAL_95
from roadstate.papers.base import Build, Measure
from roadstate.run.chunk import cut, inputs
from roadstate.sim.plant.base import Plant
from roadstate.sim.plant.planar import PlanarPlant
from roadstate.vehicles import Vehicle

Numbers = NDArray[np.float64]
Start = Callable[[Log], float]
"""When, in s of the log's time, what is measured begins."""
NEVER = "not within the tolerance for half a second"
"""What it means that a :func:`convergence_time` is not a number."""
_TURNED = 0.2  # of its largest angle: then steering has begun
_LASTING = 0.5  # s for which an error must stay small
_PADDED = 2048  # samples: logs are filled up to a multiple of it
_MEAN_OF_NORMAL = float(np.sqrt(2 / np.pi))  # E|e|/σ


def flat_car(vehicle: Vehicle) -> Plant:
    """The papers' own plant: seven degrees of freedom on normalised Dugoff tires, a body without springs."""
    return PlanarPlant.seven_dof(vehicle, tire=normalized_tire(vehicle))


def steering_begins(log: Log) -> float:
    """When steering exceeds a fifth of its largest angle."""
    angle = np.abs(log["steer" if "steer" in log.available else "steering_wheel"])
    return float(log.time[int(np.argmax(angle > _TURNED * np.nanmax(angle)))])


def at(time: float) -> Start:
    """A fixed time, s."""
    return lambda log: time


def new_surface(log: Log) -> float:
    """When the first wheel leaves the first surface of a joint road."""
    every = np.stack([log[f"ref_friction_{w}"] for w in WHEELS])
    return float(log.time[int(np.argmax(np.any(np.abs(every - every[:, :1]) > 1e-3, axis=0)))])


def relative_error(estimates: Estimates, log: Log, quantity: str) -> Numbers:
    """(T,) error over truth."""
    truth = reference(quantity, log.channels)
    if truth is None or quantity not in estimates.values:
        return np.full(len(log), np.nan)
    error: Numbers = estimates.values[quantity] / truth - 1
    return error


def mean_error(start: Start, after: float, quantity: str = "friction_peak") -> Measure:
    """Mean size of the error, % of the truth, from ``after`` s past the start on."""

    def measure(estimates: Estimates, log: Log) -> float:
        used = log.time >= start(log) + after
        return float(100 * np.mean(np.abs(relative_error(estimates, log, quantity)[used])))

    return measure


def final_error(duration: float, quantity: str = "friction_peak") -> Measure:
    """Size of the mean error over the last ``duration`` s, % of the truth."""

    def measure(estimates: Estimates, log: Log) -> float:
        used = log.time >= log.time[-1] - duration
        return float(100 * np.abs(np.mean(relative_error(estimates, log, quantity)[used])))

    return measure


def convergence_time(start: Start, tolerance: float, quantity: str = "friction_peak") -> Measure:
    """s from the start until the error is within ``tolerance`` (share of the truth) and stays there for half
    a second; not a number where it never is.
    """

    def measure(estimates: Estimates, log: Log) -> float:
        begin = start(log)
        inside = np.abs(relative_error(estimates, log, quantity)) <= tolerance
        outside = np.append(log.time[~inside], np.inf)
        late = np.flatnonzero(inside & (log.time >= begin) & (log.time + _LASTING <= log.time[-1]))
        for k in late:
            if outside[np.searchsorted(outside, log.time[k])] > log.time[k] + _LASTING:
                return float(log.time[k] - begin)
        return float("nan")

    return measure


def chatter(start: Start, after: float, quantity: str = "friction_peak") -> Measure:
    """Total variation of the estimate per second, from ``after`` s past the start on, 1/s."""

    def measure(estimates: Estimates, log: Log) -> float:
        used = log.time >= start(log) + after
        if quantity not in estimates.values:
            return float("nan")
        values = estimates.values[quantity][used]
        return float(np.sum(np.abs(np.diff(values))) / (log.time[used][-1] - log.time[used][0]))

    return measure


def coverage(start: Start, after: float, quantity: str = "friction_peak") -> Measure:
    """Share of samples (%) that the 95 % interval misses, from ``after`` s past the start on."""

    def measure(estimates: Estimates, log: Log) -> float:
        truth = reference(quantity, log.channels)
        if truth is None or quantity not in estimates.values:
            return float("nan")
        used = log.time >= start(log) + after
        away = np.abs(estimates.values[quantity] - truth)[used] / estimates.std[quantity][used]
        return float(100 * np.mean(away > NORMAL_95))

    return measure


def error_bound(
    build: Build, start: Start, after: float, quantity: str = "friction_peak"
) -> Callable[[Log, Vehicle], float]:
    """The mean size of the error, % of the truth, that the Cramér–Rao bound allows the estimator's own model.

    Args:
        build: a friction estimator; its noises and its tire count as the truth.
        start, after: as of :func:`mean_error`.
        quantity: which friction.
    """

    def bound(log: Log, vehicle: Vehicle) -> float:
        estimator = build(vehicle, log.available)
        assert isinstance(estimator, FrictionEstimator)
        if quantity not in dict(estimator.groups):
            raise InputError(f"'{estimator.name}' gives no {quantity} from these channels")
        std, truth = least_std(estimator, log, quantity), reference(quantity, log.channels)
        assert truth is not None
        used = log.time >= start(log) + after
        return float(100 * _MEAN_OF_NORMAL * np.mean((std / truth)[used]))

    return bound


def least_std(estimator: FrictionEstimator, log: Log, quantity: str = "friction_peak") -> Numbers:
    """(T,) the Cramér–Rao bound on the standard deviation of a friction, along a log.

    Raises:
        InputError: a log with breaks.
    """
    # logs of all lengths padded alike, so that they share compiled programs
    rows = -(-len(log) // _PADDED) * _PADDED
    samples, dt, own = inputs(estimator, log)
    if len(samples) > len(own):
        raise InputError("a log with breaks", mend="cut it at them")
    table, dt = cut(samples, dt, 0, rows)
    model = estimator.model
    wheels = np.stack([log[f"ref_friction_{w}"] for w in WHEELS], axis=1)
    states = np.zeros((len(log), len(model.states)))
    for row in range(model.groups):
        states[:, row] = wheels[:, [i for i, g in enumerate(model.of_wheel) if g == row]].mean(axis=1)
    if "yaw_rate" in model.states:
        states[:, -1] = log["yaw_rate"]
    states = np.pad(states, ((0, rows - len(log)), (0, 0)), mode="edge")
    u, present = _told(estimator, jnp.asarray(table), jnp.asarray(dt))
    bound = cramer_rao_bound(model, jnp.asarray(states), u, jnp.asarray(dt), present=present)
    factor = bound.factor[: len(log)]
    weights = estimator.weights(quantity, factor[0, 0])
    spread: Numbers = np.asarray(jnp.sqrt(jnp.sum((weights @ factor) ** 2, axis=-1)))
    return spread


@eqx.filter_jit
def _told(estimator: FrictionEstimator, table: Array, dt: Array) -> Any:
    """The model's inputs, and which measurements are there, along a log."""

    def body(state: Any, row: Any) -> tuple[Any, Any]:
        values, step = row
        sample = dict(zip(estimator.channels, values, strict=True))
        told = estimator.told(state, sample, step)
        return estimator.step(state, sample, step)[0], (told.u, jnp.isfinite(told.z))

    return jax.lax.scan(body, estimator.init(), (table, dt))[1]
