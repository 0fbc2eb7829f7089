"""Every estimator's scan is one kernel, or each of its steps is: nothing in it calls a library."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import numpy as np
import pytest

from contracts.plausible import plausible_log
from roadstate.core import CHANNELS
from roadstate.core.kernel import one_kernel
from roadstate.estimators import all_estimators, build
from roadstate.run import chunk, scan
from roadstate.run.chunk import inputs, kept, scan_steps, start
from roadstate.vehicles import load_vehicle

MEASURED = [n for n, c in CHANNELS.items() if not c.is_reference and n != "time"]


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="kernels are joined on a CPU only")
@pytest.mark.parametrize("name", all_estimators())
def test_a_scan_is_one_kernel(name: str) -> None:
    vehicle = load_vehicle("family-car")
    estimator = build(name, vehicle, MEASURED)
    packed, layout = start(estimator)
    samples, dt, _ = inputs(estimator, plausible_log(vehicle, 50))
    params, static = eqx.partition(estimator, eqx.is_array)

    def run(params: Any, state: Any, samples: Any, dt: Any) -> Any:
        return scan_steps(eqx.combine(params, static), layout, state, samples, dt, len(dt), kept)

    program = jax.jit(one_kernel(run)).lower(params, packed, samples, dt)
    assert "xla_cpu_small_call" in program.as_text()


@pytest.mark.parametrize("name", ["joint", "tfobe"])
def test_a_short_log_gets_the_numbers_of_a_long_run(name: str) -> None:
    """Steps that are kernels of their own, and a loop that is one, differ by rounding alone."""
    vehicle = load_vehicle("family-car")
    estimator, log = build(name, vehicle, MEASURED), plausible_log(vehicle, 500)
    short, long = scan(estimator, log), scan(estimator, log, among=chunk.SHORT + 1)
    for found, expected in ((short.values, long.values), (short.std, long.std)):
        for quantity, values in expected.items():
            # friction is weighed in single precision
            np.testing.assert_allclose(
                found[quantity], values, rtol=1e-5, atol=1e-5 * np.nanmax(np.abs(values))
            )
    np.testing.assert_array_equal(short.validity, long.validity)
