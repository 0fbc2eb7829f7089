"""Choose by name, check that it fits, and wire it together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf

import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.assembly.assembled import AssembledModel, Index, Wiring
from roadstate.assembly.rows import Family, Rows, expand, number, refuse_twice, values_of
from roadstate.assembly.slow import Slow, slow_states
from roadstate.core.errors import InputError
from roadstate.vehicles.integrate import Euler, Integrator
from roadstate.vehicles.model import VehicleModel, per_wheel


def assemble(
    vehicle: VehicleModel,
    *,
    states: Sequence[str] = (),
    parameters: Sequence[str] = (),
    sensors: Sequence[str],
    noise: Mapping[str, float],
    sensor_noise: Mapping[str, float],
    prior: Mapping[str, tuple[float, float]],
    groupings: Mapping[str, str] | None = None,
    time_constants: Mapping[str, float] | None = None,
    known: Sequence[str] = (),
    fixed: Mapping[str, float] | None = None,
    integrator: Integrator | None = None,
) -> AssembledModel:
    """A state-space model from a vehicle model and names.

    Every quantity of the four wheels may be named as one (``wheel_speed``, ``friction``) or wheel by wheel
    (``wheel_speed_fl``); values given for the one hold for all its rows.

    Args:
        vehicle: the model.
        states: of the model's states, those to estimate. The others are known inputs, unless ``fixed``.
        parameters: what else to estimate, as slow states: a parameter of the model (``mass``, ``grade``,
            ``friction``, ``tire.cornering_stiffness``), a factor on one (``scale.tire.cornering_stiffness``,
            nominally 1), an input of the model (``force_x``), or the bias of a sensor (``bias.accel_x``,
            what it reads too much).
        sensors: outputs of the model, the rows of z.
        noise: white-noise density of every row of x, in its unit per √s.
        sensor_noise: 1σ of a sample of every sensor.
        prior: mean and 1σ of every row of x before the first sample.
        groupings: which wheels share a number, for parameters and inputs of four wheels: ``one``,
            ``front_rear``, ``left_right``, ``four``. Default ``four``; ``one`` for factors and for tire
            parameters that are a single number.
        time_constants: s, makes a parameter or bias a Gauss–Markov process about its prior mean instead of a
            random walk.
        known: parameters, and inputs the model can do without, that come with u.
        fixed: states and inputs of the model held at a value.
        integrator: default :class:`Euler`.

    Raises:
        InputError: a name that does not exist or comes twice; a grouping that does not apply; a row without
            noise or prior; a number out of range; a sensor that would read what is known anyway.
    """
    own = expand(states, vehicle.states, "states")
    seen = expand(sensors, vehicle.outputs, "sensors")
    sensor_names = tuple(row for row, _ in seen)
    slow = slow_states(parameters, vehicle, sensor_names, groupings or {})
    rows = (*own, *((row, s.family) for s in slow for row in s.family.rows))
    names = tuple(row for row, _ in rows)
    refuse_twice(names, "states and parameters")
    for chosen, where in ((names, "states and parameters"), (sensor_names, "sensors")):
        if not chosen:
            raise InputError("nothing is chosen", where=where, mend="name at least one")
    moved = {*names, *(row for s in slow if s.kind == "input" for row in s.targets)}
    for sensor in sensor_names:
        if sensor in (*vehicle.states, *vehicle.inputs) and sensor not in moved:
            raise InputError(
                f"'{sensor}' would only read the input of that name", where="sensors", mend="make it a state"
            )
    inputs, held, wiring = _wire(vehicle, own, slow, names, sensor_names, tuple(known), dict(fixed or {}))
    means, stds = _prior(values_of(prior, rows, "prior"), names)
    constants = values_of(time_constants or {}, rows[len(own) :], "time_constants", default=inf)
    rates = [
        1 / number(t, n, "time_constants", infinite=True)
        for t, n in zip(constants, names[len(own) :], strict=True)
    ]
    densities = values_of(noise, rows, "noise")
    deviations = values_of(sensor_noise, seen, "sensor_noise")
    return AssembledModel(
        states=names,
        sensors=sensor_names,
        inputs=inputs,
        wiring=wiring,
        vehicle=vehicle,
        integrator=Euler() if integrator is None else integrator,
        density=_array([number(v, n, "noise", zero=True) for v, n in zip(densities, names, strict=True)]),
        rate=_array([0.0] * len(own) + rates),
        mean=means,
        std=stds,
        sensor_std=_array(
            [number(v, n, "sensor_noise") for v, n in zip(deviations, sensor_names, strict=True)]
        ),
        constants=_array(held),
    )


def _wire(
    vehicle: VehicleModel,
    own: Rows,
    slow: Sequence[Slow],
    names: tuple[str, ...],
    sensors: tuple[str, ...],
    known: tuple[str, ...],
    fixed: Mapping[str, float],
) -> tuple[tuple[str, ...], tuple[float, ...], Wiring]:
    """The names u has to hold, what is held, and where everything the vehicle reads comes from."""
    estimated = {row: i for i, row in enumerate(names)}
    places = {row: estimated[row] for row, _ in own}
    for s in slow:
        if s.kind == "input":
            places |= dict(zip(s.targets, _places(s.family, estimated), strict=True))
    open_names = [n for n in (*vehicle.states, *vehicle.inputs) if n not in places]
    leaves = [n for n in known if n in vehicle.parameters]
    wanted = {row for row, _ in expand([n for n in known if n not in leaves], open_names, "known")}
    held = _held(vehicle, fixed, open_names, wanted)
    families = [_known_leaf(leaf, vehicle, slow) for leaf in leaves]
    inputs = (*(n for n in open_names if n not in held), *(row for f in families for row in f.rows))
    refuse_twice(inputs, "known")
    places |= {n: len(names) + i for i, n in enumerate((*inputs, *held))}
    wiring = Wiring(
        model_states=tuple(places[n] for n in vehicle.states),
        model_inputs=tuple(places[n] for n in vehicle.inputs),
        chosen=tuple(vehicle.states.index(row) for row, _ in own),
        parameters=(
            *((s.target, _places(s.family, estimated), False) for s in slow if s.kind == "parameter"),
            *((s.target, _places(s.family, estimated), True) for s in slow if s.kind == "scale"),
            *((f.name, _places(f, places), False) for f in families),
        ),
        biases=tuple(
            (sensors.index(sensor), i)
            for s in slow
            if s.kind == "bias"
            for sensor, i in zip(s.targets, _places(s.family, estimated), strict=True)
        ),
    )
    return inputs, tuple(held.values()), wiring


def _places(family: Family, places: Mapping[str, int]) -> Index:
    """The place of each wheel's row, or of the only one."""
    if family.of_wheel:
        return tuple(places[family.rows[i]] for i in family.of_wheel)
    return (places[family.name],)


