"""Of which samples a run keeps the normalised innovation squared."""

from __future__ import annotations

import jax.numpy as jnp
import pytest

from roadstate.core.gaussian import Gate, Info, Reason
from roadstate.run.chunk import heard


@pytest.mark.parametrize(
    ("innovation", "gate", "reason", "is_kept"),
    [
        (1.5, Gate.PASSED, Reason.OK, True),
        (1.5, Gate.PASSED, Reason.MEMORY_KEPT, True),  # the step has something to say, and has used it
        (1.5, Gate.NOT_TESTED, Reason.PROJECTED, True),
        (1.5, Gate.REJECTED, Reason.NO_MEASUREMENT, False),
        (jnp.nan, Gate.NOT_TESTED, Reason.NO_MEASUREMENT, False),
        (1.5, Gate.PASSED, Reason.NOT_FINITE, False),
    ],
)
def test_it_is_kept_where_a_sample_was_used(
    innovation: float, gate: Gate, reason: Reason, is_kept: bool
) -> None:
    info = Info(
        innovation=jnp.asarray([innovation]),
        S=jnp.eye(1),
        nis=jnp.asarray(2.25),
        log_likelihood=jnp.zeros(()),
        gate=jnp.asarray([int(gate)]),
        ok=jnp.asarray(reason != Reason.NOT_FINITE),
        reason=jnp.asarray(int(reason)),
    )
    assert bool(jnp.isfinite(heard(info).nis)) == is_kept
