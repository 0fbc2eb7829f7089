"""roadstate: what the road does to a car, from the signals the car already has."""

from __future__ import annotations

from typing import TYPE_CHECKING

from roadstate.lazy import lazily

if TYPE_CHECKING:
    from roadstate.core import Estimates, InputError, Log, Recording, Validity

__version__ = "0.1.0"

__all__ = ["Estimates", "InputError", "Log", "Recording", "Validity", "__version__"]

# what the shared types need takes a third of a second to import, in which the command line could say nothing
__getattr__ = lazily(__name__, {name: "core" for name in __all__ if name != "__version__"})


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
