"""What a driver is to do over time: a speed to hold, or pedals and a steering wheel moved as written."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from roadstate.core import InputError
from roadstate.core import numerics as numerics  # float64 before the first array
from roadstate.sim.plant.base import AUTOMATIC
from roadstate.sim.speed_plan import SpeedPlan

Times = NDArray[np.floating[Any]]
Signal = Callable[[Times], Any] | float
STEP = 0.01
"""Time between the rows, s."""
CLOSED, OPEN, HELD = 0.0, 1.0, 2.0
"""Who moves the pedals or the steering wheel: the driver, the script, nobody any more."""
_LONGEST = 7200.0  # s


class Cue(NamedTuple):
    """One instant of a script; scalars.

    Attributes:
        speed, accel: planned speed (m/s) and its derivative (m/s²).
        steering_wheel: rad, where the script steers.
        throttle, brake: 0 to 1, where the script has the pedals.
        gear: as :class:`roadstate.sim.plant.base.Controls`.
        steering, pedals: ``CLOSED``, ``OPEN`` or ``HELD`` (as it was).
    """

    speed: Any
    accel: Any
    steering_wheel: Any
    throttle: Any
    brake: Any
    gear: Any
    steering: Any
    pedals: Any


class Script(eqx.Module):
    """A :class:`Cue` every 10 ms; what is continuous is linear between them.

    Attributes:
        table: (T, 8) in the order of :class:`Cue`.
    """

    table: Float[Array, "T 8"]

    @property
    def duration(self) -> float:
        """From first to last row, s."""
        return (self.table.shape[0] - 1) * STEP

    def at(self, t: Any) -> Cue:
        """The cue at a time (scalar), s; the last one after the end."""
        rows = self.table.shape[0]
        place = jnp.clip(jnp.asarray(t) / STEP, 0, rows - 1)
        i = jnp.clip(jnp.floor(place + 1e-6), 0, rows - 1).astype(jnp.int32)
        before, after = self.table[i], self.table[jnp.minimum(i + 1, rows - 1)]
        u = jnp.clip(place - i, 0, 1)
        row = jnp.where(jnp.arange(8) < 5, before + u * (after - before), before)
        return Cue(*(row[k] for k in range(8)))

    @classmethod
    def write(
        cls,
        plan: SpeedPlan,
        *,
        steering_wheel: Signal | None = None,
        throttle: Signal = 0.0,
        brake: Signal = 0.0,
        gear: Signal = float(AUTOMATIC),
        steer_from: float = 0.0,
        pedals_from: float | None = None,
        hold_pedals_from: float | None = None,
    ) -> Script:
        """A script from signals, numbers or functions of times (T,) in s.

        Args:
            plan: speeds to hold while the driver has the pedals; its duration is the script's.
            steering_wheel: rad; the driver steers where there is none.
            throttle, brake: 0 to 1.
            gear: as the plant takes it.
            steer_from: when the script takes the steering wheel, s.
            pedals_from: when the script takes the pedals, s; never where ``None``.
            hold_pedals_from: when they are kept as they are, s.

        Raises:
            InputError: over two hours, or a signal that is not finite.
        """
        if plan.duration > _LONGEST:
            raise InputError(f"a manoeuvre of {plan.duration:g} s", mend=f"the longest is {_LONGEST:g} s")
        t = np.arange(round(plan.duration / STEP) + 1) * STEP
        columns = np.zeros((8, len(t)))
        columns[0], columns[1] = plan.at(t)
        steered = 0.0 if steering_wheel is None else steering_wheel
        for row, signal in zip((2, 3, 4, 5), (steered, throttle, brake, gear), strict=True):
            columns[row] = signal(t) if callable(signal) else signal
        if steering_wheel is not None:
            columns[6] = np.where(t >= steer_from - 1e-9, OPEN, CLOSED)
        if pedals_from is not None:
            columns[7] = np.where(t >= pedals_from - 1e-9, OPEN, CLOSED)
        if hold_pedals_from is not None:
            columns[7] = np.where(t >= hold_pedals_from - 1e-9, HELD, columns[7])
        if not np.isfinite(columns).all():
            raise InputError("a script with a signal that is not finite")
        return cls(jnp.asarray(columns.T))
