"""What ``estimate`` writes to ``summary.json``."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from roadstate import __version__
from roadstate.core import QUANTITIES, Estimates, Log, Validity
from roadstate.estimators.remarks import remarks

if TYPE_CHECKING:
    from roadstate.cli.logs import Source
    from roadstate.cli.runs import Run
    from roadstate.vehicles import Vehicle


def versions() -> dict[str, str]:
    """The versions that a result depends on."""
    return {
        "roadstate": __version__,
        "python": platform.python_version(),
        "jax": version("jax"),
        "numpy": version("numpy"),
    }


def settings(source: Source, vehicle: str, estimators: Sequence[str], smooth: bool = False) -> dict[str, Any]:
    """What the user asked for; ``None`` and empty where it was left to roadstate."""
    return {
        "vehicle": vehicle,
        "mapping": None if source.mapping is None else str(source.mapping),
        "dbc": [str(d) for d in source.dbc],
        "rate": source.rate,
        "estimators": list(estimators),
        "smooth": smooth,
    }


def log_summary(run: Run, vehicle: Vehicle) -> dict[str, Any]:
    """One log: what was in it and what each estimator says of it, who was told a vehicle file."""
    log = run.log
    return {
        "files": _files(log),
        "duration_s": log.duration,
        "samples": len(log),
        "rate_hz": 1.0 / float(np.median(np.diff(log.time))) if len(log) > 1 else None,
        "channels": sorted(log.available),
        "skipped": list(log.metadata.get("skipped", [])),
        "undecoded": list(log.metadata.get("undecoded", [])),
        "dropped": dict(log.metadata.get("dropped", {})),
        "held": dict(log.metadata.get("held", {})),
        "late": [{"channels": one.channels, "seconds": one.seconds, "std": one.std} for one in run.late],
        "estimators": {name: estimates_summary(e, vehicle) for name, e in run.results.items()},
        "metrics": {
            name: {quantity: m.to_json() for quantity, m in found.items()}
            for name, found in run.metrics.items()
        },
    }


def estimates_summary(estimates: Estimates, vehicle: Vehicle) -> dict[str, Any]:
    """One estimator on one log: figures of each quantity in SI, validity, sensors' faults, consistency."""
    nis = estimates.nis[np.isfinite(estimates.nis)]
    shares = {v.label: float(np.mean(estimates.validity == v)) for v in Validity}
    return {
        "quantities": {
            name: {"unit": QUANTITIES[name].unit, **_figures(values, estimates.std.get(name))}
            for name, values in estimates.values.items()
        },
        "validity": {label: share for label, share in shares.items() if share > 0},
        "faults": list(estimates.metadata.get("faults", [])),
        "remarks": remarks(estimates, vehicle.mass, vehicle.sensors.accel.bias),
        "smoothed": list(estimates.metadata.get("smoothed", [])),
        "rejected": dict(estimates.metadata.get("rejected", {})),
        "nis_mean": float(np.mean(nis)) if len(nis) else None,
    }


def vehicle_summary(vehicle: Vehicle, given: str) -> dict[str, Any]:
    """The car's figures and where they were taken from."""
    return {"from": given, **vehicle.model_dump(mode="json")}


def _figures(values: np.ndarray[Any, Any], std: np.ndarray[Any, Any] | None) -> dict[str, float | None]:
    good = np.isfinite(values)
    if not good.any():
        return dict.fromkeys(("mean", "std", "min", "max", "final", "final_std", "mean_std"))
    last = int(np.flatnonzero(good)[-1])
    known = values[good]
    return {
        "mean": float(np.mean(known)),
        "std": float(np.std(known)),
        "min": float(np.min(known)),
        "max": float(np.max(known)),
        "final": float(values[last]),
        "final_std": None if std is None else float(std[last]),
        "mean_std": None if std is None else float(np.mean(std[good])),
    }


def _files(log: Log) -> list[str]:
    return [Path(str(f)).name for f in log.metadata.get("files", [])]
