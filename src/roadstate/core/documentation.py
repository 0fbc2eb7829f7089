"""The documentation's tables of names, made from the tables in the code."""

from __future__ import annotations

from collections.abc import Iterable

from roadstate.core.channels import CHANNELS, WHEELS, Channel
from roadstate.core.estimates import QUANTITIES, REFERENCE_OF

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

What estimators give, each with its standard deviation `<name>_std` in the same unit.
{compared}

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
    compared = ", ".join(f"`{name}` is compared with `{ref}`" for name, ref in REFERENCE_OF.items())
    return _PAGE.format(
        wheels=",".join(WHEELS),
        measured=markdown_table(c for c in CHANNELS.values() if not c.is_reference),
        references=markdown_table(c for c in CHANNELS.values() if c.is_reference),
        quantities=markdown_table(QUANTITIES.values()),
        compared=f"{compared[0].upper()}{compared[1:]}." if compared else "",
    )
