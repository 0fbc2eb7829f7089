"""Log files in, log files out. Names are imported when first used: the command line starts without."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING

from roadstate.lazy import lazily

if TYPE_CHECKING:
    from roadstate.io.files import read, read_all, write
    from roadstate.io.formats import all_formats
    from roadstate.io.mapping import Mapping, load_mapping
    from roadstate.io.suggest import suggest

__all__ = ["Mapping", "all_formats", "load_mapping", "read", "read_all", "suggest", "write"]

_HOME = {
    "Mapping": "mapping",
    "all_formats": "formats",
    "load_mapping": "mapping",
    "read": "files",
    "read_all": "files",
    "suggest": "suggest",
    "write": "files",
}


class _Package(ModuleType):
    """Keeps the submodule ``suggest``, once imported, from taking the place of the function."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package

__getattr__ = lazily(__name__, _HOME)
