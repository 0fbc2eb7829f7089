"""Roads that change, seldom or often."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from benchmarks.patches import judged, recorded

from roadstate.estimators import road_changes
from roadstate.estimators.slip_jump import MODES, STAYS

FRICTION = np.geomspace(0.06, 1.35, 32)
SPACING = float(np.log(FRICTION[1] / FRICTION[0]))
DRY, OTHER = np.exp(-0.5 * (np.log(FRICTION / 0.9) / 0.15) ** 2), FRICTION < 0.9
PRIOR = jnp.asarray(0.5 * DRY / DRY.sum() + 0.5 * OTHER / OTHER.sum())
STEP = 0.02


def start(prior: jax.Array = PRIOR) -> jax.Array:
    """One part of the car, of whose friction the prior is known."""
    weight = jnp.zeros((road_changes.KINDS, MODES, 1, len(FRICTION)))
    return weight.at[:, STAYS].set(road_changes.first(prior)[:, None])


def driven(p: jax.Array, likelihood: jax.Array, distance: float) -> jax.Array:
    """Weights after steps (T,), each with the likelihood (T, J) of what it showed."""

    def step(p: jax.Array, likelihood: jax.Array) -> tuple[jax.Array, None]:
        p, _ = road_changes.moved(p, PRIOR, SPACING, jnp.asarray(distance), jnp.asarray(STEP))
        p = p * likelihood
        return p / p.sum(), None

    return jax.lax.scan(step, p, likelihood)[0]


def often(p: jax.Array) -> float:
    """Probability of a road that often changes."""
    return float(p[1].sum() / p.sum())


def shows(friction: float, count: int) -> jax.Array:
    """Likelihood of so many samples that tell one friction, to a tenth."""
    row = np.exp(-0.5 * (np.log(FRICTION / friction) / 0.1) ** 2) + 1e-9
    return jnp.asarray(np.tile(row, (count, 1)))


def test_nothing_is_lost() -> None:
    p = start()
    moved, begun = road_changes.moved(p, PRIOR, SPACING, jnp.asarray(0.4), jnp.asarray(STEP))
    assert float(moved.sum()) == pytest.approx(1, abs=1e-12)
    seldom, frequent = (1 - np.exp(-0.4 * rate) for rate in road_changes._CHANGES)
    share = road_changes._OFTEN
    np.testing.assert_allclose(begun[0], ((1 - share) * seldom + share * frequent) * PRIOR, rtol=1e-6)


def test_without_evidence_kinds_stay_as_likely_as_they_are() -> None:
    blank = jnp.ones((4000, len(FRICTION)))
    assert often(driven(start(), blank, 0.3)) == pytest.approx(road_changes._OFTEN, rel=1e-6)
    changed = start().at[:].multiply(jnp.asarray([0.1, 10.0])[:, None, None, None])
    assert often(driven(changed / changed.sum(), blank, 0.3)) == pytest.approx(road_changes._OFTEN, rel=0.03)


def test_at_rest_nothing_changes() -> None:
    p = driven(start(), shows(0.3, 50), 0.3)
    later = driven(p, jnp.ones((500, len(FRICTION))), 0.0)
    np.testing.assert_allclose(later.sum(axis=(0, 1)), p.sum(axis=(0, 1)), atol=1e-12)


def test_changes_soon_after_each_other_tell_that_the_road_often_does() -> None:
    """A single one in a long while hardly does; and a road that stays tells the contrary."""
    metres = 0.3
    stays = driven(start(), shows(0.9, 1000), metres)
    once = driven(stays, shows(0.25, 20), metres)
    again = driven(once, shows(0.9, 20), metres)
    thrice = driven(again, shows(0.25, 20), metres)
    assert often(stays) < road_changes._OFTEN
    assert often(once) < 0.05
    assert often(again) > 0.2
    assert often(thrice) > 0.8
    assert often(driven(thrice, shows(0.25, 1000), metres)) < 0.02


def test_what_a_patch_has_told_is_soon_forgotten() -> None:
    """Twenty metres after many changes a third of it is left, and after a single one nearly all."""
    blank = jnp.ones((67, len(FRICTION)))
    p = driven(start(), shows(0.9, 500), 0.3)
    single = driven(driven(p, shows(0.25, 20), 0.3), blank, 0.3)
    for _ in range(3):
        p = driven(driven(p, shows(0.25, 20), 0.3), shows(0.9, 20), 0.3)
    many = driven(driven(p, shows(0.25, 20), 0.3), blank, 0.3)
    near = np.abs(np.log(FRICTION / 0.25)) < 0.25
    assert float(single.sum(axis=(0, 1, 2))[near].sum()) > 0.7
    assert float(many.sum(axis=(0, 1, 2))[near].sum()) < 0.4


@pytest.mark.usefixtures("optimised")
def test_patches_of_ice() -> None:
    """Bounds may be wide there, but hold."""
    found = judged(recorded("family-car", "across the road", 0, 2), "joint")
    assert found["above lower bound"] > 85
    assert found["below upper bound"] > 80
