"""Mixtures of Gaussians whose last axis tells the hypotheses apart."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.typing import NDArray

from roadstate.estimators.mixture import follow, inherit, learn, likeliest, moments, weigh

Numbers = NDArray[np.float64]


@pytest.fixture
def three() -> tuple[Numbers, Numbers, Numbers]:
    """Means (2, 3), covariances (2, 2, 3) and weights (3,) of three hypotheses."""
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(3, 2, 2))
    P = np.stack([root @ root.T + 0.1 * np.eye(2) for root in roots], axis=-1)
    return rng.normal(size=(2, 3)), P, np.array([0.2, 0.5, 0.3])


def test_a_likely_sample_is_a_kalman_update(three: tuple[Numbers, Numbers, Numbers]) -> None:
    x, P, _ = three
    row = np.array([[1.0, 0.5, -1.0], [0.3, 0.0, 2.0]])
    noise = np.array([0.5, 1.0, 2.0])
    innovation = np.full(3, 1e-3)  # so small that nothing is robust about it
    new, spread, _ = learn(*map(jnp.asarray, (x, P, row, innovation, noise)), jnp.asarray(1.0))
    for j in range(3):
        h, S = row[:, j], row[:, j] @ P[:, :, j] @ row[:, j] + noise[j]
        gain = P[:, :, j] @ h / S
        np.testing.assert_allclose(np.asarray(new)[:, j], x[:, j] + gain * 1e-3, rtol=1e-7)
        np.testing.assert_allclose(
            np.asarray(spread)[:, :, j], P[:, :, j] - np.outer(gain, gain) * S, atol=1e-7
        )


def test_sides_learn_apart(three: tuple[Numbers, Numbers, Numbers]) -> None:
    x, P, _ = three
    both = [jnp.stack([jnp.asarray(a)] * 2) for a in (x, P, np.ones((2, 3)))]
    innovation, noise = jnp.asarray([[0.5] * 3, [-0.2] * 3]), jnp.ones((2, 3))
    together = learn(*both, innovation, noise, jnp.asarray(4.0))
    for side in range(2):
        alone = learn(*(a[side] for a in both), innovation[side], noise[side], jnp.asarray(4.0))
        for one, other in zip(together, alone, strict=True):
            np.testing.assert_allclose(np.asarray(one)[side], np.asarray(other), rtol=1e-12)


ROW = np.array([[1.0, 0.5, -1.0], [0.3, 0.0, 2.0]])


@pytest.mark.parametrize("innovation", [0.1, 6.0])
def test_an_error_that_does_not_last_is_learnt_from_by_all_alike(
    innovation: float, three: tuple[Numbers, Numbers, Numbers]
) -> None:
    x, P, row, told, noise = map(jnp.asarray, (*three[:2], ROW, np.full(3, innovation), [0.5, 1.0, 2.0]))
    takes = jnp.asarray(3.0)
    found = follow(x, P, row, told, (noise, noise), (takes, takes), np.array([True, False]))
    for one, other in zip(found, learn(x, P, row, told, noise, takes), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_what_moves_follows_and_what_stays_does_not(three: tuple[Numbers, Numbers, Numbers]) -> None:
    """Against Joseph's form, of two readings whose errors share the swift part."""
    x, P, _ = three
    swift, lasting, innovation = 0.2, 30.0, 1e-3
    noise = jnp.full(3, swift), jnp.full(3, swift)
    takes = jnp.asarray(1.0), jnp.asarray(lasting / swift)
    told = map(jnp.asarray, (x, P, ROW, np.full(3, innovation)))
    new, spread, _ = map(np.asarray, follow(*told, noise, takes, np.array([True, False])))
    R = np.array([[swift, swift], [swift, lasting]])
    for j in range(3):
        h, before = ROW[:, j], P[:, :, j]
        gain = before @ h / (h @ before @ h + np.diagonal(R))
        left = np.eye(2) - np.outer(gain, h)
        joseph = left @ before @ left.T + np.diag(gain) @ R @ np.diag(gain)
        np.testing.assert_allclose(new[:, j], x[:, j] + gain * innovation, rtol=1e-6)
        np.testing.assert_allclose(spread[:, :, j], joseph, rtol=1e-6, atol=1e-9)
        assert np.linalg.eigvalsh(spread[:, :, j]).min() > 0


