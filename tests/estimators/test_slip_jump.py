"""Jumps of slip: what tells a new road, and what must not."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from roadstate.estimators import slip_jump
from roadstate.estimators.friction_bank import FrictionBank
from roadstate.estimators.friction_curve import elastic
from roadstate.estimators.sideways import Touch
from roadstate.vehicles import load_vehicle

STIFFNESS = 20.0
FORCE = 0.2
DT = 0.01


def touch(slip: Array, force: Array, shared: float = 0.02) -> Touch:
    """Straight on at 14 m/s; all that is not given is zero."""
    zero = jnp.zeros(())
    return Touch(
        speed=zero + 14.0, accel_y=zero, yaw_rate=zero, yaw_accel=zero, lateral=zero, angle=jnp.zeros(2),
        across=jnp.zeros(2), along=jnp.asarray(force), slip=jnp.asarray(slip), slip_std=jnp.full(4, 0.0015),
        slip_shared=zero + shared, across_std=jnp.zeros(2), along_std=jnp.zeros(4), transfer=jnp.zeros(2),
        lag=zero + 0.05,
    )  # fmt: skip


def gains(before: list[float], after: list[float], force: float = FORCE, then: float = FORCE) -> Array:
    """:func:`jumps` from one set of slips (beyond the force's) to the next."""
    stiffness, unknown = jnp.asarray(STIFFNESS), jnp.full(4, slip_jump.NOTHING)
    known = slip_jump.unexplained(touch(_slips(before, force), np.full(4, force)), stiffness, unknown)
    new = touch(_slips(after, then), np.full(4, then))
    return slip_jump.jumps(slip_jump.unexplained(new, stiffness, known), known, new)


def _slips(beyond: list[float], force: float) -> Array:
    told = force / STIFFNESS + np.asarray(beyond)
    return told / (1 - told)  # practical slip


@pytest.mark.parametrize("sign", [1, -1])
def test_an_axle_that_comes_onto_ice_jumps(sign: int) -> None:
    found = gains([0, 0, 0, 0], [sign * 0.009, sign * 0.009, 0, 0], sign * FORCE, sign * FORCE)
    np.testing.assert_allclose(found, [0.009, 0.009, 0, 0], atol=1e-12)


def test_a_speed_that_follows_the_wheels_hides_no_jump() -> None:
    found = gains([0, 0, 0, 0], [0.007, 0.007, -0.0015, -0.0015])
    np.testing.assert_allclose(found[:2], 0.0085, atol=1e-12)
    found = gains([0, 0, 0, 0], [0.007, 0.007, -0.008, -0.008])  # so far no speed follows
    np.testing.assert_allclose(found[:2], 0.009, atol=1e-12)


@pytest.mark.parametrize(
    ("before", "after", "force", "then"),
    [
        ([0, 0, 0, 0], [0.01] * 4, FORCE, FORCE),  # the speed errs
        ([0, 0, 0, 0], [-0.01] * 4, FORCE, FORCE),
        ([0.003, 0.002, -0.002, 0.0], [0.003, 0.002, -0.002, 0.0], FORCE, FORCE),  # radii differ
        ([0.003, 0.002, -0.002, 0.0], [0.003, 0.002, -0.002, 0.0], FORCE, -FORCE),  # and now it brakes
        ([0.15, 0.15, 0, 0], [0.001, 0.002, 0, 0], FORCE, FORCE),  # comes back from spinning
        ([0.15, 0.15, 0, 0], [-0.005, -0.005, 0, 0], FORCE, -0.02),  # and the engine drags
        ([0.15, 0, 0.15, 0], [0.01, 0, 0.01, 0], FORCE, FORCE),  # the left wheels, on a split road
    ],
)
def test_what_no_road_does_is_no_jump(
    before: list[float], after: list[float], force: float, then: float
) -> None:
    assert float(gains(before, after, force, then).max()) < 0.0021


def test_a_wheel_that_falls_silent_and_comes_back_has_not_jumped() -> None:
    memory, here = jnp.zeros(4), touch(_slips([0.0] * 4, FORCE), np.full(4, FORCE))
    silent = here._replace(slip=here.slip.at[0].set(0.0), along_std=here.along_std.at[0].set(jnp.inf))
    kept = slip_jump.unexplained(silent, jnp.asarray(STIFFNESS), memory)
    assert float(kept[0]) == float(memory[0])
    back = slip_jump.unexplained(here, jnp.asarray(STIFFNESS), kept)
    np.testing.assert_allclose(slip_jump.jumps(back, kept, here), 0.0, atol=1e-12)


def told(jump: Array, friction: Array, force: float = FORCE, changed: float = 0.0) -> Array:
    """:func:`evidence` of one sample for the front axle."""
    here = touch(np.full(4, 0.012), np.full(4, force))
    bent = elastic(jnp.full((4, 1), force), jnp.asarray(friction), jnp.asarray(1.45))
    moved = slip_jump.Jump(jnp.concatenate([jnp.asarray(jump), jnp.zeros(2)]), jnp.full(4, changed))
    found = slip_jump.evidence(
        moved, here, jnp.zeros((4, len(friction))), jnp.asarray(STIFFNESS), jnp.asarray(friction), bent,
        jnp.full((4, 1), 0.008), jnp.asarray(DT),
    )  # fmt: skip
    return found[:2]


def test_evidence_is_against_roads_on_which_no_wheel_slips_so_much() -> None:
    friction = np.geomspace(0.1, 1.3, 30)
    found = np.asarray(told(np.array([0.009, 0.009]), friction))
    assert (found <= 0).all()
    assert (np.diff(found, axis=1) <= 1e-12).all()  # the more a road bears, the less it lets slip
    assert (found[:, friction > 0.5] < -0.3).all()
    assert (found[:, friction < (FORCE + 4 * 0.008) / 0.8] == 0).all()  # near the limit any slip may be
    may = (elastic(jnp.asarray(FORCE), jnp.asarray(friction), jnp.asarray(1.45)) - FORCE) / STIFFNESS
    explained = np.asarray(told(np.full(2, float(may[np.searchsorted(friction, 0.32)])), friction))
    assert (explained[:, friction <= 0.32] == 0).all()


def test_evidence_needs_more_than_noise_and_a_force_that_stays() -> None:
    dry = np.array([0.9])
    assert (np.asarray(told(np.array([0.001, 0.0012]), dry)) == 0).all()
    assert (np.asarray(told(np.array([-0.02, -0.02]), dry)) == 0).all()
    sudden, slow = told(np.array([0.006, 0.006]), dry), told(np.array([0.006, 0.006]), dry, changed=0.3)
    assert (np.asarray(sudden) < 5 * np.asarray(slow)).all()
    one, both = told(np.array([0.004, 0.0]), dry), told(np.array([0.004, 0.004]), dry)
    assert float(both[0, 0]) < float(one[0, 0]) < 0
    assert float(one[1, 0]) == 0  # a split road is no matter of the other side


def changes(jump: Array, friction: Array, force: float = FORCE, changed: float = 0.0) -> Array:
    """:func:`changed` of one sample for the front axle, all frictions alike beforehand."""
    here = touch(np.full(4, 0.012), np.full(4, force))
    moved = slip_jump.Jump(jnp.concatenate([jnp.asarray(jump), jnp.zeros(2)]), jnp.full(4, changed))
    prior = jnp.full(len(friction), -np.log(len(friction)))
    found = slip_jump.changed(
        moved, here, jnp.asarray(STIFFNESS), jnp.asarray(friction), prior, jnp.asarray(DT)
    )
    return np.asarray(found[:2])


def test_a_road_changes_to_what_lets_a_wheel_slip_so_much() -> None:
    """Within the 20 samples that a jump's error lasts surely; and to a road as slippery as that."""
    friction = np.geomspace(0.1, 1.3, 30)
    found = changes(np.array([0.009, 0.009]), friction)
    assert (1 - (1 - found.sum(axis=1)) ** 20 > 0.99).all()
    assert (np.diff(found, axis=1) <= 1e-12).all()
    assert (found[:, friction > 0.5].sum(axis=1) < 0.01 * found.sum(axis=1)).all()
    assert (
        np.ptp(found[:, friction < 0.24], axis=1).max() < 1e-9
    )  # near its friction a tire slips by anything


def test_a_road_does_not_change_by_noise_nor_by_what_forces_explain() -> None:
    friction = np.geomspace(0.1, 1.3, 30)
    assert (changes(np.array([0.001, 0.0012]), friction) == 0).all()
    assert (changes(np.array([-0.02, -0.02]), friction) == 0).all()
    assert changes(np.array([0.006, 0.006]), friction, changed=0.3).sum() < 0.01
    one = changes(np.array([0.004, 0.0]), friction).sum(axis=1)
    assert 0 < one[0] < changes(np.array([0.004, 0.004]), friction)[0].sum()
    assert one[1] == 0


@pytest.fixture(scope="module")
def middle() -> Callable[[Array, Array], Array]:
    """Slips and forces (k, 4) → lower bounds and middle values of the front and the rear wheels' friction at
    the end."""
    bank = FrictionBank(load_vehicle("suv"))

    @jax.jit
    def run(slips: Array, forces: Array) -> Array:
        def one(state, each):  # type: ignore[no-untyped-def]
            return bank.step(state, touch(*each), jnp.asarray(DT))[0], None

        state, _ = jax.lax.scan(one, bank.init(), (slips, forces))
        return bank.quantiles(state, (0.05, 0.5))[:, 1:3]

    return run


@pytest.mark.parametrize("what", ["ice", "the speed errs", "the front axle is softer"])
def test_all_wheels_driven_onto_ice(middle: Callable[[Array, Array], Array], what: str) -> None:
    """Where nothing rolls freely, only the jump tells."""
    vehicle = load_vehicle("suv")
    forces = np.where(np.arange(316) < 100, 2 * FORCE, FORCE)[:, None] * np.ones(4)
    slips = (
        np.asarray(elastic(forces, vehicle.tires.friction, vehicle.tires.shape))
        / vehicle.tires.slip_stiffness
    )
    slips = slips + 0.001 * np.random.default_rng(2).standard_normal(slips.shape)
    if what == "ice":
        slips[300:, :2] += 0.009
    elif what == "the speed errs":
        slips[300:] += 0.009
    else:
        slips[:, :2] *= 1.15
    found = np.asarray(middle(jnp.asarray(slips), jnp.asarray(forces)))[1]
    assert found[0] < 0.3 if what == "ice" else found[0] > 0.7
    assert found[1] > 0.6  # where the rear wheels are nothing has changed yet
    if what == "ice":  # 21 m farther traction control holds a smaller force, which tells nothing new
        later = np.full((150, 4), 0.6 * FORCE)
        rolls = later / vehicle.tires.slip_stiffness
        slips, forces = np.concatenate([slips, rolls]), np.concatenate([forces, later])
        found = np.asarray(middle(jnp.asarray(slips), jnp.asarray(forces)))[1]
        assert (found < 0.4).all()


def test_what_was_likely_of_the_old_road_says_nothing_of_the_new(
    middle: Callable[[Array, Array], Array],
) -> None:
    """Driven with 0.32 of the load, a car knows that its road bears more. Then its front wheels come onto
    0.2; that the new road may bear as little must not be ruled out by what the old one bore."""
    vehicle = load_vehicle("suv")
    now = np.arange(320)
    forces = np.select([now < 200, now < 300], [0.32, 0.21], 0.19)[:, None] * np.ones(4)
    dry, ice = (np.asarray(elastic(forces, mu, vehicle.tires.shape)) for mu in (0.8, 0.2))
    slips = np.where((now[:, None] >= 300) & (np.arange(4) < 2), ice, dry)
    slips = slips / vehicle.tires.slip_stiffness
    slips = slips + 0.0005 * np.random.default_rng(3).standard_normal(slips.shape)
    lower, found = np.asarray(middle(jnp.asarray(slips), jnp.asarray(forces)))
    assert lower[0] < 0.15
    assert 0.17 < found[0] < 0.23
    assert found[1] > 0.6
