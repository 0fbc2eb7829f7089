"""The report's tables as rows of text; the page's template escapes every cell."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from roadstate.core import Estimates, Validity
from roadstate.metrics import Metrics
from roadstate.report.consistency import EXPECTED_BEYOND, nis_consistency, sensor_consistency
from roadstate.report.view import unit_label

_LONGEST = 240  # characters of one cell
_MOST_ROWS = 200
_PACKAGES = ("roadstate", "jax", "numpy", "bokeh")


@dataclass(frozen=True)
class Table:
    """A table of texts; the first ``labels`` columns are left-aligned names, the others numbers."""

    heading: str
    header: tuple[str, ...]
    rows: list[tuple[str, ...]]
    labels: int = 1
    note: str = ""


def number(value: float | None, digits: int = 3) -> str:
    """A number to ``digits`` significant digits, never in exponents between 1e-4 and 1e6; – for none."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0 or not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}g}"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{decimals}f}"


def share(value: float | None) -> str:
    """A share in per cent with one decimal; – for none."""
    return "–" if value is None else f"{100 * value:.1f} %"


def metrics_table(metrics: Mapping[str, Mapping[str, Metrics]]) -> Table | None:
    """Errors against the reference: a row for each quantity and estimator; ``None`` without any."""
    rows: list[tuple[str, ...]] = []
    order = list(dict.fromkeys(q for by_quantity in metrics.values() for q in by_quantity))
    for quantity in order:
        for name, by_quantity in metrics.items():
            if quantity not in by_quantity:
                continue
            m = by_quantity[quantity]
            errors = (m.mae, m.rmse, m.max, m.bias, m.mae_bias_removed)
            rows.append(
                (
                    f"{quantity.replace('_', ' ')} [{unit_label(m.unit)}]",
                    name,
                    *(number(v) for v in errors),
                    "–" if m.correlation is None else f"{m.correlation:.3f}",
                    "–" if m.settle_s is None else f"{m.settle_s:.1f} s",
                    number(m.nees),
                    share(m.coverage95),
                    str(m.n),
                )
            )
    if not rows:
        return None
    header = ("quantity", "estimator", "MAE", "RMSE", "max", "bias", "MAE without bias", "r", "settled after")
    return Table(
        "Errors against the reference",
        (*header, "NEES (1)", "inside 95 % (95 %)", "samples"),
        rows,
        labels=2,
        note="In brackets: what an honest uncertainty gives.",
    )


def consistency_table(results: Mapping[str, Estimates]) -> Table | None:
    """Innovations and NIS against what the filters claim; ``None`` where there are no innovations."""
    rows: list[tuple[str, ...]] = []
    for name, estimates in results.items():
        for s in sensor_consistency(estimates):
            ratio = (f"{number(s.rms)} (1)", f"{number(s.mean)} (0)")
            rows.append((name, s.sensor, *ratio, _against(s.beyond, EXPECTED_BEYOND), str(s.n)))
        nis = nis_consistency(estimates)
        if nis is not None:
            mean = f"{number(nis.mean)} ({number(nis.expected)})"
            rows.append((name, "NIS of all sensors", "–", mean, _against(nis.beyond, 0.05), str(nis.n)))
    if not rows:
        return None
    return Table(
        "Consistency",
        ("estimator", "sensor", "RMS of ν/σ", "mean", "outside", "samples"),
        rows,
        labels=2,
        note="In brackets: what a consistent filter gives. A sensor's rows are its innovations over their "
        "standard deviation, outside meaning beyond ±2σ; the mean NIS is expected to be the mean number of "
        "sensors with a sample, outside meaning above the 95 % quantile of χ².",
    )


def validity_table(results: Mapping[str, Estimates]) -> Table:
    """Share of the samples of each validity, by estimator; reasons that never occur are left out."""
    seen = [v for v in Validity if any((e.validity == v).any() for e in results.values())]
    rows: list[tuple[str, ...]] = [
        (name, *(share(float(np.mean(e.validity == v))) for v in seen)) for name, e in results.items()
    ]
    return Table("Share of samples", ("estimator", *(v.label.replace("_", " ") for v in seen)), rows)


def settings_table(heading: str, settings: Mapping[str, Any]) -> Table:
    """Nested settings as ``path.to.key`` and value."""
    rows = [(key, value) for key, value in _flat("", settings)]
    note = ""
    if len(rows) > _MOST_ROWS:
        note = f"{len(rows) - _MOST_ROWS} further entries are left out."
    return Table(heading, ("name", "value"), list(rows[:_MOST_ROWS]), labels=2, note=note)


def versions() -> dict[str, str]:
    """Versions of what made the report; packages that are not installed are left out."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _against(value: float, expected: float) -> str:
    return f"{share(value)} ({share(expected)})"


def _flat(prefix: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _flat(f"{prefix}.{key}" if prefix else str(key), inner)
        return
    if isinstance(value, float):
        text = f"{value:.9g}"
    elif isinstance(value, list | tuple | np.ndarray):
        text = ", ".join(f"{v:.9g}" if isinstance(v, float) else str(v) for v in list(value)[:100])
    else:
        text = "–" if value is None else str(value)
    yield prefix, text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
