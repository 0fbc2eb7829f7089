"""One estimator over one whole log."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from roadstate.core import Estimates, Log
from roadstate.estimators.base import Estimator
from roadstate.run.chunk import CHUNK, Row, cut, inputs, kept, start, steps_through, to_estimates


def scan(
    estimator: Estimator[Any],
    log: Log,
    *,
    progress: Callable[[int, int], None] | None = None,
    among: int | None = None,
) -> Estimates:
    """Run an estimator over a whole log.

    Args:
        estimator: built for the log's channels; a channel the log lacks counts as missing throughout.
        log: T samples.
        progress: called with (samples done, T) after every chunk.
        among: samples of all the logs that this estimator goes through, if there are more than this one.
            Where there are many, it pays to compile a faster program (:data:`roadstate.run.chunk.SHORT`).

    Returns:
        Estimates at each of the log's times.

    Raises:
        InputError: what should be a log is none.
    """
    samples, dt, own = inputs(estimator, log)
    total = len(samples)
    state, layout = start(estimator)
    through = steps_through(among or total)
    parts: list[Row] = []
    for begin in range(0, total, CHUNK):
        values, steps = (jnp.asarray(a) for a in cut(samples, dt, begin))
        count = min(CHUNK, total - begin)
        state, rows = through(estimator, layout, state, values, steps, jnp.asarray(count), kept)
        parts.append(jax.tree.map(lambda leaf, count=count: np.asarray(leaf)[:count], rows))
        if progress is not None:
            progress(int(np.searchsorted(own, min(begin + CHUNK, total))), len(log))
    return to_estimates(estimator, log, jax.tree.map(lambda *leaves: np.concatenate(leaves)[own], *parts))
