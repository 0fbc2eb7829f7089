"""A stream on disk: arrays in an ``.npz`` file, with a fingerprint of the estimator they belong to."""

from __future__ import annotations

import hashlib
import json
import math
import struct
import tokenize
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from numpy.typing import NDArray

from roadstate.core import InputError
from roadstate.core.tabular import atomic_path
from roadstate.estimators.base import Estimator

_FORMAT = 2
_LONGEST_HEADER = 1 << 20
_NOT_ONE = "not a saved stream, or a damaged one"
_AGAIN = "save it again from a running stream"
# whatever a damaged archive makes zipfile and numpy raise
_DAMAGE = (
    OSError,
    KeyError,
    ValueError,
    OverflowError,
    EOFError,
    RuntimeError,
    SyntaxError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
)


class Saved(NamedTuple):
    """A stream's memory as arrays.

    Attributes:
        time: (k + 1,) s: of the state before the window (NaN for none), then of the k samples in it.
        values: (k, c) the samples.
        states: dtype name → (k + 1, size) packed states after each.
        counts: (a + 1,) samples by how they arrived, and values replaced.
    """

    time: NDArray[np.float64]
    values: NDArray[np.float64]
    states: dict[str, NDArray[Any]]
    counts: NDArray[np.int64]


def save(path: str | Path, estimator: Estimator[Any], saved: Saved) -> Path:
    """Write a stream's memory.

    Args:
        path: of the file, which appears whole or not at all.
        estimator: that it belongs to.
        saved: the memory.

    Raises:
        InputError: the folder does not exist or cannot be written.
    """
    header = json.dumps({"format": _FORMAT, **_fingerprint(estimator)}).encode()
    arrays = {f"state_{kind}": vectors for kind, vectors in saved.states.items()}
    arrays |= {"time": saved.time, "values": saved.values, "counts": saved.counts}
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, header=np.frombuffer(header, np.uint8), **arrays)  # type: ignore[arg-type]
    return Path(path)


def load(path: str | Path, estimator: Estimator[Any], sizes: dict[str, int], counts: int) -> Saved:
    """Read what :func:`save` wrote for the same estimator; nothing in the file is executed or trusted.

    Args:
        path: of the file.
        estimator: that is to go on.
        sizes: dtype name → length of its packed state.
        counts: how many there are.

    Raises:
        InputError: no such file, not one of a stream, or one of another estimator.
    """
    where = str(path)
    if not Path(path).is_file():
        raise InputError("no such file", where=where, mend="check the path")
    damaged = InputError(_NOT_ONE, where=where, mend=_AGAIN)
    try:
        with zipfile.ZipFile(path) as archive:
            header = json.loads(bytes(_member(archive, "header", np.dtype(np.uint8), _LONGEST_HEADER)))
            if not isinstance(header, dict) or header.get("format") != _FORMAT:
                raise damaged
            _compare(header, _fingerprint(estimator), where)
            time = _member(archive, "time", np.dtype(np.float64))
            values = _member(archive, "values", np.dtype(np.float64))
            states = {kind: _member(archive, f"state_{kind}", np.dtype(kind)) for kind in sizes}
            counted = _member(archive, "counts", np.dtype(np.int64))
    except InputError:
        raise
    except (*_DAMAGE, RecursionError) as error:
        raise damaged from error
    kept = len(time) - 1
    shapes = time.ndim == 1 and kept >= 0 and values.shape == (kept, len(estimator.channels))
    shapes = shapes and all(states[kind].shape == (kept + 1, size) for kind, size in sizes.items())
    ordered = np.all(np.isfinite(time[1:])) and not np.isinf(time[:1]).any()
    ordered = ordered and not np.any(np.diff(time) <= 0)  # NaN before the first is fine
    if not (shapes and ordered and counted.shape == (counts,) and np.all(counted >= 0)):
        raise damaged
    return Saved(time, values, states, counted)


def _member(
    archive: zipfile.ZipFile, name: str, dtype: np.dtype[Any], limit: int | None = None
) -> NDArray[Any]:
    """An array of the archive, whose header must fit the bytes there before any memory is taken for it."""
    info = archive.getinfo(f"{name}.npy")
    if info.compress_type != zipfile.ZIP_STORED or (limit is not None and info.file_size > limit):
        raise ValueError(name)
    with archive.open(info) as file:
        if np.lib.format.read_magic(file) != (1, 0):
            raise ValueError(name)
        shape, fortran, found = np.lib.format.read_array_header_1_0(file)
        size = math.prod(shape) * dtype.itemsize
        if fortran or found != dtype or size != info.file_size - file.tell():
            raise ValueError(name)
        return np.frombuffer(file.read(), dtype).reshape(shape)


def _fingerprint(estimator: Estimator[Any]) -> dict[str, Any]:
    """What a state belongs to: the estimator's name and channels, its state's shape, its parameters."""
    params, static = eqx.partition(estimator, eqx.is_array)
    parameters = hashlib.sha256(eqx.tree_pformat(static).encode())
    for leaf in jax.tree.leaves(params):
        array = np.asarray(leaf)
        parameters.update(f"{array.dtype.str} {array.shape}".encode() + array.tobytes())
    shape = eqx.tree_pformat(eqx.filter_eval_shape(estimator.init))
    return {
        "estimator": estimator.name,
        "channels": list(estimator.channels),
        "state": hashlib.sha256(shape.encode()).hexdigest(),
        "parameters": parameters.hexdigest(),
    }


def _compare(header: dict[str, Any], own: dict[str, Any], where: str) -> None:
    """Refuse a file of another estimator, saying in what it is another."""
    for key, what, mend in (
        ("estimator", "saved from the estimator {!r}, not {!r}", "restore it into a stream of that one"),
        ("channels", "saved with the channels {}, not {}", "build the estimator for the same channels"),
        ("state", "the estimator's state has another shape than this version's", _AGAIN),
        ("parameters", "saved with other parameters", "use the same vehicle and options as then"),
    ):
        if header.get(key) != own[key]:
            raise InputError(what.format(header.get(key), own[key]), where=where, mend=mend)
