"""The innovation gate: tells apart what was not tested, passed and rejected, and never locks a filter out."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from filters.models import Matrices, TimeVarying, run_jit
from roadstate.core.gaussian import Gate, Gaussian
from roadstate.filters import KF, UKF, GateRule

NAN = np.nan
STEPS = 40


def run(method: Any, z: Any) -> tuple[Any, Any]:
    """A constant seen by two good sensors."""
    model = TimeVarying(("x",), ("a", "b"), Gaussian(jnp.zeros(1), jnp.ones((1, 1))))
    fixed = Matrices(np.eye(1), np.zeros(1), 0.01 * np.eye(1), np.ones((2, 1)), np.zeros(2), 0.1 * np.eye(2))
    u = jax.tree.map(lambda a: jnp.broadcast_to(a, (STEPS, *a.shape)), fixed)
    posteriors, infos, _ = run_jit(method, model, u, jnp.asarray(z), jnp.ones(STEPS))
    return posteriors, infos


@pytest.fixture
def quiet() -> np.ndarray:
    return np.random.default_rng(0).normal(scale=0.1, size=(STEPS, 2))


@pytest.mark.parametrize("method", [KF, UKF])
def test_a_spike_is_rejected_as_if_it_were_missing(method: Any, quiet: np.ndarray) -> None:
    spiked, missing = quiet.copy(), quiet.copy()
    spiked[20, 0], missing[20, 0] = 5.0, NAN
    gated, told = run(method(gate=GateRule()), spiked)
    expected, told_missing = run(method(gate=GateRule()), missing)
    np.testing.assert_array_equal(gated.mean, expected.mean)
    np.testing.assert_array_equal(gated.factor, expected.factor)
    np.testing.assert_array_equal(told.nis, told_missing.nis)
    codes = np.full((STEPS, 2), Gate.PASSED)
    codes[20, 0] = Gate.REJECTED
    np.testing.assert_array_equal(told.gate, codes)
    assert told_missing.gate[20, 0] == Gate.NOT_TESTED
    assert float(told.innovation[20, 0]) == pytest.approx(5, abs=0.2)  # what was rejected is still told
    ungated, _ = run(method(), spiked)
    assert abs(ungated.mean[20, 0]) > 5 * abs(gated.mean[20, 0])


def test_a_sensor_that_insists_is_believed_after_patience(quiet: np.ndarray) -> None:
    z = quiet.copy()
    z[10:] += 3.0  # both sensors say so: the world has changed
    posteriors, told = run(KF(gate=GateRule(patience=4)), z)
    codes = np.asarray(told.gate)
    assert (codes[:10] == Gate.PASSED).all()
    assert (codes[10:14] == Gate.REJECTED).all()
    assert (codes[14] == Gate.PASSED).all()
    assert abs(posteriors.mean[13, 0]) < 0.2
    assert posteriors.mean[-1, 0] > 2  # not locked out


def test_one_broken_sensor_does_not_pull_the_other(quiet: np.ndarray) -> None:
    z = quiet.copy()
    z[5:, 1] = 1e6 * np.arange(STEPS - 5)
    posteriors, told = run(KF(gate=GateRule(patience=10**6)), z)
    assert np.abs(posteriors.mean).max() < 0.3
    assert (told.gate[6:, 1] == Gate.REJECTED).all()
    assert (told.gate[:, 0] == Gate.PASSED).all()


def rule(squared: Any, present: Any, rejected: Any, **settings: Any) -> list[list[int]]:
    out = GateRule(**settings)(jnp.asarray(squared), jnp.asarray(present), jnp.asarray(rejected))
    return [np.asarray(o).astype(int).tolist() for o in out]


def test_the_rule_by_hand() -> None:
    used, codes, rejected = rule(
        [19.5, 19.6, 19.6, NAN, np.inf, 0.0, 99.0],
        [True, True, True, True, True, False, False],
        [3, 3, 10, 0, 0, 5, 5],
    )
    assert used == [1, 0, 1, 0, 0, 0, 0]
    assert codes == [1, 2, 1, 2, 2, 0, 0]
    # accepted: cleared; refused: one more; believed again: cleared; missing: as it was
    assert rejected == [0, 4, 0, 1, 1, 5, 5]


@given(st.lists(st.tuples(st.floats(0, 1e3), st.booleans()), min_size=1, max_size=60), st.integers(1, 5))
def test_never_more_refusals_in_a_row_than_patience(samples: list[tuple[float, bool]], patience: int) -> None:
    counter, in_a_row = np.zeros(1, int), 0
    for squared, present in samples:
        (used,), (code,), counter = rule([squared], [present], counter, patience=patience)
        if present:
            in_a_row = 0 if used else in_a_row + 1
        assert in_a_row <= patience
        assert used == (code == Gate.PASSED)
        assert (code == Gate.NOT_TESTED) == (not present)


@pytest.mark.parametrize(("threshold", "odds"), [(10.83, 1e-3), (15.14, 1e-4), (19.51, 1e-5)])
def test_the_thresholds_documented(threshold: float, odds: float) -> None:
    assert chi2.sf(threshold, 1) == pytest.approx(odds, rel=0.01)


@pytest.mark.parametrize(
    "settings", [{"threshold": 0.0}, {"threshold": -1.0}, {"threshold": NAN}, {"patience": 0}]
)
def test_a_rule_without_sense_is_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=f"{next(iter(settings))} must be"):
        GateRule(**settings)
