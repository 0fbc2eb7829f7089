"""Opening MDF files with asammdf so that whatever goes wrong in it comes out as one line."""

from __future__ import annotations

import contextlib
import gc
import io
import logging
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from roadstate.core import InputError

_MEND = "copy it again from the logger"
_VIRTUAL_TYPES = (3, 6)
_FLAG_INVALIDATION = 2
_MAX_PACKING = 1100
_SMALLEST = 64 + 104  # bytes of the identification and the header block


def require_asammdf(where: str) -> Any:
    """The module asammdf.

    Raises:
        InputError: it is not installed.
    """
    try:
        import asammdf
    except ImportError as error:
        raise InputError("MF4 files need asammdf", where=where, mend="install 'roadstate[mdf]'") from error
    return asammdf


@contextlib.contextmanager
def guarded(path: Path) -> Iterator[Path]:
    """A temporary folder for asammdf's copies, and silence: what it raises becomes one ``InputError``.

    On a damaged file asammdf raises anything from ``struct.error`` to ``ValueError``, prints tracebacks and
    fails again in its finalisers; all of that is kept from the user's terminal.

    Raises:
        InputError: the block raised anything.
    """
    problem = ""
    logger = logging.getLogger("asammdf")
    level, unraisable = logger.level, sys.unraisablehook
    try:
        with tempfile.TemporaryDirectory(prefix="roadstate-") as folder:
            logger.setLevel(logging.CRITICAL + 1)
            sys.unraisablehook = lambda _: None
            try:
                with (
                    contextlib.redirect_stdout(io.StringIO()),
                    warnings.catch_warnings(action="ignore"),
                    np.errstate(all="ignore"),
                ):
                    yield Path(folder)
            except InputError:
                raise
            except Exception as error:
                problem = " ".join(str(error).split())[:120] or type(error).__name__
                # asammdf's half-built objects end here, where their finalisers are not heard
                traceback.clear_frames(error.__traceback__)
                gc.collect()
    finally:
        logger.setLevel(level)
        sys.unraisablehook = unraisable
    if problem:
        raise InputError(
            f"the MDF file is damaged or cut short (asammdf: {problem})", where=str(path), mend=_MEND
        )


def open_mdf(path: Path, folder: Path) -> Any:
    """Open an MDF4 file for reading inside :func:`guarded`.

    Args:
        path: the file.
        folder: where asammdf may put its copy of a file that was not finalised.

    Raises:
        InputError: another MDF version, or data that end before the file says they do.
    """
    asammdf = require_asammdf(str(path))
    size = path.stat().st_size
    if size < _SMALLEST:
        raise InputError("the MDF file is cut short", where=str(path), mend=_MEND)
    with path.open("rb") as stream:
        version = stream.read(12)[8:].decode("latin-1").strip(" \0")
    if not version.startswith("4."):
        raise InputError(
            f"MDF version {version or '?'} is not read", where=str(path), mend="convert it to MDF 4"
        )
    # bus logging would be read here already, before the channels' places can be checked
    mdf: Any = asammdf.MDF(
        path, temporary_folder=str(folder), raise_on_multiple_occurrences=False, process_bus_logging=False
    )
    for group in mdf.groups:
        if problem := _unsound(group, size):
            mdf.close()
            raise InputError(problem, where=str(path), mend=_MEND)
    return mdf


def _unsound(group: Any, size: int) -> str | None:
    """What is wrong with a channel group, whose numbers asammdf's compiled parts would trust."""
    record = group.channel_group
    if not record.cycles_nr:
        return None
    blocks = list(group.get_data_blocks())
    # deflate packs at most 1032 to 1, and nothing is packed to less than it says
    if any(int(b.original_size) > _MAX_PACKING * int(b.compressed_size) for b in blocks):
        return "the MDF file is damaged (a data block of impossible size)"
    ends = [int(b.address) + int(b.compressed_size) for b in blocks if not b.location]
    needed = record.cycles_nr * (record.samples_byte_nr + record.invalidation_bytes_nr)
    if max(ends, default=0) > size or needed > sum(int(b.original_size) for b in blocks):
        return "the MDF file is cut short"
    for channel in group.channels:
        is_stored = channel.channel_type not in _VIRTUAL_TYPES
        end = 8 * channel.byte_offset + channel.bit_offset + channel.bit_count
        has_flag = channel.flags & _FLAG_INVALIDATION
        if (is_stored and end > 8 * record.samples_byte_nr) or (
            has_flag and channel.pos_invalidation_bit >= 8 * record.invalidation_bytes_nr
        ):
            return f"the MDF file is damaged (channel {channel.name[:40]} lies outside its record)"
    return None
