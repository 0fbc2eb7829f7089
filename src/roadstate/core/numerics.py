"""How JAX is set up for the whole package. Imported before any array is made."""

from __future__ import annotations

import os
import re
import time
import zlib
from collections.abc import Callable, Hashable
from contextlib import suppress
from functools import cache, wraps
from pathlib import Path
from threading import Lock
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp

from roadstate.core import traced
from roadstate.core.kernel import one_kernel

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

# names of what the cache's folder holds: compiled, traced, begun
_KEPT = re.compile(r"[0-9a-f]{64}(-cache|\.traced|\.\d+\.part)$")
_MONTHS = 90 * 86400.0  # s

LOOP_OPTIONS: dict[str, bool | str | int] = {
    # a step over small arrays has nothing worth running in parallel; the attempt doubles its time
    "xla_cpu_scheduler_type": "CPU_SCHEDULER_TYPE_MEMORY_OPTIMIZED",
    "xla_cpu_multi_thread_eigen": False,
    # fusion emitters serve large arrays: without them such a loop compiles in half the time
    "xla_cpu_use_fusion_emitters": False,
    # XLA's library for products has no place within one kernel, and several at once may wait for ever
    "xla_cpu_experimental_ynn_fusion_type": "",
    # what the compiler does beyond this takes a third of its time and gains a step nothing
    "xla_backend_optimization_level": 1,
    # a bank of 32 hypotheses is two of the widest vectors there are; a processor without them takes its own
    "xla_cpu_prefer_vector_width": 512,
}
"""XLA's, for programs of many operations on small arrays."""

# XLA's factorisations wait, on a thread of its pool, for others of that pool. When several programs run at
# once (run.batch has two a core) and each waits like this, a pool of one thread a program has none left: all
# wait for ever.
os.environ.setdefault("NPROC", str(4 * (os.cpu_count() or 1)))

# float64 is the default here: a grade from two nearly equal accelerations wants the digits. Whoever sets
# JAX_ENABLE_X64 decides for themselves.
if "JAX_ENABLE_X64" not in os.environ:
    jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call]


def jit_loop(function: Callable[P, R], *, whole: bool = True, kept: bool = False) -> Callable[P, R]:
    """``equinox.filter_jit`` for a function that is one long loop over small arrays.

    On a CPU such a loop would spend most of its time going from one tiny kernel to the next. So it becomes
    one kernel as a whole, unless something in it calls a library.

    Args:
        function: the loop.
        whole: make it one kernel; without, the function marks by itself what shall be one
            (:func:`roadstate.core.kernel.one_kernel`).
        kept: keep what it was traced to for the next process (:mod:`roadstate.core.traced`). It must return
            nothing but arrays, in tuples, dicts and named tuples that are
            :func:`~roadstate.core.traced.returned`.
    """
    looped = one_kernel(function) if whole else function

    asked = Lock()
    begun: dict[Hashable, Lock] = {}
    programs: dict[Hashable, Callable[P, R]] = {}

    @cache
    def compiled(options: tuple[tuple[str, bool | str | int], ...]) -> Callable[P, R]:
        jitted: Callable[P, R] = eqx.filter_jit(looped, compiler_options=dict(options))  # type: ignore[call-overload]
        return jitted

    within: Callable[P, R] = eqx.filter_jit(function)

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        leaves, structure = jax.tree.flatten((args, kwargs))
        # inside another transformation, whose options hold and whose compiler refuses to be given more
        if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
            return within(*args, **kwargs)
        # at a call, not at import: knowing the options starts a backend
        options = tuple(loop_options().items())
        key = options, structure, tuple((x.shape, x.dtype) if hasattr(x, "dtype") else x for x in leaves)
        if key not in programs:
            with asked:
                usual, first = compiled(options), begun.setdefault(key, Lock())
            with first:  # threads that come at once shall wait for one program, not compile one each
                if key not in programs:
                    program = usual
                    if kept:
                        program = traced.recalled(looped, dict(options), *args, **kwargs) or usual
                    result = program(*args, **kwargs)
                    programs[key] = program
                    return result
        return programs[key](*args, **kwargs)

    return call


def loop_options() -> dict[str, bool | str | int]:
    """For ``compiler_options``: what suits programs of many operations on small arrays, on this backend."""
    return {k: v for k, v in LOOP_OPTIONS.items() if jax.default_backend() == "cpu" and _is_known(k, v)}


@cache
def _is_known(name: str, value: bool | str | int) -> bool:
    try:
        jax.jit(lambda: 0, compiler_options={name: value})()
    except jax.errors.JaxRuntimeError:
        return False
    return True


def in_single(tree: T) -> T:
    """The same, its arrays of floating-point numbers in single precision: half the work where they are many.

    For what loses no digits: no sums over a whole drive, no differences of nearly equal numbers.
    """
    return _in(jnp.float32, tree)


def in_default(tree: T) -> T:
    """The same, its arrays of floating-point numbers in the precision that arrays have when they are made."""
    return _in(jnp.result_type(float), tree)


def _in(dtype: Any, tree: T) -> T:
    cast: T = jax.tree.map(lambda leaf: leaf.astype(dtype) if eqx.is_inexact_array(leaf) else leaf, tree)
    return cast


def use_compilation_cache(folder: str | Path | None = None, *, traces: bool = True) -> Path | None:
    """Keep compiled programs on disk, so that only a program's first run ever waits for the compiler.

    Args:
        folder: where; default ``$ROADSTATE_CACHE``, else ``roadstate`` in the user's cache folder. An empty
            ``$ROADSTATE_CACHE`` turns the cache off.
        traces: keep also what estimators' steps were traced to. Not for a process that changes what the
            package's modules hold, to see what comes of it.

    Returns:
        The folder in use, or ``None`` where the cache is off or the folder cannot be made.
    """
    chosen = folder if folder is not None else os.environ.get("ROADSTATE_CACHE", _default_folder())
    if not str(chosen):
        return None
    path = Path(chosen)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    with suppress(OSError):  # a folder that others fill and this user may only read
        _tidy(path)
    jax.config.update("jax_compilation_cache_dir", str(path))  # type: ignore[no-untyped-call]
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)  # type: ignore[no-untyped-call]
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)  # type: ignore[no-untyped-call]
    traced.folder = path if traces else None
    return path


def _tidy(folder: Path) -> None:
    """Remove programs that were not written to their end, by a full disk or a process that was killed.

    JAX would complain of each in every run, compile it again and never write it anew. What is older than the
    last look has been looked at. Files that nothing has read for months go, too, as those of older versions.
    """
    looked = folder / "looked-through"
    last = looked.stat().st_mtime_ns if looked.exists() else 0
    if folder.stat().st_mtime_ns < last:
        return
    looked.touch()
    for entry in folder.iterdir():
        about = entry.stat()
        unused = _KEPT.search(entry.name) and time.time() - max(about.st_atime, about.st_mtime) > _MONTHS
        torn = entry.match("*-cache") and about.st_mtime_ns >= last and not _is_whole(entry.read_bytes())
        if unused or torn:
            entry.unlink(missing_ok=True)


def _is_whole(program: bytes) -> bool:
    """Whether a compressed program has its end; what is not compressed by zlib is taken for whole."""
    if program[:1] != b"\x78":
        return bool(program)
    reader = zlib.decompressobj()
    try:
        reader.decompress(program)
    except zlib.error:
        return False
    return reader.eof


def _default_folder() -> str:
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return str(Path(base) / "roadstate" / "jax")
