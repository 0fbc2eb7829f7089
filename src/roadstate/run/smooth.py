"""One estimator over one whole log, each sample in the light of all: for mapping, after the drive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core import Estimates, InputError, Log
from roadstate.core.gaussian import Gaussian
from roadstate.core.halves import two_kernels
from roadstate.core.kernel import one_kernel
from roadstate.core.numerics import jit_loop
from roadstate.core.packing import Layout
from roadstate.core.traced import returned
from roadstate.estimators import all_estimators
from roadstate.estimators.base import Estimate, Estimator, Sample, Smoothable
from roadstate.filters.base import FilterState, Moved
from roadstate.filters.smoother import Recorded, Recorder, look_back
from roadstate.run.chunk import Heard, Row, cut, heard, inputs, start, to_estimates

_CHUNK = 512
"""Samples whose states are held at once. Of the rest only one in so many is kept, and filtered anew from
there: so the memory grows with the larger of the two numbers, not with their product."""


@returned
class _Behind(NamedTuple):
    """What filtering leaves at a sample for going back.

    Attributes:
        moved: the step that led here.
        heard: what came of the samples.
    """

    moved: Moved
    heard: Heard


@returned
class _Ahead(NamedTuple):
    """What going back takes from the sample after.

    Attributes:
        mean, factor: its state given all samples.
        moved: the step that led there.
        exists: whether there is such a sample.
    """

    mean: Float[Array, " n"]
    factor: Float[Array, "n n"]
    moved: Moved
    exists: Bool[Array, ""]


def smoothable(estimator: Estimator[Any] | type[Estimator[Any]]) -> Smoothable:
    """By what an estimator is smoothed.

    Raises:
        InputError: by nothing; says which estimators can be.
    """
    if estimator.smoothable is None:
        able = ", ".join(name for name, e in all_estimators().items() if e.smoothable is not None)
        raise InputError(f"'{estimator.name}' cannot be smoothed", mend=f"these can be: {able}")
    return estimator.smoothable


def smooth(
    estimator: Estimator[Any], log: Log, *, progress: Callable[[int, int], None] | None = None
) -> Estimates:
    """Run an estimator over a whole log and then back, so that each sample knows of those after it.

    The backward pass (:func:`roadstate.filters.smoother.look_back`) starts from what the filter held after
    each sample: what its gates refused stays refused. Quantities that are not told of the smoothed filter,
    validity and innovations are the forward pass's; ``metadata["smoothed"]`` says which quantities are
    smoothed. A constant, as the mass, becomes at every sample what the whole log says of it.

    Args:
        estimator: built for the log's channels; a channel the log lacks counts as missing throughout.
        log: T samples.
        progress: called with (samples done, T) after every chunk, either way counting for one half.

    Returns:
        Estimates at each of the log's times.

    Raises:
        InputError: an estimator that cannot be smoothed, or what should be a log is none.
    """
    where = smoothable(estimator)
    samples, dt, own = inputs(estimator, log)
    total = len(samples)
    state, layout = start(estimator)
    begins = range(0, total, _CHUNK)

    def tell(chunks: int) -> None:
        if progress is not None:
            progress(min(chunks * _CHUNK, 2 * total) * len(log) // (2 * total), len(log))

    def forth(state: dict[str, Array], begin: int) -> tuple[dict[str, Array], dict[str, Array], _Behind]:
        return _forth(estimator, layout, state, *map(jnp.asarray, cut(samples, dt, begin, _CHUNK)))

    states = [state]
    for i, begin in enumerate(begins[:-1]):
        states.append(forth(states[-1], begin)[0])
        tell(i + 1)
    ahead: _Ahead | None = None
    parts: list[Any] = []
    for i in reversed(range(len(begins))):
        left = total - begins[i]
        _, passed, behind = forth(states.pop(), begins[i])
        exists = jnp.arange(_CHUNK) < left
        later = _beyond(behind) if ahead is None else ahead
        ahead, estimates = _back(estimator, layout, later, passed, behind.moved, exists)
        parts.append(jax.tree.map(lambda a, left=left: np.asarray(a)[:left], (behind.heard, estimates)))
        tell(2 * len(begins) - i)
    parts.reverse()
    every, estimates = jax.tree.map(lambda *a: np.concatenate(a)[own], *parts)
    whole = to_estimates(estimator, log, Row(estimates, every))
    names = [name for name in where.quantities if name in whole.values]
    return replace(whole, metadata={**whole.metadata, "smoothed": names})


def _recorded(
    estimator: Estimator[Any], state: Any, sample: Sample, dt: Float[Array, ""]
) -> tuple[Any, _Behind]:
    """One step, with what the filter made of it."""
    where = smoothable(estimator)
    recorder: Any = Recorder(getattr(estimator, where.filter))
    before: FilterState = getattr(state, where.state)
    state = state._replace(**{where.state: Recorded(before.gaussian, before.rejected, None)})
    state, info = replace(estimator, **{where.filter: recorder}).step(state, sample, dt)
    after: Recorded = getattr(state, where.state)
    plain = FilterState(after.gaussian, after.rejected)
    return state._replace(**{where.state: plain}), _Behind(cast(Moved, after.moved), heard(info))


def _go_forth(
    estimator: Estimator[Any],
    layout: Layout,
    packed: dict[str, Array],
    samples: Float[Array, "k c"],
    dt: Float[Array, " k"],
) -> tuple[dict[str, Array], dict[str, Array], _Behind]:
    """Filter a chunk.

    Returns:
        The packed state after it; that after each sample; what else going back takes.
    """
    told: Layout

    @two_kernels
    def step(estimator: Estimator[Any], packed: Any, values: Any, dt: Any) -> tuple[Any, Any]:
        nonlocal told
        sample = {c: values[i] for i, c in enumerate(estimator.channels)}
        state, behind = _recorded(estimator, layout.unpack(packed), sample, dt)
        told = Layout(behind)
        return layout.pack(state), told.pack(behind)

    def along(packed: Any, row: Any) -> tuple[Any, Any]:
        state, behind = step(estimator, packed, *row)
        return state, (state, behind)

    packed, (states, behind) = jax.lax.scan(along, packed, (samples, dt))
    return packed, states, told.unpack(behind)


def _go_back(
    estimator: Estimator[Any],
    layout: Layout,
    ahead: _Ahead,
    states: dict[str, Array],
    moved: Moved,
    exists: Bool[Array, " k"],
) -> tuple[_Ahead, Estimate]:
    """Over a chunk that was filtered.

    Returns:
        What the chunk before takes; the estimates.
    """
    where = smoothable(estimator)
    told: Layout

    @one_kernel
    def back(estimator: Estimator[Any], ahead: _Ahead, packed: Any, moved: Moved, real: Any) -> Any:
        nonlocal told
        state = layout.unpack(packed)
        held: FilterState = getattr(state, where.state)
        smoothed = jax.tree.map(
            lambda a, b: jnp.where(ahead.exists, a, b),
            look_back(held.gaussian, ahead.moved, Gaussian(ahead.mean, ahead.factor)),
            held.gaussian,
        )
        estimate = estimator.estimate(state._replace(**{where.state: held._replace(gaussian=smoothed)}))
        told = Layout(estimate)
        return _Ahead(smoothed.mean, smoothed.factor, moved, real), told.pack(estimate)

    rows = states, moved, exists
    ahead, packed = jax.lax.scan(lambda a, row: back(estimator, a, *row), ahead, rows, reverse=True)
    return ahead, told.unpack(packed)


_forth = jit_loop(_go_forth, whole=False, kept=True)
_back = jit_loop(_go_back, whole=False, kept=True)


def _beyond(last: _Behind) -> _Ahead:
    """In place of a sample after the last."""
    n = last.moved.mean.shape[1]
    none: Moved = jax.tree.map(lambda a: jnp.zeros(a.shape[1:], a.dtype), last.moved)
    return _Ahead(none.mean, jnp.zeros((n, n), none.mean.dtype), none, jnp.asarray(False))
