"""The parameters of a model by dotted name: ``mass``, ``friction``, ``tire.cornering_stiffness``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import ArrayLike

from roadstate.core.channels import did_you_mean
from roadstate.core.errors import InputError

T = TypeVar("T")


def named_leaves(tree: Any) -> dict[str, Any]:
    """Every array leaf of a pytree, by the dotted path to it."""
    return {_dotted(path): leaf for path, leaf in jax.tree_util.tree_flatten_with_path(tree)[0]}


def with_leaves(tree: T, values: Mapping[str, ArrayLike]) -> T:
    """The same pytree with some leaves replaced.

    Args:
        tree: any pytree of arrays.
        values: dotted name → new value; it is broadcast to the leaf's shape, so that one number serves four
            wheels, and four numbers may take the place of one.

    Raises:
        InputError: there is no such leaf, or the value's shape does not go with the leaf's.
    """
    paths, structure = jax.tree_util.tree_flatten_with_path(tree)
    names = [_dotted(path) for path, _ in paths]
    for name in values:
        check_name(name, names, f"{type(tree).__name__} has no parameter")
    leaves = [_fit(name, values, leaf) for name, (_, leaf) in zip(names, paths, strict=True)]
    result: T = jax.tree_util.tree_unflatten(structure, leaves)
    return result


def check_name(name: str, known: Any, complaint: str) -> None:
    """Refuse a name that is not among the known ones, naming the closest.

    Raises:
        InputError: ``complaint 'name'``.
    """
    if name not in known:
        raise InputError(f"{complaint} '{name}'", mend=did_you_mean(name, known))


def _fit(name: str, values: Mapping[str, ArrayLike], leaf: Any) -> Any:
    if name not in values:
        return leaf
    value = jnp.asarray(values[name])
    if not jnp.issubdtype(value.dtype, jnp.inexact):
        value = value.astype(jnp.result_type(float))
    try:
        return jnp.broadcast_to(value, jnp.broadcast_shapes(value.shape, jnp.shape(leaf)))
    except ValueError:
        raise InputError(
            f"a value of shape {value.shape} where the parameter has shape {jnp.shape(leaf)}",
            where=name,
            mend="give one number, or one for each wheel (fl, fr, rl, rr)",
        ) from None


def _dotted(path: tuple[Any, ...]) -> str:
    return ".".join(str(getattr(key, "name", getattr(key, "key", getattr(key, "idx", key)))) for key in path)
