"""Grade and friction on real recordings, beside a plain non-causal grade, and what its reference is worth.

``python -m benchmarks.real_logs`` prints the tables of ``benchmarks/results/real_logs.md``.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from roadstate.calibration.parameters import with_value
from roadstate.core import Estimates, Log
from roadstate.core.constants import GRAVITY
from roadstate.core.numerics import use_compilation_cache
from roadstate.estimators import build
from roadstate.io import load_mapping, read_all
from roadstate.metrics import NORMAL_95, error_std, evaluate, reference_std
from roadstate.run import scan
from roadstate.vehicles import Vehicle, load_vehicle

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT.parent / "shared" / "data"
EXAMPLES = ROOT / "examples"
Array = NDArray[np.float64]
LEVEL_STD = 0.03
"""m/s²: 1σ of an accelerometer's level that half a minute of a known road has told."""


def load(example: str, files: list[Path], dbc: list[Path], vehicle: str, mapping: str) -> tuple[Log, Vehicle]:
    """A recording through the example's mapping, as the command line reads it."""
    car = load_vehicle(EXAMPLES / example / vehicle)
    rules = load_mapping(EXAMPLES / example / mapping)
    recording = read_all(files, dbc=dbc, time_column=rules.time_column, time_unit=rules.time_unit)
    return rules.apply(recording, wheel_radius=car.wheels.radius).resample(), car


