"""Vectors of one, four or five places at once: (3,) or (3, n), components first."""

from __future__ import annotations

import jax.numpy as jnp

from roadstate.tires.smooth import Numbers


def cross(a: Numbers, b: Numbers, axis: int = 0) -> Numbers:
    """a × b along the axis of components; a (3,) goes with every column of a (3, n)."""
    if axis == 0 and a.ndim != b.ndim:
        a, b = (v[:, None] if v.ndim == 1 else v for v in (a, b))
    a1, a2, a3 = jnp.moveaxis(a, axis, 0)
    b1, b2, b3 = jnp.moveaxis(b, axis, 0)
    return jnp.stack([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1], axis=axis)


def dot(a: Numbers, b: Numbers) -> Numbers:
    """a · b along the first axis; a (3,) goes with every column of a (3, n)."""
    if a.ndim != b.ndim:
        a, b = (v[:, None] if v.ndim == 1 else v for v in (a, b))
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def unit(a: Numbers) -> Numbers:
    """a/|a|; a is never zero where this is used."""
    return a / jnp.sqrt(dot(a, a))


def rotation(attitude: Numbers) -> Numbers:
    """(3, 3) matrix from body to world axes, for yaw, pitch and roll (rad) in that order (ISO 8855)."""
    (cy, cp, cr), (sy, sp, sr) = jnp.cos(attitude), jnp.sin(attitude)
    return jnp.stack(
        [
            jnp.stack([cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr]),
            jnp.stack([sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr]),
            jnp.stack([-sp, cp * sr, cp * cr]),
        ]
    )


def to_world(R: Numbers, v: Numbers) -> Numbers:
    """R v, for v (3,) or (3, n)."""
    if v.ndim == 1:
        return R[:, 0] * v[0] + R[:, 1] * v[1] + R[:, 2] * v[2]
    return dot(R.T[:, :, None], v[:, None, :])


def to_body(R: Numbers, v: Numbers) -> Numbers:
    """Rᵀ v, for v (3,) or (3, n)."""
    return to_world(R.T, v)


def attitude_rate(attitude: Numbers, rate: Numbers) -> Numbers:
    """Derivatives of yaw, pitch and roll from the rates about the body's axes, rad/s."""
    cp, sp = jnp.cos(attitude[1]), jnp.sin(attitude[1])
    cr, sr = jnp.cos(attitude[2]), jnp.sin(attitude[2])
    yaw = (sr * rate[1] + cr * rate[2]) / cp
    return jnp.stack([yaw, cr * rate[1] - sr * rate[2], rate[0] + sp * yaw])


def settled(*parts: Numbers) -> tuple[Numbers, ...]:
    """The same arrays, (N,) or (k, N), evaluated here and once.

    On a CPU the compiler fuses elementwise code into each of its uses and evaluates it anew in every one,
    sines and arc tangents too, and an optimisation barrier is gone before it does. A matrix product is a call
    of its own: one with the identity keeps what went before from being fused with what follows, and halves
    the time of a plant's step. The numbers are unchanged, as long as all are finite.
    """
    rows = jnp.concatenate([a if a.ndim == 2 else a[None] for a in parts])
    rows = jnp.eye(rows.shape[0], dtype=rows.dtype) @ rows
    result, start = [], 0
    for a in parts:
        count = a.shape[0] if a.ndim == 2 else 1
        part = rows[start : start + count]
        result.append(part if a.ndim == 2 else part[0])
        start += count
    return tuple(result)
