"""The curves that tell a tire: what a plot of it shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike
from numpy.typing import NDArray

from roadstate.tires.base import TireModel
from roadstate.tires.magic_formula import MagicFormula
from roadstate.tires.smooth import Numbers


def linear_stiffness(
    model: TireModel, load: ArrayLike, friction: ArrayLike = 1.0, speed: ArrayLike = 20.0
) -> tuple[Numbers, Numbers]:
    """∂F_x/∂κ (N) and ∂F_y/∂α (N/rad) at zero slip, by automatic differentiation.

    Args:
        model: the tire.
        load, friction, speed: as :meth:`TireModel.forces`; any shapes that broadcast together.
    """
    F_z, mu, v = jnp.broadcast_arrays(
        *(jnp.asarray(a, jnp.result_type(float)) for a in (load, friction, speed))
    )
    zero, one = jnp.zeros_like(F_z), jnp.ones_like(F_z)
    _, along = jax.jvp(lambda kappa: model.forces(kappa, zero, F_z, mu, v).F_x, (zero,), (one,))
    _, across = jax.jvp(lambda alpha: model.forces(zero, alpha, F_z, mu, v).F_y, (zero,), (one,))
    return along, across


def curves(
    model: TireModel,
    loads: Sequence[float],
    *,
    friction: float = 1.0,
    speed: float = 20.0,
    largest_slip: float = 0.3,
    largest_slip_angle: float = 0.25,
    points: int = 201,
) -> dict[str, NDArray[Any]]:
    """Characteristic curves of a tire as arrays.

    Args:
        model: the tire.
        loads: (L,) vertical loads, N.
        friction: μ.
        speed: m/s.
        largest_slip: the curves run over ±this slip.
        largest_slip_angle: and over ± this slip angle, rad.
        points: N, samples a curve.

    Returns:
        ``load`` (L,) N; ``slip`` (N,); ``slip_angle`` (N,) rad; pure slip ``F_x`` and ``F_y`` (L, N) N;
        ``combined_slip_angle`` (A,) rad with ``combined_F_x`` and ``combined_F_y`` (L, A, N) N over slip at
        each of these angles; ``stiffness_x`` (L,) N and ``stiffness_y`` (L,) N/rad; ``peak_x`` and ``peak_y``
        (L,), the largest |F|/F_z of the curves; of a :class:`MagicFormula` also ``M_z`` (L, N) N·m over slip
        angle and ``relaxation_x``, ``relaxation_y`` (L,) m.
    """
    F_z = np.asarray(loads, dtype=float)
    slip = np.linspace(-largest_slip, largest_slip, points)
    angle = np.linspace(-largest_slip_angle, largest_slip_angle, points)
    angles = np.linspace(0.0, largest_slip_angle, 5)
    places = {"load": F_z, "slip": slip, "slip_angle": angle, "combined_slip_angle": angles}
    found = _along(model, places, np.float64(friction), np.float64(speed))
    return {name: np.asarray(values) for name, values in (places | found).items()}


@eqx.filter_jit
def _along(model: TireModel, places: dict[str, Any], friction: Any, speed: Any) -> dict[str, Numbers]:
    """What :func:`curves` tells of these places, by one program: hundreds of small ones take longer."""
    F_z, slip, angle, angles = (
        places[name] for name in ("load", "slip", "slip_angle", "combined_slip_angle")
    )
    column = F_z[:, None]
    F_x = model.forces(slip, 0.0, column, friction, speed).F_x
    F_y = model.forces(0.0, angle, column, friction, speed).F_y
    combined = model.forces(slip, angles[:, None], column[..., None], friction, speed)
    stiffness_x, stiffness_y = linear_stiffness(model, F_z, friction, speed)
    result = {
        "F_x": F_x,
        "F_y": F_y,
        "combined_F_x": combined.F_x,
        "combined_F_y": combined.F_y,
        "stiffness_x": stiffness_x,
        "stiffness_y": stiffness_y,
        "peak_x": jnp.max(jnp.abs(F_x), axis=1) / F_z,
        "peak_y": jnp.max(jnp.abs(F_y), axis=1) / F_z,
    }
    if isinstance(model, MagicFormula):
        result["M_z"] = model.moments(0.0, angle, column, friction, speed).M_z
        result["relaxation_x"], result["relaxation_y"] = model.relaxation_lengths(F_z)
    return result
