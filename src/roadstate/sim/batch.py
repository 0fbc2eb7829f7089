"""Many drives at once: the same loop for a batch of plants, roads and manoeuvres."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from roadstate.core import InputError
from roadstate.core.numerics import jit_loop
from roadstate.sim.manoeuvres.base import Manoeuvre
from roadstate.sim.manoeuvres.driver import Driver
from roadstate.sim.plant.base import Controls, Plant
from roadstate.sim.run import CONTROL_STEP, Drive, checked, common_driver, looks

if TYPE_CHECKING:
    from roadstate.vehicles import Vehicle

_CHUNK = 100  # looks in one compiled loop: what is driven beyond the end is driven by all


@jit_loop
def _start(plants: Any, drivers: Any, axes: Any, places: Any) -> Any:
    def one(plant: Plant, driver: Driver, place: Any) -> Any:
        return plant.init(driver.road, *place), driver.init(), Controls.make()

    return eqx.filter_vmap(one, in_axes=(*axes, 0))(plants, drivers, places)


@jit_loop
def _roll(plants: Any, drivers: Any, axes: Any, carry: Any, first: Any) -> Any:
    def one(plant: Plant, driver: Driver, carry: Any) -> Any:
        return looks(plant, driver, carry, first, _CHUNK, 1)

    return eqx.filter_vmap(one, in_axes=(*axes, 0))(plants, drivers, carry)


def drive_many(plants: Sequence[Plant], manoeuvres: Sequence[Manoeuvre], vehicle: Vehicle) -> list[Drive]:
    """Drive plants and manoeuvres pair by pair, at 100 rows per second; one of either serves all.

    What differs between them (a mass, a friction, a path) is batched, the rest is shared.

    Args:
        plants: of one kind.
        manoeuvres: on roads with as many friction edges and of about the same length; a shorter one is driven
            on with its last cue and cut.
        vehicle: what the drivers know of the car.

    Raises:
        InputError: numbers that do not go together, plants or roads of different kinds, or a drive whose
            truth is not finite.
    """
    count = max(len(plants), len(manoeuvres))
    if not plants or not manoeuvres or {len(plants), len(manoeuvres)} - {1, count}:
        raise InputError(
            f"{len(plants)} plants and {len(manoeuvres)} manoeuvres", mend="give as many of both, or one"
        )
    drivers = [common_driver(m, vehicle) for m in manoeuvres]
    shared_plants, plant_axes = _stacked(plants, "plants")
    shared_drivers, driver_axes = _stacked(drivers, "manoeuvres")
    axes = (plant_axes, driver_axes)
    chosen = [manoeuvres[i % len(manoeuvres)] for i in range(count)]
    places = tuple(jnp.asarray([getattr(m, name) for m in chosen], float) for name in ("speed", "s", "d"))
    carry = _start(shared_plants, shared_drivers, axes, places)
    rows = [round(m.duration / CONTROL_STEP) + 1 for m in chosen]
    chunks = []
    for first in range(0, max(rows), _CHUNK):
        carry, part = _roll(shared_plants, shared_drivers, axes, carry, jnp.asarray(first))
        chunks.append(jax.tree.map(np.asarray, part))
    drives = []
    for i, (m, length) in enumerate(zip(chosen, rows, strict=True)):
        its = [jax.tree.map(lambda a, i=i: a[i], part) for part in chunks[: -(-length // _CHUNK)]]
        truth, controls = jax.tree.map(lambda *parts, n=length: np.concatenate(parts)[:n], *its)
        time = np.arange(length) / round(1 / CONTROL_STEP)
        drives.append(checked(time, truth, controls, m, vehicle))
    return drives


def _stacked(trees: Sequence[Any], what: str) -> tuple[Any, Any]:
    """One pytree whose leaves that differ carry a leading axis, and which do: 0 or ``None``."""
    structures = {jax.tree.structure(t) for t in trees}
    leaves = [jax.tree.leaves(t) for t in trees]
    shapes = {tuple(np.shape(leaf) for leaf in row) for row in leaves}
    if len(structures) > 1 or len(shapes) > 1:
        raise InputError(
            f"{what} of different kinds cannot be driven together", mend="drive each kind by itself"
        )
    merged, axes = [], []
    for column in zip(*leaves, strict=True):
        first = column[0]
        same = all(leaf is first or np.array_equal(leaf, first) for leaf in column[1:])
        merged.append(first if same else jnp.asarray(np.stack([np.asarray(leaf) for leaf in column])))
        axes.append(None if same else 0)
    structure = structures.pop()
    return jax.tree.unflatten(structure, merged), jax.tree.unflatten(structure, axes)
