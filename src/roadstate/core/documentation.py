"""The documentation's tables of names, made from the tables in the code."""

from __future__ import annotations

from collections.abc import Iterable

from roadstate.core.channels import CHANNELS, WHEELS, Channel
from roadstate.core.quantities import QUANTITIES, is_bound

_PAGE = """\
# Channels and quantities

Every signal has one name, one unit and one sign. Axes are ISO 8855: x forward, y left, z up; angles and rates
follow the right-hand rule. `{{{wheels}}}` stands for four channels: front left, front right, rear left, rear
right. A missing sample is NaN. Logs in other units are converted when they are read.

## Measured channels

{measured}

## References

Truth to compare with; never read by an estimator.

{references}

## Quantities

What estimators give, each with its standard deviation `<name>_std` in the same unit. Every peak friction has
its 5 % and 95 % bounds beside it, `<name>_lower` and `<name>_upper`: where the drive says little of it, they,
and not the number between them, are the result.

Where a log has references, `grade` is compared with `ref_grade`, `speed` with `ref_velocity_x`, `velocity_y`
with `ref_velocity_y`, a peak friction with the mean of `ref_friction_*` of its wheels, a force with the sum
of `ref_force_x_*` or `ref_force_y_*` of its wheels, and `friction_used` with the sum of the forces (as if all
wheels stood in one direction) over the sum of `ref_load_*`.

{quantities}
"""


def markdown_table(rows: Iterable[Channel]) -> str:
    """A Markdown table of channels or quantities: name, unit, what it is, what a positive value means.

    The four wheels' channels share a row, ``wheel_speed_{fl,fr,rl,rr}``.
    """
    lines = ["| name | unit | what | positive |", "|---|---|---|---|"]
    for row in rows:
        stem, _, wheel = row.name.rpartition("_")
        name, what = row.name, row.description
        if stem and wheel in WHEELS:
            if wheel != WHEELS[0]:
                continue
            name, what = f"{stem}_{{{','.join(WHEELS)}}}", what.rpartition(",")[0]
        lines.append(f"| `{name}` | `{row.unit}` | {what} | {row.sign} |")
    return "\n".join(lines)


def channels_page() -> str:
    """The text of ``docs/channels.md``."""
    return _PAGE.format(
        wheels=",".join(WHEELS),
        measured=markdown_table(c for c in CHANNELS.values() if not c.is_reference),
        references=markdown_table(c for c in CHANNELS.values() if c.is_reference),
        quantities=markdown_table(q for q in QUANTITIES.values() if not is_bound(q.name)),
    )