def moving_mean(values: Array, time: Array, window: float) -> Array:
    """Centred mean over ``window`` seconds (so not causal); NaN where the window is not filled."""
    count = round(window / float(np.median(np.diff(time))))
    out = np.full(len(values), np.nan)
    out[count // 2 : len(values) - (count - 1) // 2] = np.convolve(values, np.ones(count) / count, "valid")
    return out


def plain(log: Log, speed: Array, window: float) -> Array:
    """(a_x − dv/dt)/g over a centred window, in %: what a spreadsheet would do."""
    known = np.isfinite(speed)
    filled = np.interp(log.time, log.time[known], speed[known])
    seen = np.isfinite(log["accel_x"])
    accel = np.interp(log.time, log.time[seen], log["accel_x"][seen])
    slope = np.gradient(moving_mean(filled, log.time, window), log.time)
    return 100 * (moving_mean(accel, log.time, window) - slope) / GRAVITY


def scores(percent: Array, log: Log, where: NDArray[np.bool_]) -> dict[str, float]:
    """Correlation, MAE, bias-removed MAE, RMSE and bias in % of grade."""
    reference = 100 * np.tan(log["ref_grade"])
    good = where & np.isfinite(percent) & np.isfinite(reference)
    error = percent[good] - reference[good]
    return {
        "r": float(np.corrcoef(percent[good], reference[good])[0, 1]),
        "MAE": float(np.abs(error).mean()),
        "MAE, bias removed": float(np.abs(error - error.mean()).mean()),
        "RMSE": float(np.sqrt((error**2).mean())),
        "bias": float(error.mean()),
    }


def ours(name: str, log: Log, car: Vehicle, where: NDArray[np.bool_]) -> tuple[dict[str, float], Estimates]:
    """The estimator's :func:`judged` scores on the same samples."""
    estimates = scan(build(name, car, log.available), log)
    return judged(estimates, log, where), estimates


def judged(estimates: Estimates, log: Log, where: NDArray[np.bool_]) -> dict[str, float]:
    """Scores of estimates on some samples, with coverage and NEES (the reference's own σ counted)."""
    row = scores(100 * np.tan(estimates.values["grade"]), log, where)
    z = (estimates.values["grade"] - log["ref_grade"]) / error_std(estimates, log, "grade")
    z = z[where & np.isfinite(z)]
    return row | {"coverage": float((np.abs(z) < NORMAL_95).mean()), "NEES": float((z**2).mean())}


def table(title: str, rows: dict[str, dict[str, Any]]) -> str:
    """A Markdown table."""
    columns = list(dict.fromkeys(c for row in rows.values() for c in row))
    lines = [f"### {title}", "", "| | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns)]
    for name, row in rows.items():
        cells = [f"{row[c]:.3f}" if c in row else "" for c in columns]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def of_friction(log: Log, car: Vehicle, name: str) -> dict[str, float]:
    """What an estimator says of a road of which it is known only that there is no ice on it: how often its
    middle value lies below 0.5 and its upper bound below 0.6 (shares), and the extremes."""
    values = scan(build(name, car, log.available), log).values
    middle, upper = values["friction_peak"], values["friction_peak_upper"]
    return {
        "used, at most": float(np.nanmax(values["friction_used"])),
        "peak below 0.5": float(np.mean(middle < 0.5)),
        "upper bound below 0.6": float(np.mean(upper < 0.6)),
        "least peak": float(np.nanmin(middle)),
        "least upper bound": float(np.nanmin(upper)),
        "largest lower bound": float(np.nanmax(values["friction_peak_lower"])),
    }


def comma2k19() -> str:
    """The RAV4: car's accelerometer, phone's, and the same with GNSS altitude."""
    folder = DATA / "comma2k19"
    parts = []
    cases = [
        ("car's accelerometer", "vehicle.yaml", "mapping.yaml", ("joint", "kmbe", "debe", "tfobe")),
        ("phone's accelerometer", "vehicle_phone.yaml", "mapping_phone.yaml", ("joint", "kmbe")),
    ]
    for title, vehicle, mapping, names in cases:
        files = [folder / "segment40_decoded_50Hz.csv.gz"]
        log, car = load("comma2k19", files, [], vehicle, mapping)
        speed = car.wheels.radius * np.mean(
            [log[f"wheel_speed_{w}"] for w in ("fl", "fr", "rl", "rr")], axis=0
        )
        reference = plain(log, speed, 1.0)
        where = np.isfinite(reference) & (log.time - log.time[0] >= 3.0)
        rows = {"plain, 1 s, not causal": scores(reference, log, where)}
        for name in names:
            rows[f"{name}, causal"], _ = ours(name, log, car, where)
        parts.append(table(f"comma2k19, {title} (after 3 s, {int(where.sum())} samples)", rows))
        if title.startswith("car"):
            parts.append(levelled(log, car, reference, names))
            found = {name: of_friction(log, car, name) for name in ("joint", "friction-ukf", "lm-aekf")}
            parts.append(table("comma2k19, friction: streets of San Francisco in August, with bumps", found))
    with tempfile.TemporaryDirectory() as temporary:
        fixes = Path(temporary) / "gnss.csv"
        script = EXAMPLES / "comma2k19" / "gnss.py"
        subprocess.run([sys.executable, script, folder / "segment40", fixes], check=True)
        for title, vehicle, mapping, _ in cases:
            files = [folder / "segment40_decoded_50Hz.csv.gz", fixes]
            log, car = load("comma2k19", files, [], vehicle, mapping)
            where = log.time - log.time[0] >= 3.0
            rows = {f"{name}, causal": ours(name, log, car, where)[0] for name in ("joint", "kmbe")}
            parts.append(table(f"comma2k19, {title} and GNSS altitude (after 3 s)", rows))
    return "\n".join(parts)


def levelled(log: Log, car: Vehicle, baseline: Array, names: tuple[str, ...]) -> str:
    """The second half, the accelerometer's level set on the first, as css_mf4's is.

    That is an ``offset`` in the mapping, and a ``bias`` in the vehicle file that says how well it is known.
    """
    second = log.time >= float(log.time[0] + log.time[-1]) / 2
    error = (baseline - 100 * np.tan(log["ref_grade"]))[~second]
    level = GRAVITY * float(np.nanmean(error)) / 100
    even = log.with_channels({"accel_x": log["accel_x"] - level})
    told = with_value(car, ("sensors", "accel", "bias"), LEVEL_STD)
    rows = {"plain, 1 s, not causal": scores(baseline - 100 * level / GRAVITY, log, second)}
    rows |= {f"{name}, causal": ours(name, even, told, second)[0] for name in names}
    return table(f"comma2k19, level ({level:.3f} m/s²) set on the first half; the second half", rows)


def css_mf4() -> str:
    """The MF4 drive: both halves (figures set on the first), and the reference's own noise."""
    folder = DATA / "css_mf4"
    files = sorted(folder.glob("0*.MF4"))
    log, car = load("css_mf4", files, [folder / "canmod-gps.dbc"], "vehicle.yaml", "mapping.yaml")
    baseline = plain(log, log["speed"], 3.0)
    middle = float(log.time[0] + log.time[-1]) / 2
    parts = []
    names = ("joint", "kmbe", "debe")
    results = {name: scan(build(name, car, log.available), log) for name in names}
    halves = {
        "first half (parameters set here)": log.time < middle,
        "second half": log.time >= middle,
        "whole drive": np.isfinite(log.time),
    }
    for title, where in halves.items():
        rows = {"plain, 3 s, not causal": scores(baseline, log, where)}
        rows |= {f"{name}, causal": judged(e, log, where) for name, e in results.items()}
        parts.append(table(f"css_mf4, {title}", rows))
    metrics = {n: evaluate(e, log)["grade"].to_json() for n, e in results.items()}
    parts.append(reference_noise(log, results))
    parts.append(
        "`roadstate compare` says the same: "
        + ", ".join(f"{n} MAE {m['mae']:.3f} %" for n, m in metrics.items())
    )
    return "\n".join(parts)


def reference_noise(log: Log, results: dict[str, Estimates]) -> str:
    """What the GNSS slope itself is worth: its fit's standard error, and a three-cornered hat.

    With independent errors, var(k − r) + var(d − r) − var(k − d) = 2 var(r). KMBE and DEBE share the speed
    signal, so part of it is theirs: the figure is an upper bound.
    """
    kinematic, driving = (100 * np.tan(results[n].values["grade"]) for n in ("kmbe", "debe"))
    reference = 100 * np.tan(log["ref_grade"])
    good = np.isfinite(reference) & (results["debe"].validity == 0)
    pairs = ((kinematic, reference), (driving, reference), (kinematic, driving))
    spread = [float(np.var((a - b)[good])) for a, b in pairs]
    hat = np.sqrt(max(0.0, (spread[0] + spread[1] - spread[2]) / 2))
    own = 100 * reference_std(log, ["ref_grade"])
    left = (spread[0] + spread[2] - spread[1], spread[1] + spread[2] - spread[0])
    shares = [np.sqrt(max(0.0, v / 2)) for v in left]
    return (
        f"Reference's own noise: {own:.2f} % by the residuals of its fit, at most {hat:.2f} % by a "
        f"three-cornered hat with KMBE and DEBE (which leaves them {shares[0]:.2f} % and {shares[1]:.2f} %); "
        "bias removed.\n"
    )


def main() -> None:
    """Print the tables."""
    if not DATA.is_dir():
        raise SystemExit("the real recordings (../shared/data) are not on this machine")
    use_compilation_cache()
    print("# Real recordings\n\nMade by `python -m benchmarks.real_logs`; errors in % of grade.\n")
    print(comma2k19())
    print(css_mf4())


if __name__ == "__main__":
    main()
