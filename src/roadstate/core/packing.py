"""A pytree as one vector per dtype of numbers, and back: what a compiled loop likes to carry."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from roadstate.core.kernel import once


class Layout:
    """Where each leaf of a pytree lies in its packed form.

    Packing is exact: leaves of floating-point numbers go by dtype, none is cast. Integers and truth values go
    with the default one, bit by bit: each vector less is a copy and a kernel less in a loop, or an array less
    to hand over, and there are few of them.

    Args:
        tree: any pytree of arrays, or of their shapes and dtypes.
    """

    def __init__(self, tree: Any) -> None:
        leaves, self._treedef = jax.tree.flatten(tree)
        self._slots: list[tuple[str, int, tuple[int, ...], str]] = []
        self._sizes: dict[str, int] = {}
        for leaf in leaves:
            dtype, size = str(jnp.result_type(leaf)), int(np.prod(jnp.shape(leaf)))
            kind = str(jnp.result_type(float)) if _is_whole(dtype) else dtype
            start = self._sizes.get(kind, 0)
            self._slots.append((kind, start, jnp.shape(leaf), dtype))
            self._sizes[kind] = start + size

    def pack(self, tree: Any) -> dict[str, Any]:
        """Dtype name → (size,) vector of the leaves that go with that dtype."""
        parts: dict[str, list[Any]] = {kind: [] for kind in self._sizes}
        # computed before they are joined: else each number of the joint vector asks which of them it is
        leaves = once([jnp.ravel(leaf) for leaf in jax.tree.leaves(tree)])
        for (kind, _, _, dtype), leaf in zip(self._slots, leaves, strict=True):
            parts[kind].append(_as_bits(leaf) if _is_whole(dtype) else leaf)
        # of that dtype, not of one that gives way: to a compiled program these are two
        return {kind: jnp.concatenate(vectors).astype(kind) for kind, vectors in parts.items()}

    def unpack(self, packed: dict[str, Any]) -> Any:
        """The pytree; leading axes of the vectors (a scan's time) stay in front of each leaf."""
        leaves = []
        for kind, start, shape, dtype in self._slots:
            vector = packed[kind]
            part = vector[..., start : start + int(np.prod(shape))]
            part = _from_bits(part, dtype) if _is_whole(dtype) else part
            leaves.append(part.reshape(vector.shape[:-1] + shape))
        return jax.tree.unflatten(self._treedef, leaves)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Layout):
            return NotImplemented
        return self._slots == other._slots and bool(self._treedef == other._treedef)  # type: ignore[operator]

    def __repr__(self) -> str:
        return f"Layout({self._slots})"

    def __hash__(self) -> int:
        return hash((tuple(self._slots), self._treedef))


def _is_whole(dtype: str) -> bool:
    """Whether of integers or truth values; not of floating-point numbers, nor of random keys."""
    return bool(jnp.issubdtype(dtype, jnp.integer) or jnp.issubdtype(dtype, jnp.bool_))


def _as_bits(leaf: Array) -> Array:
    """Whole numbers as the floating-point numbers that have their bits."""
    return jax.lax.bitcast_convert_type(leaf.astype(jnp.result_type(int)), jnp.result_type(float))


def _from_bits(part: Array, dtype: str) -> Array:
    return jax.lax.bitcast_convert_type(part, jnp.result_type(int)).astype(dtype)
