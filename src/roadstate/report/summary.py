"""The report's opening paragraph: what was estimated, from what, and how well."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from roadstate.core import QUANTITIES, Estimates, Log, Validity
from roadstate.metrics import Metrics
from roadstate.report.panels import quantities
from roadstate.report.tables import number, share
from roadstate.report.view import unit_label


def source_of(log: Log) -> list[str]:
    """The names of the files a log came from, as its metadata tells; empty where it does not."""
    files = log.metadata.get("files", log.metadata.get("source", []))
    texts = [str(f) for f in files] if isinstance(files, list | tuple) else [str(files)]
    return [t.replace("\\", "/").rstrip("/").rsplit("/", 1)[-1] for t in texts if t]


def summary(
    log: Log, results: Mapping[str, Estimates], metrics: Mapping[str, Mapping[str, Metrics]]
) -> list[str]:
    """The paragraph's sentences, as plain text."""
    given = quantities(results)
    what = _listed([QUANTITIES[q].description for q in given] or ["nothing"])
    files = source_of(log)
    source = f" of {_listed(files[:5])}" if files else ""
    source += f" and {len(files) - 5} more files" if len(files) > 5 else ""
    rate = f" at about {1.0 / np.median(np.diff(log.time)):.3g} Hz" if len(log) > 1 else ""
    channels = len(log.available)
    sentences = [
        f"{_capital(what)}, estimated with {_listed(list(results))} from {duration_text(log.duration)}"
        f"{source} ({len(log)} samples{rate}, {channels} channels)."
    ]
    main = next((q for q in given if any(q in m for m in metrics.values())), None)
    if main is None:
        sentences.append("The log has no reference to compare with: there are no errors to show.")
    else:
        rows = [(name, m[main]) for name, m in metrics.items() if main in m]
        errors = _listed([f"{number(m.mae)} {unit_label(m.unit)} ({name})" for name, m in rows])
        inside = _listed([share(m.coverage95) for _, m in rows])
        sentences.append(
            f"Mean absolute error of {main.replace('_', ' ')} against the reference: {errors}; the reference "
            f"lies inside the stated 95 % interval for {inside} of the samples."
        )
    trusted = [
        f"{share(float(np.mean(e.validity == Validity.EXCITED)))} ({name})" for name, e in results.items()
    ]
    sentences.append(f"Samples in which the signals determine the estimate (excited): {_listed(trusted)}.")
    return sentences


def duration_text(seconds: float) -> str:
    """A duration in the unit people would use."""
    if seconds < 180:
        return f"{seconds:.3g} s"
    minutes = round(seconds / 60)
    return f"{seconds / 60:.3g} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60:02d} min"


def _listed(texts: Sequence[str]) -> str:
    *others, last = texts
    return f"{', '.join(others)} and {last}" if others else last


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
