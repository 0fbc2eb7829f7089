"""A pytree as one vector per dtype of numbers, and back: what a compiled loop likes to carry."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from roadstate.core.kernel import once


class _Slot(NamedTuple):
    """A leaf's place.

    Attributes:
        kind: which vector.
        start, stop: from where to where there.
        shape, dtype: the leaf's.
        is_bits: whether it goes there bit by bit.
    """

    kind: str
    start: int
    stop: int
    shape: tuple[int, ...]
    dtype: str
    is_bits: bool


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
        self._slots: list[_Slot] = []
        self._sizes: dict[str, int] = {}
        for leaf in leaves:
            dtype, shape = str(jnp.result_type(leaf)), jnp.shape(leaf)
            is_whole = jnp.issubdtype(dtype, jnp.integer) or jnp.issubdtype(dtype, jnp.bool_)
            kind = str(jnp.result_type(float)) if is_whole else dtype
            start = self._sizes.get(kind, 0)
            stop = self._sizes[kind] = start + int(np.prod(shape))
            self._slots.append(_Slot(kind, start, stop, shape, dtype, bool(is_whole)))

    def pack(self, tree: Any) -> dict[str, Any]:
        """Dtype name → (size,) vector of the leaves that go with that dtype."""
        parts: dict[str, list[Any]] = {kind: [] for kind in self._sizes}
        # computed before they are joined: else each number of the joint vector asks which of them it is
        leaves = once([jnp.ravel(leaf) for leaf in jax.tree.leaves(tree)])
        for slot, leaf in zip(self._slots, leaves, strict=True):
            parts[slot.kind].append(_as_bits(leaf) if slot.is_bits else leaf)
        # of that dtype, not of one that gives way: to a compiled program these are two
        return {kind: jnp.concatenate(vectors).astype(kind) for kind, vectors in parts.items()}

    def unpack(self, packed: dict[str, Any]) -> Any:
        """The pytree; leading axes of the vectors (a scan's time) stay in front of each leaf.

        Of NumPy's arrays it is made of NumPy's.
        """
        leaves = []
        for kind, start, stop, shape, dtype, is_bits in self._slots:
            vector = packed[kind]
            if shape or not isinstance(vector, np.ndarray):
                part = vector[..., start:stop].reshape(vector.shape[:-1] + shape)
            else:  # a stream waits for it
                part = vector[..., start]
            leaves.append(_from_bits(part, dtype) if is_bits else part)
        return jax.tree.unflatten(self._treedef, leaves)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Layout):
            return NotImplemented
        return self._slots == other._slots and bool(self._treedef == other._treedef)  # type: ignore[operator]

    def __repr__(self) -> str:
        return f"Layout({self._slots})"

    def __hash__(self) -> int:
        return hash((tuple(self._slots), self._treedef))


def _as_bits(leaf: Array) -> Array:
    """Whole numbers as the floating-point numbers that have their bits."""
    return jax.lax.bitcast_convert_type(leaf.astype(jnp.result_type(int)), jnp.result_type(float))


def _from_bits(part: Any, dtype: str) -> Any:
    if isinstance(part, np.ndarray):
        return part.view(f"i{part.itemsize}").astype(dtype)
    return jax.lax.bitcast_convert_type(part, jnp.result_type(int)).astype(dtype)
