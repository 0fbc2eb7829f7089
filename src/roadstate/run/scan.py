"""One estimator over one whole log."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from roadstate.core import Estimates, Log
from roadstate.core.numerics import jit_loop
from roadstate.estimators.base import Estimator
from roadstate.run.chunk import CHUNK, cut, inputs, scan_steps, start, to_estimates

_scan_chunk = jit_loop(scan_steps)


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
    samples, dt = inputs(estimator, log)
    state, layout = start(estimator)
    parts: list[dict[str, NDArray[Any]]] = []
    for begin in range(0, total, CHUNK):
        values, steps = (jnp.asarray(a) for a in cut(samples, dt, begin))
        state, rows, row_layout = _scan_chunk(estimator, layout, state, values, steps)
        parts.append({k: np.asarray(v)[: total - begin] for k, v in rows.items()})
        if progress is not None:
            progress(min(begin + CHUNK, total), total)
    whole = {k: np.concatenate([p[k] for p in parts]) for k in parts[0]}
    return to_estimates(estimator, log, row_layout.unpack(whole))