def test_the_surest_of_equally_good_predictions_is_the_likeliest() -> None:
    zero, P, noise = jnp.zeros((1, 2)), jnp.asarray([[[1e-4, 1.0]]]), jnp.full(2, 0.01)
    own = learn(zero, P, jnp.ones((1, 2)), jnp.zeros(2), noise, jnp.asarray(1.0))[2]
    said = weigh(jnp.zeros(2), own, noise, jnp.asarray(1.0), 1.0)
    assert float(said[0] - said[1]) == pytest.approx(0.5 * np.log(1.01 / 0.0101))
    without = weigh(jnp.zeros(2), own, noise, jnp.asarray(1.0))
    assert float(without[0] - without[1]) == 0.0


def test_being_born_anew_keeps_the_moments(three: tuple[Numbers, Numbers, Numbers]) -> None:
    """Hypothesis j becomes the mixture of itself and, with a share, of all."""
    x, P, p = three
    new = np.array([0.0, 0.3, 1.0])
    mean, spread = (np.asarray(a) for a in inherit(*map(jnp.asarray, (x, P, p, new))))
    whole = x @ p
    total = sum(p[j] * (P[:, :, j] + np.outer(x[:, j] - whole, x[:, j] - whole)) for j in range(3))
    for j, share in enumerate(new):
        middle = (1 - share) * x[:, j] + share * whole
        apart, away = x[:, j] - middle, whole - middle
        expected = (1 - share) * (P[:, :, j] + np.outer(apart, apart)) + share * (
            total + np.outer(away, away)
        )
        np.testing.assert_allclose(mean[:, j], middle, atol=1e-12)
        np.testing.assert_allclose(spread[:, :, j], expected, atol=1e-12)


def test_moments_are_those_of_samples(three: tuple[Numbers, Numbers, Numbers]) -> None:
    x, P, p = three
    rng = np.random.default_rng(0)
    which = rng.choice(3, 200_000, p=p)
    samples = np.empty((len(which), 2))
    for j in range(3):
        chosen = which == j
        samples[chosen] = rng.multivariate_normal(x[:, j], P[:, :, j], chosen.sum())
    variance = np.stack([P[0, 0], P[1, 1]])
    mean, std = moments(*map(jnp.asarray, (x, variance, p)))
    np.testing.assert_allclose(np.asarray(mean), samples.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(np.asarray(std), samples.std(axis=0), rtol=0.01)


@pytest.mark.parametrize("takes", [1.0, 20.0, 200.0])
def test_a_state_that_explains_all_pays_for_it_once(takes: float) -> None:
    """A constant offset that samples keep telling costs a hypothesis what its prior says of it.

    That is Δ²/2P in all, however many samples make an independent one (5/8 instead of 1/2: Student's t).
    """
    offset, P0, noise = 0.3, 1.0, 0.01
    x, P = jnp.zeros((1, 1)), jnp.full((1, 1, 1), P0)
    total, step = 0.0, jax.jit(learn)
    for _ in range(int(400 * takes**0.5)):
        innovation = offset - x[0]
        counts = jnp.full(1, noise), jnp.asarray(takes)
        x, P, own = step(x, P, jnp.ones((1, 1)), innovation, *counts)
        total += float(weigh(innovation, own, *counts)[0])
    assert float(x[0, 0]) == pytest.approx(offset, abs=0.01)
    assert total == pytest.approx(-0.625 * offset**2 / P0, rel=0.25)


def hump(place: float, width: float) -> Numbers:
    """Of 32 weights, not normalised."""
    return np.exp(-0.5 * ((np.arange(32) - place) / width) ** 2)


@pytest.mark.parametrize("place", [5.0, 5.3, 17.5, 26.81])
@pytest.mark.parametrize("width", [1.0, 1.5, 4.0])
def test_the_likeliest_of_a_gaussian_is_its_mean(place: float, width: float) -> None:
    assert float(likeliest(jnp.asarray(hump(place, width)))) == pytest.approx(place, abs=2e-3)


def test_the_likeliest_of_two_humps_is_in_the_higher_one() -> None:
    rows = jnp.asarray([hump(6, 1.5) + 0.8 * hump(24, 1.5), 0.8 * hump(6, 1.5) + hump(24, 1.5)])
    np.testing.assert_allclose(likeliest(rows), [6, 24], atol=1e-3)


def test_a_single_weight_is_not_the_likeliest_beside_a_hump() -> None:
    p = hump(20, 3.0) + 1.4 * (np.arange(32) == 3)
    assert float(likeliest(jnp.asarray(p))) == pytest.approx(20, abs=0.01)


def test_the_likeliest_stays_on_the_grid() -> None:
    rows = jnp.asarray([hump(-3, 2.0), hump(40, 2.0), np.ones(32)])
    np.testing.assert_allclose(likeliest(rows), [0, 31, 15.5], atol=0.5)
