"""The state-space model that :func:`roadstate.assembly.assemble` builds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from roadstate.core.errors import InputError
from roadstate.core.gaussian import Gaussian
from roadstate.statespace import StateSpaceModel
from roadstate.tires.smooth import Numbers
from roadstate.vehicles.integrate import Dynamics, Integrator
from roadstate.vehicles.model import Stiff, VehicleModel
from roadstate.vehicles.named import named_leaves

Index = tuple[int, ...]


class Wiring(NamedTuple):
    """Where everything the vehicle model reads comes from: places in ``[x, u, constants]``.

    Attributes:
        model_states: (number of the vehicle's states) places.
        model_inputs: (number of the vehicle's inputs) places.
        chosen: which of the vehicle's states lead x.
        parameters: (leaf, places, whether the value is a factor on the leaf); one place, or one per wheel.
        biases: (row of z, place).
    """

    model_states: Index
    model_inputs: Index
    chosen: Index
    parameters: tuple[tuple[str, Index, bool], ...]
    biases: tuple[tuple[int, int], ...]


class _Part(NamedTuple):
    # the chosen states of a vehicle, the others held; x is what leads the pool
    vehicle: VehicleModel
    rest: Numbers
    wiring: Wiring

    def _whole(self, x: Numbers) -> Numbers:
        return _take(jnp.concatenate([x, self.rest]), self.wiring.model_states)

    def derivative(self, x: Float[Array, " n"], u: Any) -> Float[Array, " n"]:
        return _take(self.vehicle.derivative(self._whole(x), u), self.wiring.chosen)

    def stiff(self, x: Float[Array, " n"], u: Any) -> Stiff:
        whole, chosen = self.vehicle.stiff(self._whole(x), u), self.wiring.chosen
        return Stiff(
            _take(whole.derivative, chosen),
            _take(whole.dry, chosen),
            whole.damping[np.ix_(chosen, chosen)],
        )


class AssembledModel(StateSpaceModel):
    """x = [chosen states of the vehicle, parameters as states, sensor biases]; built by ``assemble``.

    ``u`` is a mapping that holds at least ``inputs`` (scalars, SI), or an array (k,) in that order.

    The vehicle's states move by the integrator with parameters and inputs held over the step; parameters and
    biases are random walks, or first-order Gauss–Markov processes about their prior mean,
    dx = −(x − x̄)/τ dt + n dW, whose own discretisation is exact for any Δt: variance n²τ/2 (1 − e^{−2Δt/τ}),
    n²Δt for a random walk.

    All else of ∫₀^Δt eᴬˢ diag(n²) eᴬᵀˢ ds (Van Loan, *IEEE Trans. Automatic Control* 23, 1978) is of first
    order in Δt: noise on the vehicle's own states enters as n²Δt, and what a parameter's noise does to the
    vehicle within the step in which it arises (a covariance of ½Δt² n² ∂ẋ/∂p, a variance of order Δt³) not
    at all. Either is wrong by order Δt² a step, hence the covariance at a given time by order Δt, whatever
    the integrator's order; relatively by about Δt over the vehicle's shortest time constant. Over a gap that
    is long against it, predict in several steps.

    Attributes:
        states: names of the rows of x.
        sensors: names of the rows of z.
        inputs: names of what u has to hold.
        vehicle: the vehicle model; its parameters are leaves, those that are states or inputs unused.
        integrator: moves the vehicle's states.
        density: (n,) noise density n, in the unit of the row per √s.
        rate: (n,) 1/τ, 1/s; zero for a random walk and for the vehicle's states.
        mean, std: (n,) prior.
        sensor_std: (m,) 1σ of a sample.
        constants: (c,) states and inputs of the vehicle that are held.
    """

    states: tuple[str, ...] = eqx.field(static=True)
    sensors: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    wiring: Wiring = eqx.field(static=True)
    vehicle: VehicleModel
    integrator: Integrator
    density: Float[Array, " n"]
    rate: Float[Array, " n"]
    mean: Float[Array, " n"]
    std: Float[Array, " n"]
    sensor_std: Float[Array, " m"]
    constants: Float[Array, " c"]

    def f(self, x: Float[Array, " n"], u: Any, dt: Float[Array, ""]) -> Float[Array, " n"]:
        """The state Δt later."""
        pool, count = self._pool(x, u), len(self.wiring.chosen)
        # x + (x − x̄)(e^{−Δt/τ} − 1), and not the shorter form, so that a random walk stays bit for bit
        slow = x[count:] + (x[count:] - self.mean[count:]) * jnp.expm1(-self.rate[count:] * dt)
        if not count:
            return slow
        vehicle = self._vehicle(pool)
        part: Dynamics = _Part(vehicle, pool[count:], self.wiring)
        if self.wiring.chosen == tuple(range(len(self.wiring.model_states))):
            part = vehicle
        moved = self.integrator.step(part, x[:count], _take(pool, self.wiring.model_inputs), dt)
        return jnp.concatenate([moved, slow])

    def h(self, x: Float[Array, " n"], u: Any) -> Float[Array, " m"]:
        """What the sensors would read."""
        pool = self._pool(x, u)
        seen = self._vehicle(pool).measure(
            _take(pool, self.wiring.model_states), _take(pool, self.wiring.model_inputs)
        )
        rows = [seen[name] for name in self.sensors]
        for sensor, place in self.wiring.biases:
            rows[sensor] = rows[sensor] + pool[place]
        return jnp.stack(rows)

    def sqrt_Q(self, u: Any, dt: Float[Array, ""]) -> Float[Array, "n n"]:
        """Diagonal; see the class for its order."""
        damped = self.rate > 0
        rate = jnp.where(damped, self.rate, 1)
        growth = jnp.where(damped, -jnp.expm1(-2 * rate * dt) / (2 * rate), dt)
        # the root's slope at Δt = 0 is kept out of gradients
        root = jnp.where(growth > 0, jnp.sqrt(jnp.where(growth > 0, growth, 1)), 0)
        return jnp.diag(self.density * root)

    def sqrt_R(self, u: Any) -> Float[Array, "m m"]:
        """Independent sensors."""
        return jnp.diag(self.sensor_std)

    def prior(self) -> Gaussian:
        """Independent rows."""
        return Gaussian(self.mean, jnp.diag(self.std))

    def index(self, name: str) -> int:
        """The row of x called ``name``.

        Raises:
            InputError: there is none.
        """
        if name not in self.states:
            raise InputError(f"no state '{name}'", mend=f"states: {', '.join(self.states)}")
        return self.states.index(name)

    def _pool(self, x: Numbers, u: Any) -> Numbers:
        return jnp.concatenate([x, self._known(u).astype(x.dtype), self.constants.astype(x.dtype)])

    def _known(self, u: Any) -> Numbers:
        if not isinstance(u, Mapping):
            values = jnp.asarray(u, jnp.result_type(float)) if not self.inputs else jnp.asarray(u)
            if values.shape != (len(self.inputs),):
                raise InputError(
                    f"u has shape {values.shape}, the model has {len(self.inputs)} inputs",
                    mend=f"give a mapping, or an array of {', '.join(self.inputs)}",
                )
            return values
        for name in self.inputs:
            if name not in u:
                raise InputError(
                    f"u lacks '{name}'",
                    mend=f"add it to u, choose it as a state, or hold it: fixed={{'{name}': ...}}",
                )
        return jnp.stack([jnp.asarray(u[name]) for name in self.inputs]) if self.inputs else jnp.zeros(0)

    def _vehicle(self, pool: Numbers) -> VehicleModel:
        if not self.wiring.parameters:
            return self.vehicle
        nominal = named_leaves(self.vehicle)
        values = {}
        for name, places, is_factor in self.wiring.parameters:
            value = pool[places[0]] if len(places) == 1 else _take(pool, places)
            values[name] = nominal[name] * value if is_factor else value
        return self.vehicle.with_parameters(values)


def _take(values: Numbers, places: Index) -> Numbers:
    """values[places], as one slice where the places follow each other."""
    if places == tuple(range(places[0], places[0] + len(places))):
        return values[places[0] : places[0] + len(places)]
    return values[np.asarray(places)]
