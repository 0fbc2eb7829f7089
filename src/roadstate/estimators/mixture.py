"""Many hypotheses at once, each with its own mean and covariance; the last axis tells them apart."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import NDArray

from roadstate.core.kernel import once
from roadstate.linalg import root

_ROBUST = 16.0  # squared deviations, over σ², from which on a sample counts less
_FLAT = 1e-4  # curvature of a logarithm from which on a peak has a place between the grid's points
_ONSET = 8.0  # squared deviations, over σ², that no lasting error explains, unless told


def learn(
    x: Array, P: Array, row: Array, innovation: Array, noise: Array, takes: Array
) -> tuple[Array, Array, Array]:
    """A scalar measurement for all hypotheses: new mean and covariance, and what the old one made of it.

    Args:
        x: (..., n, J).
        P: (..., n, n, J).
        row: (..., n, J) the sensor's derivative.
        innovation: (..., J).
        noise: (..., J) variance of an independent sample.
        takes: how many samples make an independent one; what deviates far counts less.

    Returns:
        x, P, and the variance (..., J) of the measurement that ``P`` had foreseen, but for noise.
    """
    gain, own = _foreseen(P, row)
    far = innovation**2 / (own + noise)
    total = own + noise * takes * (1 + far / _ROBUST)
    x = x + gain * (innovation / total)[..., None, :]
    P = P - gain[..., None, :] * (gain / total[..., None, :])[..., None, :, :]
    return x, P, own


def _foreseen(P: Array, row: Array) -> tuple[Array, Array]:
    """Covariance (..., n, J) of states and measurement, and the latter's variance (..., J), but for noise."""
    gain = jnp.sum(P * row[..., None, :, :], axis=-2)
    return gain, jnp.sum(gain * row, axis=-2)


def follow(
    x: Array,
    P: Array,
    row: Array,
    innovation: Array,
    noise: tuple[Array, Array],
    takes: tuple[Array, Array],
    moves: NDArray[np.bool_],
) -> tuple[Array, Array, Array]:
    """As :func:`learn`, of a sensor whose error has a swift part and one that lasts.

    What moves follows all that is no swift error, or it would lag behind a disturbance for as long as the
    error lasts; what stays as it is learns no sooner than the lasting part becomes another one. The
    covariance is that of these gains (Joseph's form, which is right for any gain) if what stays is told the
    same with so much more noise: as in a partial-update Schmidt–Kalman filter (Brink, *J. Guid. Control
    Dyn.* 40(9), 2017), which weakens the gain of what hardly shows.

    Args:
        x, P, row, innovation: as there.
        noise: variances of an independent sample, to what moves and to what stays.
        takes: how many samples make an independent one, to either.
        moves: (n,) which states move.
    """
    gain, own = _foreseen(P, row)
    doubt = 1 + innovation**2 / (own + noise[1]) / _ROBUST
    stays = own + noise[1] * takes[1] * doubt
    swift = jnp.minimum(own + noise[0] * takes[0] * doubt, stays)
    x = x + gain * jnp.where(moves[:, None], innovation / swift, innovation / stays)
    either = (moves[:, None] | moves)[:, :, None]
    return x, P - gain[:, None] * (gain * jnp.where(either, 1 / swift, 1 / stays)), own


def weigh(
    innovation: Array,
    own: Array,
    noise: Array,
    takes: Array,
    whole: Array | float = 0.0,
    onset: float = _ONSET,
) -> Array:
    """Log-likelihood (..., J) of a scalar measurement under each hypothesis.

    Args:
        innovation: (..., J).
        own: (..., J) variance that :func:`learn` foresaw.
        noise: (..., J) variance of an independent sample.
        takes: how many samples make an independent one.
        whole: 0 to 1, how much of the likelihood's normalising factor counts.
        onset: as :func:`tempered` takes it.
    """
    # What a state errs is no noise that many samples average out: a hypothesis that explains all by a state
    # far from its prior pays what the prior says of that, as in the evidence of a linear model.
    fresh = innovation**2 / (own / takes + noise)
    # The normalising factor counts while forces change. Without it a hypothesis that is unsure of its force
    # is never refuted, and friction comes out too high; while nothing changes, every hypothesis predicts
    # well, noises are but roughly known, and the surest, a tire that slides, would win by the factor alone.
    return tempered(fresh, takes, onset) - whole * 0.5 * jnp.log(own + noise) / takes


def tempered(far: Array, takes: Array, onset: float) -> Array:
    """Log-likelihood of a squared deviation over σ², with the tails of Student's t (4 degrees of freedom).

    One of so many samples makes an independent one, of fewer where an error is too large to last.

    Args:
        far: squared deviation over σ².
        takes: how many samples make an independent one.
        onset: squared deviation, over σ², from which on an error is too large to last.
    """
    return -2.5 * jnp.log1p(far / 4.0) * jnp.minimum((1 + far / onset) / takes, 1.0)


def moments(x: Array, variance: Array, p: Array) -> tuple[Array, Array]:
    """Mean (n,) and 1σ (n,) of all hypotheses together, of means and variances (n, J) and weights p (J,)."""
    p = p / jnp.sum(p)
    mean = jnp.sum(p * x, axis=1)
    return mean, root(jnp.sum(p * (variance + (x - mean[:, None]) ** 2), axis=1))


def likeliest(p: Array) -> Array:
    """Place (...,) on the grid, in steps, where weights p (..., J) are largest; between its points, too.

    Weights of neighbours count (1, 2, 1)/4, so that a narrow peak beside a wide hump is not it, and the
    logarithms' parabola about the largest is exact for a Gaussian.
    """
    edge = padded(p)
    height = edge[..., 2:] + 2 * p + edge[..., :-2]
    is_top = height == jnp.max(height, axis=-1, keepdims=True)
    edge = padded(height)
    grid = jnp.arange(p.shape[-1], dtype=p.dtype)

    def there(row: Array) -> Array:
        return jnp.sum(jnp.where(is_top, row, 0.0), axis=-1)

    here, count = there(height), there(jnp.ones_like(grid))
    below, above = jnp.log(there(edge[..., :-2]) / here), jnp.log(there(edge[..., 2:]) / here)
    aside = jnp.clip(0.5 * (below - above) / jnp.minimum(below + above, -_FLAT), -0.5, 0.5)
    return jnp.clip(there(grid) / count + aside, 0, len(grid) - 1)


def padded(row: Array) -> Array:
    """With the last axis' ends repeated."""
    return jnp.concatenate([row[..., :1], row, row[..., -1:]], axis=-1)


def inherit(x: Array, P: Array, p: Array, new: Array) -> tuple[Array, Array]:
    """Hypotheses of which a share ``new`` (J,) is born anew out of all of them; moments are kept.

    Args:
        x: (n, J).
        P: (n, n, J).
        p: (J,) weights.
        new: (J,).
    """
    p = p / jnp.sum(p)
    mean = jnp.sum(p * x, axis=1, keepdims=True)
    apart = x - mean
    whole = once(jnp.sum(p * (P + apart[:, None] * apart[None]), axis=2, keepdims=True))
    shift = (1 - new) * new * (apart[:, None] * apart[None])
    return x - new * apart, (1 - new) * P + new * whole + shift
