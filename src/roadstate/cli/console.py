"""What goes to standard output: tables for people, one JSON object for programs."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text


def console() -> Console:
    """Standard output for people: colours only on a terminal that wants them, 80 columns elsewhere."""
    from rich.console import Console

    return Console(file=sys.stdout, highlight=False, markup=False, emoji=False)


def table(
    *columns: str, title: str = "", left: Sequence[str] = (), wrap: Sequence[str] = (), gap: int = 2
) -> Table:
    """An empty table; numbers to the right.

    Args:
        columns: headings.
        title: line above.
        left: headings of the columns that hold text.
        wrap: headings of those whose text may go on in the next line.
        gap: blanks between columns.
    """
    from rich import box
    from rich.table import Table

    made = Table(
        title=text(title) if title else None,
        box=box.SIMPLE_HEAD,
        padding=(0, gap - 1, 0, 0),
        pad_edge=False,
        show_edge=False,
        title_justify="left",
        title_style="bold",
    )
    for name in columns:
        justify: Literal["left", "right"] = "left" if name in left else "right"
        made.add_column(name, justify=justify, no_wrap=name not in wrap, overflow="fold")
    return made


def text(content: str) -> Text:
    """Text that came with data: neither markup nor control characters act."""
    from rich.text import Text

    return Text("".join(c if c.isprintable() or c == "\n" else "\N{REPLACEMENT CHARACTER}" for c in content))


def figure(value: float | None, digits: int = 3, most: int | None = None) -> str:
    """A number in as few characters as ``digits`` significant ones take; ``-`` where there is none.

    Figures before the decimal point are dropped from ten millions on only: 123456 stays that.

    Args:
        value: the number.
        digits: significant ones.
        most: decimals; as many as it takes by default.
    """
    if value is None or not math.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if size >= 7 or (size < -4 and most is None):
        return f"{value:.{digits - 1}e}"
    decimals = max(digits - 1 - size, 0)
    return f"{value:.{decimals if most is None else min(decimals, most)}f}"


def with_unit(quantity: str, unit: str) -> str:
    """A row's heading; a quantity without a dimension stands alone."""
    return quantity if unit == "-" else f"{quantity} {unit}"


def print_json(content: Mapping[str, Any]) -> None:
    """One JSON object on standard output."""
    sys.stdout.write(to_json(content))


def to_json(content: Mapping[str, Any]) -> str:
    """JSON text with a line break at its end; what is not a number is ``null``."""
    return json.dumps(plain(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def plain(value: Any) -> Any:
    """The same in JSON's own types."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(v) for v in value]
    if isinstance(value, bool | int | str) or value is None:
        return value
    if hasattr(value, "item") and getattr(value, "ndim", 0) == 0:
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return str(value)
