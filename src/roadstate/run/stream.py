"""One estimator, one sample at a time."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, cast

import equinox as eqx
import jax
import numpy as np

from roadstate.core import InputError
from roadstate.core.packing import Layout
from roadstate.estimators.base import Estimate, Estimator
from roadstate.run.chunk import advance, start


@partial(jax.jit, static_argnums=(0, 1))
def _step(static: Any, layout: Layout, params: Any, state: Any, sample: Any, dt: Any) -> tuple[Any, Estimate]:
    new, row = advance(eqx.combine(params, static), layout.unpack(state), sample, dt)
    return layout.pack(new), row.estimate


class Stream:
    """An estimator fed one sample at a time; gives the numbers that :func:`scan` gives on the same samples.

    Args:
        estimator: built for the channels that will come.
    """

    def __init__(self, estimator: Estimator[Any]) -> None:
        self._params, self._static = eqx.partition(estimator, eqx.is_array)
        self._channels = estimator.channels
        self.time: float | None = None
        """Time (s) of the last sample; ``None`` before the first."""
        self.state: dict[str, Any]
        """All the estimator remembers, one vector per dtype; with ``time`` it may be saved and put back."""
        self.state, self._layout = start(estimator)

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
        self.state, estimate = _step(self._static, self._layout, self._params, self.state, row, dt)
        self.time = time
        return cast(Estimate, estimate)
