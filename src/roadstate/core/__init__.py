"""The shared types. Importing this package does not import JAX."""

from roadstate.core.channels import CHANNELS, WHEELS, Channel, channel
from roadstate.core.errors import InputError
from roadstate.core.estimates import Estimates, Validity
from roadstate.core.joining import join
from roadstate.core.log import Log
from roadstate.core.quantities import QUANTITIES, REFERENCES, is_bound, reference
from roadstate.core.signals import Recording, Signal

__all__ = [
    "CHANNELS",
    "QUANTITIES",
    "REFERENCES",
    "WHEELS",
    "Channel",
    "Estimates",
    "InputError",
    "Log",
    "Recording",
    "Signal",
    "Validity",
    "channel",
    "is_bound",
    "join",
    "reference",
]
