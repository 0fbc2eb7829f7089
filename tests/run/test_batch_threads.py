"""Groups of logs on several threads at once: none may wait for the others for ever."""

from __future__ import annotations

import subprocess
import sys

# in a process of its own, which can be stopped: a program that waits inside XLA cannot
SCRIPT = """
import numpy as np
from roadstate.core import Log
from roadstate.estimators import build
from roadstate.run import batch
from roadstate.vehicles import load_vehicle

time = np.arange(0, 6, 0.01)
rng = np.random.default_rng(0)
wheels = {f"wheel_speed_{w}": 60 + rng.normal(0, 0.1, time.size) for w in ("fl", "fr", "rl", "rr")}
log = Log(time, {"accel_x": rng.normal(0, 0.05, time.size), **wheels}, {})
estimator = build("kmbe", load_vehicle("family-car"), log.available)
for workers in (2, 4, 8):
    said = batch(estimator, [log] * 64, memory=2**20, workers=workers)
    assert len(said) == 64 and all(np.isfinite(e.values["grade"]).all() for e in said)
"""


def test_many_groups_come_to_an_end() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
