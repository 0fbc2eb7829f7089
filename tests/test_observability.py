"""Empirical Gramians against exact ones, and what they say of four frictions seen through three sums."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from filters.models import random_time_varying, run_jit
from oracles.filter_models import Friction, Radar, drive
from roadstate.filters import KF
from roadstate.observability import Direction, directions, empirical_gramian, remaining_share, unobservable

STEPS = 30
WHEELS = ("fl", "fr", "rl", "rr")


def exact(u: Any, S: np.ndarray, begin: int, end: int, present: np.ndarray) -> np.ndarray:
    """Sᵀ Σ Φᵀ Hᵀ R⁻¹ H Φ S with Φ from the window's first sample on."""
    n = S.shape[0]
    W, transition = np.zeros((n, n)), np.eye(n)
    for k in range(begin, end):
        if k > begin:
            transition = u.F[k] @ transition
        there = present[k]
        H, R = u.H[k][there], (u.L[k] @ u.L[k].T)[np.ix_(there, there)]
        W += (H @ transition @ S).T @ np.linalg.inv(R) @ (H @ transition @ S)
    return W


@pytest.mark.parametrize(("window", "every"), [(None, 1), (7, 1), (10, 10), (1, 29)])
def test_it_is_the_gramian_of_a_linear_system(window: int | None, every: int) -> None:
    model, u, dt = random_time_varying(4, 3, 2, STEPS)
    random = np.random.default_rng(0)
    S = random.normal(size=(3, 3))
    present = random.random((STEPS, 2)) < 0.8
    states = random.normal(size=(STEPS, 3))
    W = empirical_gramian(
        model,
        states,
        u,
        dt,
        S,
        window=window,
        every=every,
        present=present,  # type: ignore[arg-type]
    )
    length = window or STEPS
    starts = range(0, STEPS - length + 1, every)
    assert len(W) == len(starts)
    for found, start in zip(W, starts, strict=True):
        np.testing.assert_allclose(found, exact(u, S, start, start + length, present), rtol=1e-8, atol=1e-9)


def test_remaining_share_is_the_kalman_filters_without_process_noise() -> None:
    """The first sample's step has no time, so the prior is that of the first sample."""
    model, u, dt = random_time_varying(4, 3, 2, STEPS)
    u = u._replace(
        G=0 * u.G, F=np.concatenate([np.eye(3)[None], u.F[1:]]), b=np.concatenate([0 * u.b[:1], u.b[1:]])
    )
    S = np.asarray(model.prior().factor)
    W = empirical_gramian(model, jnp.zeros((STEPS, 3)), u, jnp.asarray(dt), S)[0]
    share = remaining_share(W, S)
    posterior = run_jit(KF(), model, u, jnp.zeros((STEPS, 2)), jnp.asarray(dt))[0]
    whole = np.eye(3)
    for k in range(1, STEPS):
        whole = u.F[k] @ whole
    back = np.linalg.solve(whole, np.asarray(posterior.factor[-1]))  # at the last sample → at the first
    expected = np.sqrt(np.sum(back**2, axis=1) / np.sum(S**2, axis=1))
    np.testing.assert_allclose(share, expected, rtol=1e-6)


