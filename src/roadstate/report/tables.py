"""The report's tables as rows of text; the page's template escapes every cell."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from roadstate.consistency import BandTest, Whiteness
from roadstate.core import Estimates, Log, Validity
from roadstate.metrics import Metrics
from roadstate.report.consistency import (
    EXPECTED_BEYOND,
    LAGS,
    errors_consistency,
    nis_consistency,
    sensor_consistency,
)
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


def innovation_table(results: Mapping[str, Estimates]) -> Table | None:
    """Each sensor's innovations against what the filters claim; ``None`` where there are none."""
    rows: list[tuple[str, ...]] = []
    for name, estimates in results.items():
        for s in sensor_consistency(estimates):
            size = (number(s.rms), number(s.mean), share(s.beyond))
            rows.append((name, s.sensor, *size, *_whiteness(s.autocorrelation), str(s.n)))
    if not rows:
        return None
    expected = ("RMS of ν/σ (1)", "mean (0)", f"outside ±2σ ({share(EXPECTED_BEYOND)})")
    return Table(
        "Innovations",
        ("estimator", "sensor", *expected, "ρ₁ (0 ± bound)", "lags outside (5.0 %)", "white", "samples"),
        rows,
        labels=2,
        note="In brackets: what a consistent filter gives. ν/σ is an innovation over its standard deviation, "
        f"ρ₁ its correlation with the sensor's next one. White: the squares of the first {LAGS} correlations "
        "stay below the 95 % limit of χ² (Box–Pierce). Where a sensor's own errors are correlated, as real "
        "ones' are, no tuning of a filter that takes them for white makes its innovations so.",
    )


def band_table(results: Mapping[str, Estimates], log: Log) -> Table | None:
    """NIS, NEES and coverage with their bands; ``None`` where there is none of them."""
    rows: list[tuple[str, ...]] = []
    for name, estimates in results.items():
        nis = nis_consistency(estimates)
        if nis is not None:
            rows.append((name, "NIS per sensor (1)", *_band(nis.mean), str(nis.n), "all"))
            rows.append(
                (name, "NIS above its 95 % quantile (5.0 %)", share(nis.beyond), "–", "–", str(nis.n), "–")
            )
    for name, e in errors_consistency(results, log):
        shown, counts = e.quantity.replace("_", " "), (str(e.n), str(e.independent))
        rows.append((name, f"NEES of {shown} (1)", *_band(e.nees), *counts))
        rows.append((name, f"coverage of {shown} (95.0 %)", *_band(e.coverage, share), *counts))
    if not rows:
        return None
    return Table(
        "Bands",
        ("estimator", "of (expected)", "value", "95 % band", "verdict", "samples", "of them independent"),
        rows,
        labels=2,
        note="A filter whose model is the world's stays in the band 95 times in 100. The band of the NIS "
        "takes innovations as independent in time: where they are not white (above), it is too "
        "narrow. Errors are correlated even in a perfect filter, so the bands of NEES and coverage "
        "count only samples so far apart that neighbours hardly correlate; an error that is a "
        "constant offset has none such, and no band.",
    )


def validity_table(results: Mapping[str, Estimates]) -> Table:
    """Share of the samples of each validity, by estimator; reasons that never occur are left out."""
    seen = [v for v in Validity if any((e.validity == v).any() for e in results.values())]
    rows: list[tuple[str, ...]] = [
        (name, *(share(float(np.mean(e.validity == v))) for v in seen)) for name, e in results.items()
    ]
    return Table("Share of samples", ("estimator", *(v.label.replace("_", " ") for v in seen)), rows)


def faults_table(results: Mapping[str, Estimates]) -> Table | None:
    """The sensors' faults that estimators found, in the order in which they begin; ``None`` without any."""
    rows: list[tuple[str, ...]] = [
        (name, one["fault"], f"{one['first_s']:.2f}", f"{one['last_s']:.2f}", share(one["share"]))
        for name, estimates in results.items()
        for one in estimates.metadata.get("faults", [])
    ]
    if not rows:
        return None
    return Table(
        "Faults of sensors", ("estimator", "fault", "from, s", "to, s", "share of samples"), rows, labels=2
    )


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


def _whiteness(found: Whiteness | None) -> tuple[str, str, str]:
    if found is None:
        return ("–", "–", "–")
    near = f"{number(float(found.correlation[0, 0]))} (0 ± {number(float(found.bound[0, 0]), 2)})"
    white = bool(found.portmanteau[0] <= found.limit)
    return near, share(float(found.share_outside[0])), "yes" if white else "no"


def _band(test: BandTest, show: Callable[[float], str] = number) -> tuple[str, str, str]:
    if not np.isfinite(test.low):
        return show(float(test.value)), "–", "–"
    verdict = "inside" if test.inside else "above" if test.value > test.high else "below"
    return show(float(test.value)), f"{show(float(test.low))} to {show(float(test.high))}", verdict


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
