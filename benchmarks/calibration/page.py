"""The results as Markdown and as one JSON object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from benchmarks.accuracy.score import Score
from benchmarks.accuracy.table import fitted, number, wrapped
from benchmarks.calibration import friction, honesty
from numpy.typing import NDArray

from roadstate.metrics import NORMAL_95

HONESTY = "Stated standard deviations"
FRICTION = "Friction with what was learned from other drives"
_HONEST = (
    "Every seed's car is learned anew from its own recordings: mass and drag from `straight-variable-speed` "
    "(124 s), tires and the friction of dry roads from `slalom`, `double-lane-change-85-0.8` and "
    "`straight-0.8` (78 s), channels of the car's own bus. "
    "Errors and σ in per cent, root mean square over the seeds that learned the figure; `inside`: of these, "
    "how many have the reference within ±1.96 σ, the logarithm normal. The reference of mass, drag and "
    "friction is the plant's own figure. Steering, suspension and load transfer take a part of a tire's "
    "stiffness, so its reference is the axle's in the plant: lateral force over load by slip angle as the "
    "body sees it, below 0.25 of the load in the slalom, by ideal sensors and the truth; no estimator has "
    "part in it. `scatter` "
    "is about the seeds' own mean and needs no reference."
)
_ROAD = (
    "Figures of every seed's car are learned from {learned}, with satellites; then `joint` estimates the "
    "friction of other drives ({held_out}) with the new file. |Error| of the axles' peak friction in per "
    "cent, over samples, drives and seeds, mean of the vehicles' figures. Files: `{told}`; {files}. "
    "Three more tell causes, and nobody has them: the `{own}` stiffnesses (±3 %); the `{shape}` ± 0.05 in "
    "the file as told, the best there is in hindsight; `{asphalt}`: as told, with friction {mu:g} ± 3 % for "
    "that of dry roads."
)


def honest(found: honesty.Found, about: str) -> str:
    """The table of what is learned and how exactly it is said to be known; how it was made comes first."""
    rows = []
    for (figure, vehicle), seen in sorted(found.items()):
        error, std = np.array(seen.learned), np.array(seen.std)
        tries, inside = len(error) + sum(seen.refused.values()), np.abs(error) <= NORMAL_95 * std
        rows.append(
            (
                figure,
                vehicle,
                number(seen.reference),
                *(_percent(np.array(values)) for values in (seen.told, seen.learned)),
                _percent(error - error.mean()) if len(error) else "–",
                _percent(std),
                f"{inside.sum()} of {len(error)}" if np.isfinite(error).all() and len(error) else "–",
                f"{sum(seen.refused.values())} of {tries}",
            )
        )
    head = ("figure", "vehicle", "reference", "told off", "error", "scatter", "±1σ", "inside", "refused")
    return "\n\n".join((f"## {HONESTY}", wrapped(about), wrapped(_HONEST), fitted(head, rows)))


def _percent(values: NDArray[np.float64]) -> str:
    return number(100 * float(np.sqrt(np.mean(values**2)))) if len(values) else "–"


def of_friction(found: friction.Found, about: str) -> str:
    """The tables of friction with one vehicle file and another; how they were made comes first."""
    names = {
        "told": friction.TOLD,
        "files": "; ".join(f"`{file}`, `{','.join(of)}`" for file, of in friction.LEARNED.items()),
        "own": friction.OWN,
        "shape": friction.SHAPE,
        "asphalt": friction.ROAD,
    }
    explained = _ROAD.format(
        learned=" and ".join(f"`{d}`" for d in friction.LEARNED_FROM),
        held_out=", ".join(f"`{d}`" for d in friction.HELD_OUT),
        mu=friction.ASPHALT,
        **names,
    )
    single = [score for score in found.held_out if ", " in score.what]
    whole = [score for score in found.held_out if ", " not in score.what]
    return "\n\n".join(
        (
            f"## {FRICTION}",
            wrapped(about),
            wrapped(explained),
            "On drives that nothing was learned from:",
            _matrix([s for s in whole if "lower" not in s.what]),
            "Each of them, of samples that use 70 % of the friction or more:",
            _matrix([s for s in single if "≥ 0.7: median" in s.what or "≥ 0.7: too high" in s.what]),
            "On the drives that were learned from, as another seed's sensors recorded them:",
            _matrix([s for s in found.again if ", " not in s.what and "lower" not in s.what]),
            f"On a road that bears {friction.ASPHALT:g} no longer, but {friction.GRIPPY} "
            f"({', '.join(f'`{drive.name}`' for drive in friction.GRIPPIER)}):",
            _matrix([s for s in found.grippier if ", " not in s.what], (friction.TOLD, *friction.LEARNED)),
            "What was learned; of the seeds, mean and scatter, and the mean 1σ stated:",
            _learned(found),
        )
    )


def _matrix(scores: Sequence[Score], files: Sequence[str] = friction.FILES) -> str:
    by_key = {(score.what, score.estimator): score for score in scores}
    rows = []
    for what in dict.fromkeys(score.what for score in scores):
        here = [by_key.get((what, file)) for file in files]
        rows.append([what, *("–" if score is None else number(score.value) for score in here)])
    return fitted(["figure", *files], rows)


def _learned(found: friction.Found) -> str:
    rows = []
    for key in sorted({*found.learned, *found.refused}):
        values, refused = found.learned.get(key, []), found.refused[key]
        told = [number(value) for value in friction.mean_of(values)] if values else ["–"] * 3
        rows.append((*key, *told, f"{refused} of {refused + len(values)}"))
    return fitted(("file", "figure", "vehicle", "mean", "scatter", "1σ stated", "refused"), rows)


def page(sections: Mapping[str, str], before: str) -> str:
    """The whole page; of a study that was not made anew, as it was.

    Args:
        sections: title → text, heading included.
        before: the page so far; may be empty.
    """
    kept = {text.partition("\n")[0]: f"## {text.strip()}" for text in before.split("\n## ")[1:]}
    whole = kept | dict(sections)
    return "\n\n".join(["# Calibration", *(whole[t] for t in (HONESTY, FRICTION) if t in whole)]) + "\n"


def plain(honest: honesty.Found | None, road: friction.Found | None) -> dict[str, Any]:
    """For JSON."""
    told: dict[str, Any] = {}
    if honest is not None:
        told["honesty"] = [
            {"figure": figure, "vehicle": vehicle, **_finite(vars(seen))}
            for (figure, vehicle), seen in honest.items()
        ]
    if road is not None:
        told["held_out"] = [score.to_json() for score in road.held_out]
        told["again"] = [score.to_json() for score in road.again]
        told["grippier"] = [score.to_json() for score in road.grippier]
        told["learned"] = [[*key, values] for key, values in road.learned.items()]
        told["refused"] = [[*key, count] for key, count in road.refused.items()]
    return told


def _finite(values: Mapping[str, Any]) -> dict[str, Any]:
    """JSON knows no NaN."""
    whole = {}
    for name, value in values.items():
        one = [None if np.isnan(v) else v for v in value] if isinstance(value, list) else value
        whole[name] = None if isinstance(one, float) and np.isnan(one) else one
    return whole
