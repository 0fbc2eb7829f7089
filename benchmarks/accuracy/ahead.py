"""One thing after another, each made while the one before it is worked on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


def made_ahead(make: Callable[..., T], wanted: Sequence[tuple[object, ...]]) -> Iterator[T]:
    """What ``make`` makes of each of the arguments wanted, in their order, one ahead of who takes it."""
    with ThreadPoolExecutor(1) as maker:
        ahead = maker.submit(make, *wanted[0])
        for following in (*wanted[1:], None):
            ready = ahead.result()
            if following is not None:
                ahead = maker.submit(make, *following)
            yield ready
