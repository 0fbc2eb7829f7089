"""The source papers: one file, one paper: its conditions, its tables, ours beside them.

A module here that defines ``PAPER``, a :class:`roadstate.papers.base.Paper`, is found.
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from roadstate.papers.base import Paper

__all__ = ["all_papers"]


@cache
def all_papers() -> dict[str, Paper]:
    """Every paper by name, in alphabetical order."""
    from roadstate.papers.base import Paper

    modules = [importlib.import_module(m.name) for m in pkgutil.iter_modules(__path__, f"{__name__}.")]
    papers = [m.PAPER for m in modules if isinstance(getattr(m, "PAPER", None), Paper)]
    return {p.name: p for p in sorted(papers, key=lambda p: p.name)}
