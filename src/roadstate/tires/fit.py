"""Fit one tire model to another, and say how far off it stays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from roadstate.core import InputError
from roadstate.tires.base import Fit, TireModel, as_leaf
from roadstate.tires.smooth import Numbers


@dataclass(frozen=True)
class Misfit:
    """How far a fitted force is from its target over the grid.

    Attributes:
        rms: N.
        largest: N.
        rms_percent: of the target's peak pure force in that direction, load by load.
        largest_percent: likewise.
    """

    rms: float
    largest: float
    rms_percent: float
    largest_percent: float


@dataclass(frozen=True)
class FitResult:
    """A fitted tire.

    Attributes:
        model: the template with its parameters moved.
        friction_factor: the model's μ over the target's, 1 unless it was fitted too.
        misfit: ``pure_F_x``, ``pure_F_y``, ``combined_F_x``, ``combined_F_y`` → :class:`Misfit`.
        converged: the least-squares solver met its tolerance.
        steps: solver steps.
    """

    model: TireModel
    friction_factor: float
    misfit: Mapping[str, Misfit]
    converged: bool
    steps: int


@dataclass(frozen=True)
class _Grid:
    # one array of operating points: pure slip, pure slip angle, then combined
    slip: NDArray[np.float64]
    slip_angle: NDArray[np.float64]
    load: NDArray[np.float64]
    friction: NDArray[np.float64]
    family: NDArray[np.int64]


_PURE_X, _PURE_Y, _COMBINED = range(3)


def fit_tire(
    template: TireModel | type[TireModel],
    target: TireModel,
    *,
    loads: Sequence[float] = (2000.0, 3000.0, 4000.0, 5000.0, 6000.0),
    friction: Sequence[float] = (1.0,),
    largest_slip: float = 0.15,
    largest_slip_angle: float = 0.2,
    speed: float = 20.0,
    points: int = 31,
    only: Sequence[str] | None = None,
    match_friction: bool = False,
) -> FitResult:
    """Move a model's parameters so that its forces are those of another (weighted least squares).

    The residuals are forces over μF_z, so every load counts alike; pure longitudinal, pure lateral and
    combined slip have the same weight. Both models are asked at the same friction, and where their ideas of μ
    differ the misfit shows it; with ``match_friction`` one factor between their frictions is fitted too, by
    which an estimate of μ with this model would be off.

    Args:
        template: the model to fit, or its class for its default; the parameters in its ``fitted`` are moved.
        target: the tire to be like.
        loads: vertical loads, N.
        friction: values of μ.
        largest_slip: the fit covers ± this practical slip; below 1.
        largest_slip_angle: and ± this slip angle, rad.
        speed: m/s.
        points: samples a pure curve; combined slip takes a square of about as many.
        only: move only these parameters.
        match_friction: fit the factor from the target's μ to the model's as well.

    Raises:
        InputError: nothing to fit, an unknown parameter, an empty or impossible range, or no finite fit.
    """
    import optimistix

    model = template.default() if isinstance(template, type) else template
    names = _names(model, only)
    grid = _grid(loads, friction, largest_slip, largest_slip_angle, points)
    start = [_to_free(getattr(model, name), model.fitted[name]) for name in names]
    start += [jnp.asarray(0.0)] * match_friction

    def build(free: list[Numbers]) -> tuple[TireModel, Numbers]:
        values = [_from_free(v, model.fitted[name]) for name, v in zip(names, free, strict=False)]
        moved: TireModel = eqx.tree_at(lambda m: [getattr(m, name) for name in names], model, values)
        return moved, jnp.exp(free[-1]) if match_friction else jnp.asarray(1.0)

    weight = _weights(grid)
    wanted = _forces(target, jnp.asarray(1.0), grid, speed)

    def residuals(free: list[Numbers], _: None) -> Numbers:
        return ((_forces(*build(free), grid, speed) - wanted) * weight).reshape(-1)

    solution: optimistix.Solution[list[Numbers], Any] = optimistix.least_squares(
        residuals,
        optimistix.LevenbergMarquardt(rtol=1e-8, atol=1e-10),
        start,
        max_steps=500,
        throw=False,
    )
    if not all(bool(jnp.all(jnp.isfinite(v))) for v in solution.value):
        raise InputError(
            f"'{model.name}' cannot be fitted: the solver left the finite numbers",
            mend="start from a template closer to the target, or fit fewer parameters with 'only'",
        )
    fitted, factor = build(solution.value)
    # plain numbers again, which follow the precision of what they meet
    fitted = jax.tree.map(lambda leaf: as_leaf(float(leaf)) if leaf.ndim == 0 else leaf, fitted)
    return FitResult(
        model=fitted,
        friction_factor=float(factor),
        misfit=_misfit(np.asarray(_forces(fitted, factor, grid, speed) - wanted), np.asarray(wanted), grid),
        converged=bool(solution.result == optimistix.RESULTS.successful),
        steps=int(solution.stats["num_steps"]),
    )


def _names(model: TireModel, only: Sequence[str] | None) -> list[str]:
    if not model.fitted:
        raise InputError(f"'{model.name}' has no parameters to fit", mend="fit a simpler model to it instead")
    unknown = [name for name in only or () if name not in model.fitted]
    if unknown:
        raise InputError(
            f"'{model.name}' cannot fit {', '.join(unknown)}", mend=f"it can fit {', '.join(model.fitted)}"
        )
    return [name for name in model.fitted if only is None or name in only]


def _grid(
    loads: Sequence[float],
    friction: Sequence[float],
    largest_slip: float,
    largest_slip_angle: float,
    points: int,
) -> _Grid:
    if not loads or not friction or min(loads) <= 0 or min(friction) <= 0:
        raise InputError("a fit needs loads and frictions above zero", mend="give at least one of each")
    if not 0 < largest_slip < 1 or not 0 < largest_slip_angle < 1.5 or points < 5:
        raise InputError(
            "a fit needs 0 < largest_slip < 1, 0 < largest_slip_angle < 1.5 rad and at least 5 points"
        )
    slip = np.linspace(-largest_slip, largest_slip, points)
    angle = np.linspace(-largest_slip_angle, largest_slip_angle, points)
    side = max(4, 2 * round(np.sqrt(points) / 2))  # even: no point of it is pure slip
    square = [
        a.ravel()
        for a in np.meshgrid(
            np.linspace(-largest_slip, largest_slip, side),
            np.linspace(-largest_slip_angle, largest_slip_angle, side),
        )
    ]
    slips = np.concatenate([slip, np.zeros(points), square[0]])
    angles = np.concatenate([np.zeros(points), angle, square[1]])
    family = np.repeat([_PURE_X, _PURE_Y, _COMBINED], [points, points, side * side])
    pairs = np.array([(F_z, mu) for F_z in loads for mu in friction], dtype=float)
    count = len(pairs)
    return _Grid(
        slip=np.tile(slips, count),
        slip_angle=np.tile(angles, count),
        load=np.repeat(pairs[:, 0], len(slips)),
        friction=np.repeat(pairs[:, 1], len(slips)),
        family=np.tile(family, count),
    )


def _forces(model: TireModel, factor: Numbers, grid: _Grid, speed: float) -> Float[Array, "2 n"]:
    return jnp.stack(model.forces(grid.slip, grid.slip_angle, grid.load, factor * grid.friction, speed))


def _weights(grid: _Grid) -> NDArray[np.float64]:
    members = np.bincount(grid.family)[grid.family]
    result: NDArray[np.float64] = 1 / (grid.load * grid.friction * np.sqrt(members))
    return result


def _to_free(value: Numbers, kind: Fit) -> Numbers:
    if kind == "positive":
        return jnp.log(value)
    return jnp.sqrt(value) if kind == "not_negative" else value


def _from_free(value: Numbers, kind: Fit) -> Numbers:
    if kind == "positive":
        return jnp.exp(value)
    return value**2 if kind == "not_negative" else value


def _misfit(error: NDArray[np.float64], wanted: NDArray[np.float64], grid: _Grid) -> dict[str, Misfit]:
    peak = np.empty_like(error)
    for F_z, mu in set(zip(grid.load, grid.friction, strict=True)):
        here = (grid.load == F_z) & (grid.friction == mu)
        for row, family in enumerate((_PURE_X, _PURE_Y)):
            peak[row, here] = np.max(np.abs(wanted[row, here & (grid.family == family)]))
    result = {}
    for name, row, family in (
        ("pure_F_x", 0, _PURE_X),
        ("pure_F_y", 1, _PURE_Y),
        ("combined_F_x", 0, _COMBINED),
        ("combined_F_y", 1, _COMBINED),
    ):
        chosen = grid.family == family
        e, relative = error[row, chosen], 100 * error[row, chosen] / peak[row, chosen]
        result[name] = Misfit(
            rms=float(np.sqrt(np.mean(e**2))),
            largest=float(np.max(np.abs(e))),
            rms_percent=float(np.sqrt(np.mean(relative**2))),
            largest_percent=float(np.max(np.abs(relative))),
        )
    return result
