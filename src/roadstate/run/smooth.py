"""One estimator over one whole log, each sample in the light of all: for mapping, after the drive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from roadstate.core import Estimates, InputError, Log
from roadstate.core.gaussian import Gaussian
from roadstate.core.kernel import one_kernel
from roadstate.core.numerics import jit_loop
from roadstate.core.packing import Layout
from roadstate.estimators import all_estimators
from roadstate.estimators.base import Estimator, Smoothable
from roadstate.filters.base import FilterState, Moved
from roadstate.filters.smoother import Recorded, Recorder, look_back
from roadstate.run.chunk import Row, advance, cut, inputs, start, steps_through, to_estimates

_CHUNK = 512
"""Samples whose states are held at once. Of the rest only one in so many is kept, and filtered anew from
there: so the memory grows with the larger of the two numbers, not with their product."""


class _Ahead(NamedTuple):
    """What going back takes from the sample after.

    Attributes:
        gaussian: its state given all samples.
        moved: the step that led there.
        exists: whether there is such a sample.
    """

    gaussian: Gaussian
    moved: Moved
    exists: Bool[Array, ""]


class _Behind(NamedTuple):
    """What filtering leaves at a sample for going back.

    Attributes:
        state: the estimator's.
        row: what the filter told, without an estimate.
        moved: the step that led here.
    """

    state: Any
    row: Row
    moved: Moved


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

    chunks = [cut(samples, dt, begin, _CHUNK) for begin in begins]
    forth = steps_through(total)
    states = [state]
    for i, chunk in enumerate(chunks[:-1]):
        values, steps = map(jnp.asarray, chunk)
        state_after, _ = forth(estimator, layout, states[-1], values, steps, jnp.asarray(_CHUNK), _nothing)
        states.append(state_after)
        tell(i + 1)
    ahead = _beyond(estimator, layout, state)
    parts: list[Any] = []
    for i in reversed(range(len(begins))):
        left = total - begins[i]
        exists = jnp.arange(_CHUNK) < left
        values, steps = map(jnp.asarray, chunks[i])
        ahead, told, layouts = _back(estimator, layout, states.pop(), ahead, values, steps, exists)
        kept = [{k: np.asarray(v)[:left] for k, v in packed.items()} for packed in told]
        parts.append([form.unpack(packed) for form, packed in zip(layouts, kept, strict=True)])
        tell(2 * len(begins) - i)
    parts.reverse()
    rows, estimates = jax.tree.map(lambda *a: np.concatenate(a)[own], *parts)
    whole = to_estimates(estimator, log, rows._replace(estimate=estimates))
    names = [name for name in where.quantities if name in whole.values]
    return replace(whole, metadata={**whole.metadata, "smoothed": names})


def _recorded(estimator: Estimator[Any], state: Any, sample: Any, dt: Any) -> _Behind:
    """One step, with what the filter made of it."""
    where = smoothable(estimator)
    recorder: Any = Recorder(getattr(estimator, where.filter))
    before: FilterState = getattr(state, where.state)
    state = state._replace(**{where.state: Recorded(before.gaussian, before.rejected, None)})
    state, row = advance(replace(estimator, **{where.filter: recorder}), state, sample, dt)
    after: Recorded = getattr(state, where.state)
    plain = FilterState(after.gaussian, after.rejected)
    untold: Any = None
    return _Behind(
        state._replace(**{where.state: plain}), row._replace(estimate=untold), cast(Moved, after.moved)
    )


def _samples(estimator: Estimator[Any], values: Float[Array, " c"]) -> dict[str, Float[Array, ""]]:
    return {c: values[i] for i, c in enumerate(estimator.channels)}


def _nothing(estimator: Estimator[Any], state: Any, info: Any) -> None:
    """What the way forth keeps of a step: its state after a chunk is all."""


def _smooth_chunk(
    estimator: Estimator[Any],
    layout: Layout,
    state: Any,
    ahead: _Ahead,
    samples: Float[Array, "k c"],
    dt: Float[Array, " k"],
    exists: Bool[Array, " k"],
) -> tuple[_Ahead, tuple[Any, Any], tuple[Layout, Layout]]:
    """Filter a chunk and go back over it.

    Returns:
        What the chunk before takes; rows and estimates, packed; how these unpack.
    """
    where = smoothable(estimator)
    layouts: dict[str, Layout] = {}

    @one_kernel
    def forth(estimator: Estimator[Any], packed: Any, values: Any, step: Any) -> tuple[Any, Any]:
        behind = _recorded(estimator, layout.unpack(packed), _samples(estimator, values), step)
        layouts["behind"], layouts["row"] = Layout(behind), Layout(behind.row)
        return layout.pack(behind.state), layouts["behind"].pack(behind)

    @one_kernel
    def back(estimator: Estimator[Any], ahead: _Ahead, packed: Any, real: Any) -> tuple[_Ahead, Any]:
        state, told, moved = layouts["behind"].unpack(packed)
        held = getattr(state, where.state)
        smoothed = jax.tree.map(
            lambda a, b: jnp.where(ahead.exists, a, b),
            look_back(held.gaussian, ahead.moved, ahead.gaussian),
            held.gaussian,
        )
        state = state._replace(**{where.state: held._replace(gaussian=smoothed)})
        estimate = estimator.estimate(state)
        layouts["estimate"] = Layout(estimate)
        out = layouts["row"].pack(told), layouts["estimate"].pack(estimate)
        return _Ahead(smoothed, moved, real), out

    _, left = jax.lax.scan(lambda s, row: forth(estimator, s, *row), state, (samples, dt))
    ahead, told = jax.lax.scan(lambda a, row: back(estimator, a, *row), ahead, (left, exists), reverse=True)
    return ahead, told, (layouts["row"], layouts["estimate"])


@eqx.filter_jit
def _beyond(estimator: Estimator[Any], layout: Layout, state: Any) -> _Ahead:
    """In place of a sample after the last. Compiled, for what it costs is to trace a step, once."""
    where = smoothable(estimator)

    def shapes(packed: Any) -> _Ahead:
        before = layout.unpack(packed)
        missing = _samples(estimator, jnp.full(len(estimator.channels), jnp.nan))
        after = _recorded(estimator, before, missing, jnp.zeros(()))
        return _Ahead(getattr(before, where.state).gaussian, after.moved, jnp.asarray(False))

    empty: _Ahead = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), jax.eval_shape(shapes, state))
    return empty


_back = jit_loop(_smooth_chunk, whole=False)
