"""A program as two kernels for a CPU, one after the other, which its compiler makes side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from typing import Any, ParamSpec, TypeVar, cast

import equinox as eqx
import jax
import jax.extend as jex
import jax.numpy as jnp
from jaxtyping import Array

from roadstate.core.kernel import equations, one_kernel, within
from roadstate.core.packing import Layout

P = ParamSpec("P")
R = TypeVar("R")

_WORTH = 2500
"""Equations from which on compiling takes so long that the second kernel's start, a few µs, is worth it."""
_MIDDLE = (0.4, 0.6)  # share of the work that may be in the first
_NEVER = 10**9  # numbers


def two_kernels(function: Callable[P, R]) -> Callable[P, R]:
    """As :func:`~roadstate.core.kernel.one_kernel`, but of a large program two.

    A compiler goes through a kernel alone, however many cores there are. The program is cut near its middle,
    where the least is to be handed over.

    Args:
        function: arrays, in any pytree, from arrays and others.
    """

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        if jax.default_backend() != "cpu":
            return function(*args, **kwargs)
        arrays, others = eqx.partition((args, kwargs), eqx.is_array)
        given, structure = jax.tree.flatten(arrays)
        result: Any = None

        def flat(*full: Array) -> list[Array]:
            nonlocal result
            inner, named = eqx.combine(jax.tree.unflatten(structure, full), others)
            out, result = jax.tree.flatten(function(*inner, **named))
            return out

        traced = jax.make_jaxpr(flat)(*given)
        return cast(R, jax.tree.unflatten(result, _run(traced, given)))

    return call


def _run(traced: Any, given: Sequence[Array]) -> list[Array]:
    """What a traced program makes of arrays, in a kernel or two."""
    program = traced.jaxpr
    cut = _cut(program)
    if cut is None:
        told: list[Array] = one_kernel(jex.core.jaxpr_as_fun(traced))(*given)
        return told
    known = dict(zip([*program.invars, *program.constvars], [*given, *traced.consts], strict=True))
    first, second = program.eqns[:cut], program.eqns[cut:]
    # all in the program's order: another one would be another program to whoever keeps compiled ones
    read = [_variables(v for eqn in eqns for v in eqn.invars) for eqns in (first, second)]
    outside = [[v for v in known if v in own] for own in read]
    wanted = _variables(program.outvars)
    handed = [v for eqn in first for v in eqn.outvars if v in read[1] or v in wanted]
    ends = [v for v in wanted if v not in known]
    layout: Layout

    def begin(arrays: list[Array]) -> dict[str, Array]:
        nonlocal layout
        values = _part(program, first, outside[0], handed)(*arrays)
        layout = Layout(values)
        return layout.pack(values)

    def end(arrays: list[Array], packed: dict[str, Array]) -> list[Array]:
        return _part(program, second, [*outside[1], *handed], ends)(*arrays, *layout.unpack(packed))

    packed = one_kernel(begin)([known[v] for v in outside[0]])
    known |= dict(zip(ends, one_kernel(end)([known[v] for v in outside[1]], packed), strict=True))
    return [known[v] if isinstance(v, jex.core.Var) else jnp.asarray(v.val) for v in program.outvars]


def _cut(program: Any) -> int | None:
    """Before which equation to cut; ``None`` where it is not worth it, or nowhere possible."""
    work = [1 + sum(1 for inner in within(eqn) for _ in equations(inner)) for eqn in program.eqns]
    total = left = sum(work)
    if total < _WORTH or program.effects:
        return None
    outside = {*program.invars, *program.constvars}
    # what is still to be read, and how many numbers that is
    alive = {v: _numbers(v) for v in _variables(program.outvars) if v not in outside}
    handed, least, best = sum(alive.values()), _NEVER, None
    for k in reversed(range(len(work))):
        eqn = program.eqns[k]
        handed -= sum(alive.pop(v, 0) for v in eqn.outvars)
        reads = {v: _numbers(v) for v in _variables(eqn.invars) if v not in outside and v not in alive}
        alive |= reads
        handed += sum(reads.values())
        left -= work[k]
        if _MIDDLE[0] * total <= left <= _MIDDLE[1] * total and handed < least:
            least, best = handed, k
    return best


def _numbers(variable: Any) -> int:
    """How many it holds; more than can be handed over of what is none, such as keys of random ones."""
    aval = variable.aval
    plain = any(jnp.issubdtype(aval.dtype, kind) for kind in (jnp.number, jnp.bool_))
    return int(aval.size) if plain else _NEVER


def _variables(atoms: Iterable[Any]) -> dict[Any, None]:
    """Which of them are no constants, in their order."""
    return {v: None for v in atoms if isinstance(v, jex.core.Var)}


def _part(program: Any, eqns: list[Any], given: list[Any], told: list[Any]) -> Callable[..., list[Array]]:
    """Some equations of a program as a function."""
    part = program.replace(constvars=[], invars=given, outvars=told, eqns=eqns)
    function: Callable[..., list[Array]] = jex.core.jaxpr_as_fun(jex.core.ClosedJaxpr(part, []))
    return function
