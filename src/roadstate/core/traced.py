"""Traced programs on disk, beside the compiled ones.

A compiled program is found again by what was traced, and to trace the thousands of operations of an
estimator's step takes Python seconds, in each process anew. So what came of it is kept, as StableHLO by
``jax.export``, under a name that follows from all it depends on: this package's sources, the versions of what
traces them, JAX's settings, and the arguments' structure and shapes.
"""

from __future__ import annotations

import hashlib
import inspect
import os
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax import export
from jaxtyping import PyTree

P = ParamSpec("P")
R = TypeVar("R")
Kind = TypeVar("Kind", bound=type)

folder: Path | None = None
"""Where they are kept; ``None``: nowhere, and every program is traced."""

_PACKAGE = __name__.split(".")[0]
_SIGNED = hashlib.sha256().digest_size
_ELSEWHERE = " at 0x"  # in what Python says of things that have no other name than where they lie in memory


def returned(kind: Kind) -> Kind:
    """A decorator: programs that are kept may return this named tuple, which is known on disk by its name."""
    export.register_namedtuple_serialization(kind, serialized_name=f"{kind.__module__}.{kind.__qualname__}")
    return kind


def recalled(
    function: Callable[P, R],
    options: dict[str, Any],
    *args: P.args,
    **kwargs: P.kwargs,
) -> Callable[P, R] | None:
    """A function compiled for arguments like these, by what it was traced to: before, or now for next time.

    Args:
        function: this package's; of arrays it returns nothing but arrays, in tuples, dicts and named tuples
            that are :func:`returned`.
        options: the compiler's.
        args, kwargs: of its first call.

    Returns:
        The program, or ``None`` where it cannot be kept: no folder is set, it is for another device than a
        CPU, something in it comes from elsewhere, whose source may be another one the next time, or nobody
        has said how to write down what it returns.
    """
    if folder is None or jax.default_backend() != "cpu" or jax.config.values["jax_disable_jit"]:
        return None
    told = _description(function, (args, kwargs))
    if told is None:
        return None
    path = folder / f"{hashlib.sha256(told.encode()).hexdigest()}.traced"
    exported = _read(path)
    if exported is None:
        arrays, others = eqx.partition((args, kwargs), eqx.is_array)
        leaves, structure = jax.tree.flatten(arrays)

        def flat(leaves: list[Any]) -> R:
            inner, named = eqx.combine(jax.tree.unflatten(structure, leaves), others)
            return function(*inner, **named)

        try:
            exported = export.export(jax.jit(flat))(leaves)
            written = exported.serialize()
        except ValueError:  # it calls a library in a way that another version may not have, or returns others
            return None
        _write(path, written)
    # compiled here, so that one program will do: its results are bound to a device, its first arguments not
    program = jax.jit(exported.call, compiler_options=options).lower(_arrays(args, kwargs)).compile()

    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        result: R = program(_arrays(args, kwargs))
        return result

    return call


def _arrays(*arguments: PyTree) -> list[Any]:
    return [leaf for leaf in jax.tree.leaves(arguments) if eqx.is_array(leaf)]


def _read(path: Path) -> Any:
    """What was kept; ``None`` where there is nothing, or not all of it."""
    try:
        kept = path.read_bytes()
    except OSError:
        return None
    sign, traced = kept[:_SIGNED], kept[_SIGNED:]
    if sign != hashlib.sha256(traced).digest():
        return None
    return export.deserialize(bytearray(traced))


def _write(path: Path, traced: bytearray) -> None:
    """Keep it, whole or not at all; a folder that is full or may only be read is no error."""
    part = path.with_suffix(f".{os.getpid()}.part")
    try:
        part.write_bytes(hashlib.sha256(traced).digest() + traced)
        part.replace(path)
    except OSError:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _description(function: Callable[..., Any], arguments: PyTree) -> str | None:
    """All that a trace depends on; ``None`` where that cannot be told."""
    leaves, structure = jax.tree.flatten(arguments)
    words = [_told(function), _settings(), *_versions(), _shape(structure), *map(_told, leaves)]
    told = "\n".join(words)
    return None if _ELSEWHERE in told else told


def _shape(structure: Any) -> str:
    """A tree's structure, with what its nodes hold that is no leaf."""
    node = structure.node_data()
    if node is None:
        return "*"
    kind, data = node
    name = f"{kind.__module__}.{kind.__qualname__}" if _is_known(kind) else _ELSEWHERE
    return f"{name} {_told(data)} ({', '.join(map(_shape, structure.children()))})"


def _is_known(thing: Any) -> bool:
    return thing.__module__.split(".")[0] in (_PACKAGE, "builtins")


def _told(value: Any) -> str:
    """What of a value a trace depends on; with :data:`_ELSEWHERE` where that is not only this package."""
    if isinstance(value, jax.Array):
        return f"{value.dtype}{value.shape}{value.weak_type}"
    if isinstance(value, np.ndarray | np.generic):  # whose numbers might be in the trace
        return _ELSEWHERE
    if isinstance(value, partial):
        return f"{_told(value.func)} {_told(value.args)} {value.keywords!r}"
    if isinstance(value, tuple | list):
        return f"({', '.join(map(_told, value))})"
    if inspect.isfunction(value) and _is_known(value) and "<" not in value.__qualname__:
        return f"{value.__module__}.{value.__qualname__} by {value.__code__.co_qualname}"
    return repr(value)


def _settings() -> str:
    """JAX's, but where it keeps compiled programs."""
    kept = {k: v for k, v in jax.config.values.items() if not k.startswith("jax_compilation_cache")}
    return repr(sorted(kept.items()))


@cache
def _versions() -> tuple[str, ...]:
    """Of the package, by its sources, and of what traces them."""
    digest = hashlib.sha256()
    root = Path(__file__).parent.parent
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest(), *(version(name) for name in ("jax", "jaxlib", "equinox", "numpy"))
