"""How long the HTML report of a long log takes, and how large it is: 10⁶ samples, 20 channels, 2 estimators.

Run: python benchmarks/report.py [--samples N] [--keep FILE]
Budget: 5 s and 5 MB; the first time includes all imports.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from pathlib import Path

_BEGIN = time.perf_counter()

import numpy as np  # noqa: E402

from roadstate.core import WHEELS, Estimates, Log, Validity  # noqa: E402
from roadstate.report import write_report  # noqa: E402


def long_log(samples: int) -> Log:
    """A log at 100 Hz with noise, missing blocks, slow GNSS channels and a reference."""
    random = np.random.default_rng(1)
    t = np.arange(samples) / 100.0
    speed = 20.0 + 10.0 * np.sin(t / 300.0)
    grade = 0.04 * np.sin(t / 90.0)
    slow = np.arange(samples) % 100 != 0
    channels = {
        "speed": speed + 0.05 * random.standard_normal(samples),
        "accel_x": 9.81 * np.sin(grade) + 0.1 * random.standard_normal(samples),
        "accel_y": random.standard_normal(samples),
        "accel_z": 9.81 + random.standard_normal(samples),
        "yaw_rate": 0.1 * np.sin(t / 20.0) + 0.01 * random.standard_normal(samples),
        "pitch_rate": 0.01 * random.standard_normal(samples),
        "steering_wheel": np.sin(t / 20.0),
        "engine_torque": 100.0 + 50.0 * random.standard_normal(samples),
        "engine_speed": 200.0 + 20.0 * np.sin(t / 7.0),
        "gear_ratio": np.round(2.0 + np.sin(t / 60.0)),
        "brake": (np.sin(t / 40.0) > 0.98).astype(float),
        "latitude": 48.0 + 0.05 * np.sin(t / 2000.0),
        "longitude": 11.0 + 0.05 * np.cos(t / 1500.0),
        "altitude": 400.0 + 30.0 * np.sin(t / 90.0),
        "ref_grade": grade,
        "ref_velocity_x": speed,
    }
    channels |= {f"wheel_speed_{w}": speed / 0.3 + 0.2 * random.standard_normal(samples) for w in WHEELS}
    for name in ("latitude", "longitude", "altitude"):
        channels[name][slow] = np.nan
    channels["accel_x"][samples // 2 : samples // 2 + samples // 100] = np.nan
    return Log(t, channels, {"files": ["long.mf4"]})


def made_up_estimates(log: Log, seed: int) -> Estimates:
    """Estimates of four quantities, as noisy as a filter's, with three sensors."""
    random = np.random.default_rng(seed)
    n = len(log)
    std = 0.004 * (1.0 + np.exp(-log.time / 5.0))
    values = {
        "grade": log["ref_grade"] + std * random.standard_normal(n),
        "speed": log["ref_velocity_x"] + 0.02 * random.standard_normal(n),
        "altitude": 400.0 + 30.0 * np.sin(log.time / 90.0),
        "accel_x_bias": 0.1 + 0.001 * random.standard_normal(n),
    }
    deviations = {"grade": std, "speed": std * 5.0, "altitude": std * 500.0, "accel_x_bias": std}
    validity = np.zeros(n, np.int8)
    validity[random.random(n) < 0.02] = Validity.BRAKING
    spread = np.broadcast_to([0.1, 0.3, 3.0], (n, 3))
    innovation = spread * random.standard_normal((n, 3))
    nis = np.sum((innovation / spread) ** 2, axis=1)
    sensors = ("speed", "accel_x", "altitude")
    return Estimates(log.time, values, deviations, validity, sensors, innovation, spread, nis)


def main() -> None:
    """Measure and print one table row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=1_000_000)
    parser.add_argument("--keep", type=Path, help="keep the report here")
    options = parser.parse_args()
    imports = time.perf_counter() - _BEGIN
    log = long_log(options.samples)
    results = {"kmbe": made_up_estimates(log, 2), "debe": made_up_estimates(log, 3)}
    with tempfile.TemporaryDirectory() as folder:
        path = options.keep or Path(folder) / "report.html"
        times = []
        for _ in range(2):
            begin = time.perf_counter()
            write_report(path, log, results)
            times.append(time.perf_counter() - begin)
        cpu = time.process_time()
        write_report(path, log, results)
        cpu = time.process_time() - cpu
        size = path.stat().st_size / 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    header = ("samples", "channels", "first [s]", "again [s]", "again, CPU [s]", "size [MB]", "peak [MB]")
    row = (len(log), len(log.channels), imports + times[0], min(times[1:]), cpu, size, peak)
    print(" | ".join(header))
    print(" | ".join(f"{v:.2f}" if isinstance(v, float) else str(v) for v in row))


if __name__ == "__main__":
    main()
