"""One kernel for a whole program of small operations, instead of a kernel for each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import wraps
from typing import Any, ParamSpec, TypeVar, cast

import equinox as eqx
import jax
import jax.extend as jex
import jax.numpy as jnp
from jax.experimental.xla_metadata import set_xla_metadata
from jaxtyping import Array, Float

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

_MARKS = {"xla_cpu_small_call": "true", "inlineable": "false"}

_OUTSIDE = {
    *("cholesky", "cholesky_update", "eig", "eigh", "geqp3", "geqrf", "hessenberg", "householder_product"),
    *("lu", "qr", "schur", "svd", "symmetric_product", "triangular_solve", "tridiagonal"),
    *("tridiagonal_solve", "approx_top_k", "fft", "sort", "top_k"),
    *("ffi_call", "io_callback", "pure_callback", "debug_callback", "debug_print"),
}
"""Primitives that XLA leaves to a library or to Python: a kernel cannot call them."""


def one_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """A function to be traced by ``jax.jit``, which XLA shall compile into a single kernel for a CPU.

    A filter's step is hundreds of operations on a few numbers each: to go from one kernel to the next takes
    longer than the work. XLA makes one kernel of a small loop by itself; the marks set here are its own.
    Where something in the function calls a library, or for another kind of device, it stays as it is.
    """

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        if jax.default_backend() != "cpu":
            return function(*args, **kwargs)
        arrays, others = eqx.partition((args, kwargs), eqx.is_array)
        leaves, structure = jax.tree.flatten(arrays)
        kept: Any = None  # of the result what is no array

        @jax.jit
        def whole(*full: Array) -> tuple[Float[Array, ""], Any]:
            nonlocal kept
            rest = iter(full)
            given = [next(rest) if a.size else jnp.zeros(a.shape, a.dtype) for a in leaves]
            inner, named = eqx.combine(jax.tree.unflatten(structure, given), others)
            result, kept = eqx.partition(function(*inner, **named), eqx.is_array)
            return _witness(full), result

        full = [a for a in leaves if a.size]
        # the call after it finds the program traced
        calls = {eqn.primitive.name for eqn in equations(whole.trace(*full).jaxpr)}
        if _OUTSIDE & calls:
            told = whole(*full)
        else:
            called = marked(whole, *full, **_MARKS)
            told = jax.lax.optimization_barrier(called)  # type: ignore[no-untyped-call]
        return cast(R, eqx.combine(told[1], kept))

    return call


def marked(jitted: Callable[..., R], *args: Any, **marks: str) -> R:
    """``jitted(*args)``, whose call XLA gets with these frontend attributes; for a CPU only."""
    leaves, structure = jax.tree.flatten(jitted(*args))
    if leaves and jax.default_backend() == "cpu":
        # what makes the first result is the call: so it is marked, not the operations within it
        leaves[0] = set_xla_metadata(leaves[0], **marks)  # type: ignore[no-untyped-call]
    return cast(R, jax.tree.unflatten(structure, leaves))


def once(tree: T) -> T:
    """The same values, computed once.

    Without this the compiler may fuse an expression into each of its uses and evaluate it anew for every
    element there, exponentials and roots included, which costs more than the fusion saves. (A barrier alone
    is gone before the compiler fuses; a call that it may not inline stays.)
    """
    kept: T = marked(_barrier, tree, inlineable="false")
    return kept


@jax.jit
def _barrier(tree: T) -> T:
    return cast(T, jax.lax.optimization_barrier(tree))  # type: ignore[no-untyped-call]


def _witness(leaves: tuple[Array, ...]) -> Float[Array, ""]:
    """Something that depends on every argument: XLA ends the process over a kernel that leaves one unread."""
    firsts = (a[(0,) * a.ndim].astype(jnp.float32) for a in leaves)
    return sum(firsts, jnp.zeros((), jnp.float32))


def equations(jaxpr: Any) -> Iterator[Any]:
    """Of a traced program, and of all that it calls."""
    for eqn in jaxpr.eqns:
        yield eqn
        for inner in within(eqn):
            yield from equations(inner)


def within(eqn: Any) -> list[Any]:
    """What an equation calls."""
    told = jax.tree.leaves(list(eqn.params.values()), is_leaf=_is_jaxpr)
    return [getattr(inner, "jaxpr", inner) for inner in told if _is_jaxpr(inner)]


def _is_jaxpr(value: object) -> bool:
    return isinstance(value, jex.core.Jaxpr | jex.core.ClosedJaxpr)