class TestFourFrictionsThroughThreeSums:
    """z = u x with u (3, 4), whose rows for a_x and a_y are alike: two sums at an instant, three in time."""

    S = np.full(4, 0.3)

    def gramian(self, u: np.ndarray, **settings: Any) -> Any:
        states, dt = jnp.full((len(u), 4), 0.6), jnp.full(len(u), 0.01)
        return empirical_gramian(Friction(), states, jnp.asarray(u), dt, self.S, **settings)

    def assert_unseen(self, found: list[Direction], u: np.ndarray, count: int) -> None:
        assert len(found) == count
        for direction in found:
            change = np.array([direction.change[w] for w in WHEELS])
            np.testing.assert_allclose(u.reshape(-1, 4) @ change, 0, atol=1e-6)  # no sample moves
            assert np.linalg.norm(change / self.S) == pytest.approx(1.0)
            assert direction.remaining == pytest.approx(1.0, abs=1e-6)
            assert direction.words.endswith("100 % of the prior 1σ")
            for wheel, step in direction.change.items():
                if abs(step) >= 0.2 * np.abs(change).max():
                    assert f"{wheel} {'up' if step > 0 else 'down'} by {abs(step):.3g}" in direction.words

    def test_a_single_instant_leaves_two_directions(self) -> None:
        u = drive(400, 0.01, 1.0)
        W = self.gramian(u, window=1)[37]
        self.assert_unseen(unobservable(WHEELS, W, self.S), u[37], 2)

    def test_so_does_straight_braking_however_long(self) -> None:
        u = drive(400, 0.01, 0.0)
        W = self.gramian(u)[0]
        self.assert_unseen(unobservable(WHEELS, W, self.S), u, 2)
        assert all(d.remaining < 0.1 for d in directions(WHEELS, W, self.S)[2:])

    def test_weaving_leaves_one_left_against_right_across_the_axles(self) -> None:
        """fl − fr against rl − rr: yaw by braking sees −0.8 (fl − fr) − 0.7 (rl − rr), so 7 against −8."""
        u = drive(400, 0.01, 1.0)
        unseen = unobservable(WHEELS, self.gramian(u)[0], self.S)
        self.assert_unseen(unseen, u, 1)
        change = np.array([unseen[0].change[w] for w in WHEELS])
        np.testing.assert_allclose(np.abs(change / change[0]), [1, 1, 8 / 7, 8 / 7], rtol=1e-6)
        assert unseen[0].change["fl"] * unseen[0].change["fr"] < 0
        assert unseen[0].change["fl"] * unseen[0].change["rl"] < 0

    def test_a_sum_of_its_own_shows_them_all(self) -> None:
        u = drive(400, 0.01, 1.0)
        u[:, 1, 0] += 1.0
        W = self.gramian(u)[0]
        assert unobservable(WHEELS, W, self.S) == []
        assert (remaining_share(W, self.S) < 0.2).all()

    def test_shares_are_of_one_state_and_of_one_direction(self) -> None:
        W = np.diag([3.0, 0.0, 0.0, 99.0])
        np.testing.assert_allclose(remaining_share(W, self.S), [0.5, 1.0, 1.0, 0.1])
        np.testing.assert_allclose([d.remaining for d in directions(WHEELS, W, self.S)], [1, 1, 0.5, 0.1])
        assert directions(WHEELS, W, self.S)[3].words == "rr alone: the samples leave 10 % of the prior 1σ"
        np.testing.assert_allclose(remaining_share(np.stack([W, 0 * W]), self.S)[1], 1.0)


def test_a_step_of_the_size_of_the_uncertainty_sees_what_saturates() -> None:
    """Bearing of a target uncertain by as much as it is away: a Jacobian would promise far more."""
    model = Radar(range_std=1e6)
    state = jnp.asarray([[10.0, 0.0, 0.0, 0.0]])
    dt = jnp.zeros(1)

    def across(std: float) -> float:
        W = empirical_gramian(model, state, None, dt, jnp.asarray([1e-9, std, 1e-9, 1e-9]))
        return float(W[0, 1, 1]) * 0.01**2 / std**2

    assert across(1e-4) == pytest.approx(1 / 10**2, rel=1e-6)  # (∂bearing/∂y)² at 10 m
    assert across(20.0) == pytest.approx((np.arctan(2.0) / 20) ** 2, rel=1e-9)


def test_no_uncertainty_and_no_fit() -> None:
    W = np.zeros((2, 2))
    np.testing.assert_array_equal(remaining_share(W, np.array([1.0, 0.0])), [1, 0])
    for window, every in ((0, 1), (5, 1), (2, 0)):
        with pytest.raises(ValueError, match="do not fit 4 samples"):
            empirical_gramian(
                Friction(),
                jnp.ones((4, 4)),
                jnp.zeros((4, 3, 4)),
                jnp.ones(4),
                jnp.ones(4),
                window=window,
                every=every,
            )


def test_single_precision() -> None:
    model = Friction(walk=jnp.float32(1e-3), noise=jnp.float32(0.05), spread=jnp.float32(0.3))
    u = jnp.asarray(drive(50, 0.01, 1.0), jnp.float32)
    arguments = (
        jnp.full((50, 4), 0.6, jnp.float32),
        u,
        jnp.full(50, 0.01, jnp.float32),
        jnp.full(4, 0.3, jnp.float32),
    )
    assert empirical_gramian(model, *arguments).dtype == jnp.float32