def _held(
    vehicle: VehicleModel, fixed: Mapping[str, float], open_names: Sequence[str], wanted: set[str]
) -> dict[str, float]:
    """States and inputs of the vehicle that neither x nor u gives."""
    held = {n: 0.0 for n in vehicle.optional_inputs if n in open_names and n not in wanted}
    for name in fixed:
        if name in vehicle.parameters:
            raise InputError(
                f"'{name}' is a parameter", where="fixed", mend="set it by vehicle.with_parameters(...)"
            )
    for row, family in expand(fixed, open_names, "fixed"):
        if row in wanted:
            raise InputError(f"'{row}' is both known and fixed", where="fixed", mend="keep one of them")
        held[row] = number(fixed[family.name], row, "fixed", zero=True, negative=True)
    return held


def _known_leaf(leaf: str, vehicle: VehicleModel, slow: Sequence[Slow]) -> Family:
    if any(s.kind in ("parameter", "scale") and s.target == leaf for s in slow):
        raise InputError(f"'{leaf}' is estimated", where="known", mend="drop it from 'known' or 'parameters'")
    shape = jnp.shape(vehicle.parameters[leaf])
    return Family(leaf, per_wheel(leaf), (0, 1, 2, 3)) if shape == (4,) else Family(leaf, (leaf,))


def _prior(
    given: Sequence[tuple[float, float]], names: Sequence[str]
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    means, stds = [], []
    for value, name in zip(given, names, strict=True):
        if not isinstance(value, tuple | list) or len(value) != 2:
            raise InputError("is not (mean, std)", where=f"prior: {name}", mend="give both numbers")
        means.append(number(value[0], name, "prior", zero=True, negative=True))
        stds.append(number(value[1], name, "prior", zero=True))
    return _array(means), _array(stds)


def _array(values: Sequence[float]) -> Float[Array, " n"]:
    return jnp.asarray(values, jnp.result_type(float))
