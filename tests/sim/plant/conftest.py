"""A plane road, and helpers that all tests of plants share."""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from roadstate.sim.plant import Controls, Truth, multibody_plant
from roadstate.sim.plant.multibody import MultibodyPlant
from roadstate.sim.plant.rollout import open_loop
from roadstate.tires.base import as_leaf
from roadstate.vehicles import load_vehicle


class Point(NamedTuple):
    """The road at points."""

    x: Any
    y: Any
    z: Any
    heading: Any
    curvature: Any
    dz_ds: Any
    dz_dd: Any
    friction: Any


class Plane(eqx.Module):
    """z = slope·s + bank·d, straight or on a circle to the left; friction may differ left (d > 0) and right.

    One class for both, so that one program serves them.
    """

    slope: Float[Array, ""] = eqx.field(default=0.0, converter=as_leaf)
    bank: Float[Array, ""] = eqx.field(default=0.0, converter=as_leaf)
    left: Float[Array, ""] = eqx.field(default=0.9, converter=as_leaf)
    right: Float[Array, ""] = eqx.field(default=0.9, converter=as_leaf)
    curvature: Float[Array, ""] = eqx.field(default=0.0, converter=as_leaf)

    def at(self, s: Any, d: Any) -> Point:
        s, d = jnp.broadcast_arrays(jnp.asarray(s), jnp.asarray(d))
        o = jnp.zeros_like(s)
        heading = self.curvature * s
        half = heading / 2
        chord = s * jnp.sinc(half / jnp.pi)
        x, y = chord * jnp.cos(half) - d * jnp.sin(heading), chord * jnp.sin(half) + d * jnp.cos(heading)
        z = self.slope * s + self.bank * d
        friction = jnp.where(d > 0, self.left, self.right)
        return Point(x, y, z, heading, o + self.curvature, o + self.slope, o + self.bank, friction)


def circle(radius: float) -> Plane:
    """A level circle to the left."""
    return Plane(curvature=1 / radius)


@pytest.fixture(scope="session")
def car() -> MultibodyPlant:
    """The family car's plant."""
    return multibody_plant(load_vehicle("family-car"))


def samples(seconds: float, dt: float = 0.01) -> np.ndarray:
    """Times of the samples, s."""
    return np.arange(round(seconds / dt)) * dt


_CHUNK = 200


def drive(plant: Any, road: Any, state: Any, controls: Controls) -> tuple[Any, Truth]:
    """As :func:`open_loop` at 100 Hz, by chunks of one length, so that it is compiled once."""
    count = controls.throttle.shape[0]
    padded = -count % _CHUNK
    controls = jax.tree.map(lambda a: jnp.concatenate([a, jnp.repeat(a[-1:], padded, axis=0)]), controls)
    parts = []
    for i in range(0, count, _CHUNK):
        state, truth = open_loop(plant, road, state, jax.tree.map(lambda a, i=i: a[i : i + _CHUNK], controls))
        parts.append(truth)
    return state, jax.tree.map(lambda *a: np.concatenate(a)[:count], *parts)
