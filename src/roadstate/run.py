"""Running an estimator: over a log (:func:`scan`) or sample by sample (:class:`Stream`), with one step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import NDArray

from roadstate import __version__
from roadstate.core import Estimates, InputError, Log
from roadstate.core.packing import Layout
from roadstate.estimators.base import Estimate, Estimator

CHUNK = 8192
"""Samples a compiled scan takes at once: any log runs through this one program, padded at its end."""


class _Row(NamedTuple):
    """What one step leaves behind."""

    estimate: Estimate
    innovation: Float[Array, " m"]
    innovation_std: Float[Array, " m"]
    nis: Float[Array, ""]
    gate: Int[Array, " m"]


def _advance(estimator: Estimator[Any], state: Any, sample: Mapping[str, Any], dt: Any) -> tuple[Any, _Row]:
    state, info = estimator.step(state, sample, dt)
    nis = jnp.where(jnp.any(jnp.isfinite(info.innovation)), info.nis, jnp.nan)
    spread = jnp.sqrt(jnp.diagonal(info.S))
    return state, _Row(estimator.estimate(state), info.innovation, spread, nis, info.gate)


@eqx.filter_jit
def _scan_chunk(
    estimator: Estimator[Any],
    layout: Layout,
    state: Any,
    samples: Float[Array, "k c"],
    dt: Float[Array, " k"],
) -> tuple[Any, Any]:
    """Scan over a chunk, state packed: a loop's cost is in the number of arrays it carries and emits."""

    def body(packed: Any, row: Any) -> tuple[Any, Any]:
        values, step = row
        sample = {c: values[i] for i, c in enumerate(estimator.channels)}
        new, out = _advance(estimator, layout.unpack(packed), sample, step)
        return layout.pack(new), Layout(out).pack(out)

    return jax.lax.scan(body, state, (samples, dt))


def scan(
    estimator: Estimator[Any], log: Log, *, progress: Callable[[int, int], None] | None = None
) -> Estimates:
    """Run an estimator over a whole log.

    Args:
        estimator: built for the log's channels; a channel the log lacks counts as missing throughout.
        log: T samples.
        progress: called with (samples done, T) after every chunk.

    Returns:
        Estimates at each of the log's times.
    """
    total = len(log)
    missing = np.full(total, np.nan)
    samples = np.stack([log.channels.get(c, missing) for c in estimator.channels], axis=1)
    dt = np.diff(log.time, prepend=log.time[0])
    start_state = estimator.init()
    layout = Layout(start_state)
    state = layout.pack(start_state)
    sample = {c: jnp.zeros(()) for c in estimator.channels}
    row_layout = Layout(eqx.filter_eval_shape(_advance, estimator, start_state, sample, jnp.zeros(()))[1])
    parts: list[dict[str, NDArray[Any]]] = []
    for start in range(0, total, CHUNK):
        stop = min(start + CHUNK, total)
        pad = CHUNK - (stop - start)
        chunk = np.pad(samples[start:stop], ((0, pad), (0, 0)), constant_values=np.nan)
        steps = np.pad(dt[start:stop], (0, pad))
        state, rows = _scan_chunk(estimator, layout, state, jnp.asarray(chunk), jnp.asarray(steps))
        parts.append({k: np.asarray(v)[: stop - start] for k, v in rows.items()})
        if progress is not None:
            progress(stop, total)
    whole = {k: np.concatenate([p[k] for p in parts]) for k in parts[0]}
    return _to_estimates(estimator, log, row_layout.unpack(whole))


def _to_estimates(estimator: Estimator[Any], log: Log, rows: _Row) -> Estimates:
    def host(tree: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
        return {k: np.asarray(v, dtype=np.float64) for k, v in tree.items()}

    metadata = {
        "estimator": estimator.name,
        "roadstate": __version__,
        "jax": jax.__version__,
        "rejected": {
            s: int((np.asarray(rows.gate)[:, i] == 2).sum()) for i, s in enumerate(estimator.sensors)
        },
        "log": dict(log.metadata),
    }
    return Estimates(
        time=log.time,
        values=host(rows.estimate.values),
        std=host(rows.estimate.std),
        validity=np.asarray(rows.estimate.validity, dtype=np.int8),
        sensors=tuple(estimator.sensors),
        innovation=np.asarray(rows.innovation, dtype=np.float64),
        innovation_std=np.asarray(rows.innovation_std, dtype=np.float64),
        nis=np.asarray(rows.nis, dtype=np.float64),
        metadata=metadata,
    )


@partial(jax.jit, static_argnums=(0, 1))
def _stream_step(
    static: Any, layout: Layout, params: Any, state: Any, sample: Any, dt: Any
) -> tuple[Any, Estimate]:
    new, row = _advance(eqx.combine(params, static), layout.unpack(state), sample, dt)
    return layout.pack(new), row.estimate


class Stream:
    """An estimator fed one sample at a time; gives the numbers that :func:`scan` gives on the same samples.

    Args:
        estimator: built for the channels that will come.
    """

    def __init__(self, estimator: Estimator[Any]) -> None:
        self._params, self._static = eqx.partition(estimator, eqx.is_array)
        self._channels = estimator.channels
        start = estimator.init()
        self._layout = Layout(start)
        self.time: float | None = None
        """Time (s) of the last sample; ``None`` before the first."""
        self.state: dict[str, Any] = self._layout.pack(start)
        """All the estimator remembers, one vector per dtype; with ``time`` it may be saved and put back."""

    def push(self, time: float, sample: Mapping[str, float]) -> Estimate:
        """Take one sample.

        Args:
            time: in s, later than the one before.
            sample: canonical channel → value in SI; what is absent or NaN is missing.

        Raises:
            InputError: time does not increase.
        """
        if not np.isfinite(time) or (self.time is not None and time <= self.time):
            raise InputError(
                f"sample at {time} s does not come after {self.time} s", mend="push in time order"
            )
        dt = 0.0 if self.time is None else float(time - self.time)
        row = {c: float(sample.get(c, np.nan)) for c in self._channels}
        result = _stream_step(self._static, self._layout, self._params, self.state, row, dt)
        self.state, estimate = result
        self.time = time
        return cast(Estimate, estimate)
