"""roadstate: what the road does to a car, from the signals the car already has."""

from __future__ import annotations

from roadstate.core import Estimates, InputError, Log, Recording, Validity

__version__ = "0.1.0"

__all__ = ["Estimates", "InputError", "Log", "Recording", "Validity", "__version__"]
