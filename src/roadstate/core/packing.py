"""A pytree as one vector per dtype, and back: what a compiled loop likes to carry."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from roadstate.core.kernel import once


class Layout:
    """Where each leaf of a pytree lies in its packed form.

    Packing is exact: leaves go by dtype, none is cast.

    Args:
        tree: any pytree of arrays, or of their shapes and dtypes.
    """

    def __init__(self, tree: Any) -> None:
        leaves, self._treedef = jax.tree.flatten(tree)
        self._slots: list[tuple[str, int, tuple[int, ...]]] = []
        self._sizes: dict[str, int] = {}
        for leaf in leaves:
            kind, size = str(jnp.result_type(leaf)), int(np.prod(jnp.shape(leaf)))
            start = self._sizes.get(kind, 0)
            self._slots.append((kind, start, jnp.shape(leaf)))
            self._sizes[kind] = start + size

    def pack(self, tree: Any) -> dict[str, Any]:
        """Dtype name → (size,) vector of the leaves with that dtype."""
        parts: dict[str, list[Any]] = {kind: [] for kind in self._sizes}
        # computed before they are joined: else each number of the joint vector asks which of them it is
        leaves = once([jnp.ravel(leaf) for leaf in jax.tree.leaves(tree)])
        for (kind, _, _), leaf in zip(self._slots, leaves, strict=True):
            parts[kind].append(leaf)
        # of that dtype, not of one that gives way: to a compiled program these are two
        return {kind: jnp.concatenate(vectors).astype(kind) for kind, vectors in parts.items()}

    def unpack(self, packed: dict[str, Any]) -> Any:
        """The pytree; leading axes of the vectors (a scan's time) stay in front of each leaf."""
        leaves = []
        for kind, start, shape in self._slots:
            vector = packed[kind]
            part = vector[..., start : start + int(np.prod(shape))]
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
