"""The results as Markdown, at most 120 characters wide, and as one JSON object."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from benchmarks.accuracy.score import Score

WIDEST = 120


def markdown(
    titles: Mapping[str, str],
    scores: Sequence[Score],
    notes: Sequence[str],
    *,
    preamble: str,
    sections: Sequence[str] = (),
    subject: str,
) -> str:
    """The page.

    Args:
        titles: of the groups by name, in order.
        scores: of all groups.
        notes: what was left out, and why.
        preamble: how the page was made.
        sections: to stand behind the groups.
        subject: the estimator that is judged; where it gives a figure, the others stand beside it.
    """
    parts = [preamble.strip(), wrapped(_HOW.format(subject=subject))]
    for group, title in titles.items():
        own = [score for score in scores if score.group == group]
        if own:
            parts += [f"## {title}", _judged(own, subject)]
            if len({score.estimator for score in own}) > 1:
                parts.append(_matrix(own, subject))
    parts += sections
    if notes:
        parts += ["## Left out", "\n".join(f"- {note}" for note in notes)]
    return "\n\n".join(parts) + "\n"


_HOW = (
    "A figure is the mean of the vehicles' figures; in brackets the 5th and 95th percentile of single seeds; "
    "then the vehicle farthest from the goal. `{subject}` is judged where it gives a figure, else the best "
    "estimator (in italics). `met*`: on average, but not by the vehicle farthest from it. `bound`: the least "
    "that any filter could reach (see `benchmarks/accuracy/grade_bound.py` for grade and mass, "
    "`benchmarks/accuracy/friction_bound.py` for friction and forces)."
)


def _judged(scores: Sequence[Score], subject: str) -> str:
    """For each figure: the judged estimator, the best of the others, the bound, goal and verdict."""
    rows = []
    for what in dict.fromkeys(score.what for score in scores):
        same = sorted((s for s in scores if s.what == what), key=_badness)
        own = next((s for s in same if s.estimator == subject), None)
        judged = own or same[0]
        rival = next((s for s in same if s is not judged), None)
        label = "" if own else f"*{judged.estimator}* "
        bound = judged.bound
        rows.append(
            (
                what,
                f"{label}{number(judged.value)} {_spread(judged)}",
                _worst(judged),
                "" if rival is None else f"{rival.estimator} {number(rival.value)}",
                "" if bound is None else number(bound),
                "" if judged.goal is None else str(judged.goal),
                judged.verdict,
            )
        )
    head = ("figure", f"{subject} [seeds]", "worst vehicle", "best other", "bound", "goal", "verdict")
    kept = [i for i in range(len(head)) if i != 4 or any(row[4] for row in rows)]
    return fitted([head[i] for i in kept], [[row[i] for i in kept] for row in rows])


def _matrix(scores: Sequence[Score], subject: str) -> str:
    """Every estimator's figure."""
    names = sorted({score.estimator for score in scores}, key=lambda name: (name != subject, name))
    by_key = {(score.what, score.estimator): score for score in scores}
    rows = []
    for what in dict.fromkeys(score.what for score in scores):
        found = [by_key.get((what, name)) for name in names]
        rows.append([what, *("–" if score is None else number(score.value) for score in found)])
    return fitted(["figure", *names], rows)


def fitted(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; where it is too wide, cells are padded no more, and then it is cut into two."""
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    if sum(widths) + 3 * len(widths) + 1 > WIDEST and len(head) > 3:
        half = (len(head) + 1) // 2
        first = fitted(head[:half], [row[:half] for row in rows])
        rest = [0, *range(half, len(head))]
        return f"{first}\n\n{fitted([head[i] for i in rest], [[row[i] for i in rest] for row in rows])}"

    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)) + " |"

    ruled = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
    return "\n".join([line(head), ruled, *(line(row) for row in rows)])


def wrapped(text: str) -> str:
    """A paragraph."""
    return textwrap.fill(text, WIDEST - 4, break_on_hyphens=False)


def number(value: float) -> str:
    """Three digits; a dash where there is none."""
    if not np.isfinite(value):
        return "∞" if np.isposinf(value) else "–"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _badness(score: Score) -> float:
    if score.goal is not None:
        return score.goal.badness(score.value)
    return score.value if np.isfinite(score.value) else np.inf


def _spread(score: Score) -> str:
    low, high = score.spread
    return f"[{number(low)}–{number(high)}]" if np.isfinite(low) else ""


def _worst(score: Score) -> str:
    if len(score.vehicles) < 2:
        return ""
    name, value = score.worst
    return f"{name} {number(value)}"


def as_json(about: Mapping[str, Any], scores: Sequence[Score], notes: Sequence[str]) -> dict[str, Any]:
    """One object: how it was made, all figures with each seed's, what was left out."""
    return {**about, "scores": [score.to_json() for score in scores], "notes": list(notes)}
