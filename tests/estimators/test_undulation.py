"""How much faster than foreseen a road changes its slope, told from a filter's corrections."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from numpy.typing import NDArray

from roadstate.estimators.road import GradePrior
from roadstate.estimators.undulation import Undulation

STEP, STEPS, ROADS = 0.2, 8000, 24  # m, and how many of them
NOISE = 0.01  # of a reading of the grade
ROAD = GradePrior(jnp.asarray(0.08), jnp.asarray(160.0))


def followed(rougher: float, *, learns: bool) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """(STEPS, ROADS) error of the grade over its 1σ, and the logarithm that is found.

    By a Kalman filter that reads the grade of roads that the prior made, with ``rougher`` times its noise.
    """
    rng = np.random.default_rng(5)
    A, root_Q = ROAD.transition(jnp.asarray(STEP)), ROAD.sqrt_Q(jnp.asarray(STEP))
    start = rougher * np.asarray(ROAD.stationary_std)[:, None] * rng.normal(size=(2, ROADS))
    fresh = rougher * np.einsum("ij,kjr->kir", root_Q, rng.normal(size=(STEPS, 2, ROADS)))
    noise = NOISE * rng.normal(size=(STEPS, ROADS))

    def step(
        x: tuple[Array, Array, Array, Undulation], given: tuple[Array, Array]
    ) -> tuple[Any, tuple[Array, Array]]:
        truth, mean, P, undulation = x
        moved, told = given
        truth, mean = A @ truth + moved, A @ mean
        # a covariance of each road's own: what is found scales its noise
        Q = root_Q @ root_Q.T
        P = jnp.einsum("ij,rjk,lk->ril", A, P, A) + undulation.scale[:, None, None] ** 2 * Q
        K = P[:, :, 0] / (P[:, :1, 0] + NOISE**2)
        correction = K.T * (truth[0] + told - mean[0])
        gone = K[:, 1] * P[:, 0, 1]
        P = P - K[:, :, None] * P[:, :1, :]
        mean = mean + correction
        if learns:
            undulation = jax.vmap(Undulation.take, in_axes=(0, 0, 0, None))(
                undulation, correction[1], gone, jnp.asarray(STEP)
            )
        error = (mean[0] - truth[0]) / jnp.sqrt(P[:, 0, 0])
        return (truth, mean, P, undulation), (error, undulation.excess)

    P = jnp.broadcast_to(jnp.diag(ROAD.stationary_std**2), (ROADS, 2, 2))
    none = Undulation(*(jnp.zeros(ROADS) for _ in Undulation.none()))
    begins = jnp.asarray(start), jnp.zeros((2, ROADS)), P, none
    _, (error, excess) = jax.jit(lambda g: jax.lax.scan(step, begins, g))((fresh, noise))
    return np.asarray(error), np.asarray(excess)


def test_a_road_like_the_prior_s_is_left_alone() -> None:
    error, excess = followed(1.0, learns=True)
    assert np.mean(excess) < 0.25
    assert np.mean(np.abs(error) < 1.96) == pytest.approx(0.95, abs=0.015)


@pytest.mark.parametrize("rougher", [2.0, 4.0])
def test_the_grade_of_rough_roads_is_as_sure_as_it_says(rougher: float) -> None:
    """What is found is somewhat too little: a sum of 1.5 times its variance passes for chance."""
    blind, _ = followed(rougher, learns=False)
    error, excess = followed(rougher, learns=True)
    inside = np.mean(np.abs(blind) < 1.96), np.mean(np.abs(error) < 1.96)
    assert inside[0] < 0.9 < inside[1]
    assert np.mean(excess[len(excess) // 4 :]) == pytest.approx(2 * np.log(rougher), abs=1.0)


def test_a_level_road_makes_nothing_smoother() -> None:
    undulation = Undulation.none()
    for _ in range(100):
        undulation = undulation.take(jnp.zeros(()), jnp.asarray(1e-8), jnp.asarray(1.0))
    assert float(undulation.scale) == 1.0


def test_who_stands_learns_nothing_of_the_road() -> None:
    """However much an estimate moves then: it is another sensor's."""
    driven = Undulation.none().take(jnp.asarray(1e-3), jnp.asarray(1e-7), jnp.asarray(5.0))
    stands = driven.take(jnp.asarray(0.5), jnp.asarray(1e-9), jnp.zeros(()))
    assert float(stands.excess) == float(driven.excess) > 0
