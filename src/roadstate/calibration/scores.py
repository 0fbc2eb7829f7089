"""What innovations and log-likelihoods of estimators say of the figures in which they differ."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from roadstate.core.gaussian import Gate, Info
from roadstate.core.traced import returned
from roadstate.estimators import Estimator
from roadstate.filters.base import LOG_2PI, GateRule

_OUTLIER = GateRule().threshold


@returned
class Rows(NamedTuple):
    """Steps of each of b estimators, the unmoved one first.

    Attributes:
        log_likelihood: (b, k).
        innovation: (b, k, m).
        S: (b, k, m, m).
        used: (b, k, m).
        ok: (b, k).
    """

    log_likelihood: Any
    innovation: Any
    S: Any
    used: Any
    ok: Any


def kept(estimator: Estimator[Any], state: Any, info: Info) -> Rows:
    used = jnp.isfinite(info.innovation) & (info.gate != Gate.REJECTED)
    ok = info.ok & jnp.isfinite(info.log_likelihood)
    return Rows(info.log_likelihood, info.innovation, info.S, used, ok)


@jax.jit
def beyond(rows: Rows) -> Float[Array, "b k"]:
    """What the log-likelihoods hold beyond the Gaussian innovations in ``Info``."""
    both = rows.used[..., :, None] & rows.used[..., None, :]
    L = jnp.linalg.cholesky(jnp.where(both, rows.S, jnp.eye(rows.S.shape[-1])))
    white = _whitened(L, jnp.where(rows.used, rows.innovation, 0.0)[..., None])[..., 0]
    log_det = 2 * jnp.sum(jnp.log(jnp.diagonal(L, axis1=-2, axis2=-1)), axis=-1)
    squares = jnp.sum(white**2, axis=-1)
    gaussian = -0.5 * (squares + log_det + LOG_2PI * jnp.sum(rows.used, axis=-1))
    return jnp.asarray(rows.log_likelihood - gaussian)


def _whitened(L: Array, x: Array) -> Array:
    return jnp.asarray(jax.scipy.linalg.solve_triangular(L, x, lower=True))


class Judges(NamedTuple):
    """What judges which parameter.

    Attributes:
        noise: (p,) the whole likelihood: noise levels.
        rest: (p,) what it holds beyond the innovations, as well as them.
        sensors: (m,) those whose innovations judge figures of the car.
        wide: (p,) those whose likelihood has steps.
    """

    noise: Any
    rest: Any
    sensors: Any
    wide: Any


class Scores(NamedTuple):
    """What a chunk says.

    Attributes:
        scores: (p, k).
        rest: (p, k) the part of a figure's that comes from beyond the Gaussian innovations.
        information: (p, p) of the Gaussian innovations.
    """

    scores: Any
    rest: Any
    information: Any


class Moves(NamedTuple):
    """Where the likelihood is looked at for its slope.

    Attributes:
        changes: (b, p) of each estimator, the unmoved one first and then one for each parameter.
        other: (p,) the row that a parameter's is compared with.
        width: (p,) how far apart the two are.
    """

    changes: Any
    other: Any
    width: Any


@jax.jit
def scored(rows: Rows, moves: Moves, judges: Judges) -> Scores:
    """Scores of the samples and the information in them, by differences between rows.

    A figure of the car is judged by the innovations with S held, −dνᵀ S⁻¹ ν, and its information is
    Σ dνᵀ S⁻¹ dν (quasi-likelihood, Wedderburn 1974, Biometrika 61, 439–447): the score's mean is zero at the
    true figure whether S is right or not. With the whole score, a figure that S hangs on as well would stand
    in for noise levels that are off: a greater mass makes a torque's noise smaller, a smaller wheel radius a
    wheel speed's. Noise levels have their whole score, and its outer product for information (Berndt, Hall,
    Hall & Hausman 1974, Ann. Econ. Soc. Meas. 3, 653–665).

    Refused samples have no say in figures, and count in noise levels as lying on the gate (Talwar's function;
    Huber & Ronchetti, *Robust Statistics*, ch. 4): were they left out, refusing would pay.
    """
    same = jnp.all(rows.used == rows.used[:1], axis=(0, 2))  # no sample is refused by some only
    used, noisy = rows.used[0], judges.noise[:, None]
    seen = used & judges.sensors
    S = jnp.where(seen[:, :, None] & seen[:, None, :], rows.S[0], jnp.eye(rows.S.shape[-1]))
    innovation = jnp.where(seen, rows.innovation, 0.0)
    L = jnp.linalg.cholesky(S)
    white = _whitened(L, innovation[0][..., None])[..., 0]
    width, count = moves.width[:, None], len(moves.width)

    def slope(of: Array) -> Array:
        return jnp.asarray((of[1 : count + 1] - of[moves.other]) / width)

    shift = slope(innovation.reshape(len(innovation), -1)).reshape(count, *seen.shape)
    shift = jnp.where(same[:, None], shift, 0.0)
    shift = _whitened(L, jnp.moveaxis(shift, 0, -1))  # (k, m, p)
    rest = jnp.where(same & judges.rest[:, None], slope(beyond(rows)), 0.0)
    held = rest - jnp.einsum("kip,ki->pk", shift, white)
    variance = jnp.diagonal(rows.S, axis1=-2, axis2=-1)
    refused = jnp.isfinite(rows.innovation[0]) & ~used & (variance[0] > 0)
    edge = jnp.sum(jnp.where(refused, _OUTLIER + jnp.log(jnp.where(refused, variance, 1.0)), 0.0), axis=-1)
    whole = rows.log_likelihood - 0.5 * edge
    levels = jnp.where(same & noisy, slope(whole), 0.0)
    information = jnp.einsum("kip,kiq->pq", shift, shift)
    information = jnp.where(noisy | noisy.T, 0.0, information) + levels @ levels.T
    return Scores(jnp.where(noisy, levels, held), rest, information)
