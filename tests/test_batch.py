"""Many logs at once give what each gives alone."""

from __future__ import annotations

import numpy as np
import pytest

from roadstate.core import InputError, Log
from roadstate.estimators import build
from roadstate.run import CHUNK, batch, scan
from roadstate.vehicles import load_vehicle


def drive(samples: int, seed: int) -> Log:
    rng = np.random.default_rng(seed)
    time = np.arange(samples) / 100
    speed = 12 + 2 * np.sin(0.2 * time) + 0.02 * rng.standard_normal(samples)
    accel = 0.3 + 0.4 * np.cos(0.2 * time) + 0.1 * rng.standard_normal(samples)
    return Log(time, {"speed": np.where(rng.random(samples) < 0.1, np.nan, speed), "accel_x": accel})


@pytest.mark.parametrize(("together", "memory"), [(None, 2**29), (8, 2**20), (8, 2**29), (2, 2**29)])
def test_batch_gives_what_scan_gives(together: int | None, memory: int) -> None:
    """Logs of any length, one longer than a chunk, in groups of any size."""
    logs = [drive(n, seed) for seed, n in enumerate((700, CHUNK + 300, 50, 1200, 900))]
    estimator = build("kmbe", load_vehicle("suv"), {"speed", "accel_x"})
    done: list[tuple[int, int]] = []
    results = batch(estimator, logs, together=together, memory=memory, progress=lambda *at: done.append(at))
    assert done[-1] == (5, 5)
    for log, result in zip(logs, results, strict=True):
        alone = scan(estimator, log)
        np.testing.assert_allclose(result.values["grade"], alone.values["grade"], rtol=0, atol=1e-10)
        np.testing.assert_allclose(result.std["grade"], alone.std["grade"], rtol=0, atol=1e-10)
        np.testing.assert_array_equal(result.validity, alone.validity)
        assert result.metadata == alone.metadata


@pytest.mark.parametrize("together", [1, 2])
def test_each_log_may_have_a_car_of_its_own(together: int) -> None:
    logs = [drive(600, 1)] * 2
    cars = [load_vehicle(name) for name in ("suv", "compact-car")]
    each = [build("kmbe", car, {"speed", "accel_x"}) for car in cars]
    for estimator, result in zip(each, batch(each, logs, together=together), strict=True):
        np.testing.assert_allclose(
            result.std["grade"], scan(estimator, logs[0]).std["grade"], rtol=0, atol=1e-10
        )


def test_refusals_name_the_mismatch() -> None:
    log = drive(50, 0)
    car = load_vehicle("suv")
    one = build("kmbe", car, {"speed", "accel_x"})
    other = build("kmbe", car, {"speed", "accel_x", "altitude"})
    with pytest.raises(InputError, match="no logs"):
        batch(one, [])
    with pytest.raises(InputError, match="2 estimators for 1 logs"):
        batch([one, one], [log])
    with pytest.raises(InputError, match="not built alike"):
        batch([one, other], [log, log])
    for wrong in ({"together": 0}, {"together": -1}, {"workers": 0}, {"workers": -1}):
        with pytest.raises(InputError, match=f"{next(iter(wrong))}: .*; give 1 or more"):
            batch(one, [log], **wrong)
