"""Jumps of slip: what tells a new road, and what must not."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from tests.estimators.tires_on_road import straight_on

from roadstate.estimators import slip_jump
from roadstate.estimators.friction_bank import FrictionBank
from roadstate.estimators.friction_curve import elastic
from roadstate.estimators.sideways import Touch
from roadstate.vehicles import load_vehicle

STIFFNESS = 20.0
FORCE = 0.2
DT = 0.01


def touch(slip: Array, force: Array, shared: float = 0.02) -> Touch:
    """Straight on at 14 m/s."""
    return straight_on(force, slip, speed=14.0)._replace(
        slip_std=jnp.full(4, 0.0015), slip_shared=jnp.asarray(shared)
    )


def gains(before: list[float], after: list[float], force: float = FORCE, then: float = FORCE) -> Array:
    """:func:`jumps` from one set of slips (beyond the force's) to the next."""
    stiffness = jnp.asarray(STIFFNESS)
    known = slip_jump.unexplained(touch(_slips(before, force), np.full(4, force)), stiffness)
    new = touch(_slips(after, then), np.full(4, then))
    return slip_jump.jumps(slip_jump.unexplained(new, stiffness), known, new)


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


def told(
    jump: Array,
    friction: Array,
    force: float = FORCE,
    grown: float = 0.0,
    slip: float = 0.012,
    before: float = 0.0,
) -> Array:
    """:func:`evidence` of one sample for the front axle: (modes, 2, J)."""
    here = touch(np.full(4, slip), np.full(4, force))
    bent = elastic(jnp.full((4, 1), force), jnp.asarray(friction), jnp.asarray(1.45))
    moved = slip_jump.Jump(
        jnp.concatenate([jnp.asarray(jump), jnp.zeros(2)]), jnp.full(4, grown), jnp.full(4, before)
    )
    found = slip_jump.evidence(
        moved, here, jnp.zeros((4, len(friction))), jnp.asarray(STIFFNESS), jnp.asarray(friction), bent,
        jnp.full((4, 1), 0.008), jnp.asarray(DT),
    )  # fmt: skip
    return found.likelihood[:, :2]


FRICTION = np.geomspace(0.1, 1.3, 30)
ICE, DRY = FRICTION < 0.23, FRICTION > 0.5


def test_a_wheel_that_slips_on_at_the_same_force_has_come_onto_ice() -> None:
    stays, began, shaken = np.asarray(told(np.array([0.009, 0.009]), FRICTION))
    assert (stays < -0.1).all()  # the road may bear what it will, it has not stayed
    assert (began[:, ICE] == 0).all()
    assert (began[:, DRY] < -0.3).all()
    assert (np.diff(began, axis=1) <= 1e-12).all()  # the more a road bears, the less it lets slip
    assert (stays[:, DRY] < shaken[:, DRY]).all()  # a bump explains any jump
    assert (shaken < 0).all()  # but not as well as a road on which it must be as it is


def test_a_wheel_that_slips_no_more_has_come_onto_no_ice() -> None:
    stays, began, shaken = np.asarray(told(np.array([0.0, 0.0]), FRICTION, force=0.3))
    assert (stays == 0).all()
    assert (shaken == 0).all()
    assert (began[:, ICE] < 0).all()
    assert (began[:, DRY] == 0).all()


def test_a_wheel_that_had_slipped_may_come_onto_any_road() -> None:
    began = np.asarray(told(np.array([-0.02, -0.02]), FRICTION, before=0.025))[slip_jump.BEGAN]
    assert (began[:, DRY] == 0).all()


def test_noise_tells_nothing_and_two_wheels_tell_more_than_one() -> None:
    assert (np.asarray(told(np.array([0.001, 0.0012]), FRICTION))[slip_jump.STAYS] == 0).all()
    assert (np.asarray(told(np.array([-0.02, -0.02]), FRICTION))[slip_jump.STAYS] == 0).all()
    one, both = (np.asarray(told(np.array(each), FRICTION)) for each in ([0.005, 0.0], [0.005, 0.005]))
    assert (both[slip_jump.STAYS, 0] < one[slip_jump.STAYS, 0]).all()
    assert (one[slip_jump.STAYS, 0] < 0).all()
    assert (one[slip_jump.STAYS, 1] == 0).all()  # a split road is no matter of the other side


def test_a_force_that_has_grown_may_make_a_wheel_slip_on_a_road_that_stays() -> None:
    jump = np.array([0.009, 0.009])
    stays = np.asarray(told(jump, FRICTION, grown=0.1))[slip_jump.STAYS]
    assert (stays[:, ICE] == 0).all()  # it has come to its limit
    assert (stays[:, DRY] < 0).all()
    assert (stays[:, DRY] > np.asarray(told(jump, FRICTION))[slip_jump.STAYS][:, DRY]).all()


def test_a_bump_explains_a_small_slip_and_hardly_a_large_one() -> None:
    """Wheels that spin up to a slip of .08 are no shaken ones: on a dry road that costs more than twice."""
    small, large = (
        np.asarray(told(np.array([slip, slip]), FRICTION, slip=slip))[slip_jump.SHAKEN][:, DRY]
        for slip in (0.02, 0.08)
    )
    assert (large < 2 * small).all()
    assert (small > -25.0 * DT).all()


def test_a_tire_that_slid_already_may_slide_more_at_its_limit() -> None:
    """As where traction control lets it spin and catches it again."""
    jump = np.array([0.03, 0.03])
    slid = np.asarray(told(jump, FRICTION, slip=0.07, before=0.04))[slip_jump.STAYS]
    assert (slid[:, ICE] == 0).all()
    assert (slid[:, DRY] < 0).all()


def test_a_wheel_that_bears_nothing_tells_of_no_road() -> None:
    """A bump shakes an idle wheel; ice would not make it slip."""
    jump = np.array([0.009, 0.009])
    assert (np.asarray(told(jump, FRICTION, force=0.015)) == 0).all()
    driven = touch(
        np.full(4, 0.012), np.array([0.2, 0.2, -0.05, -0.05])
    )  # what shakes it seems to be a force
    moved = slip_jump.Jump(jnp.concatenate([jnp.zeros(2), jnp.asarray(jump)]), jnp.zeros(4), jnp.zeros(4))
    bent = elastic(driven.along[:, None], jnp.asarray(FRICTION), jnp.asarray(1.45))
    found = slip_jump.evidence(
        moved, driven, jnp.zeros((4, len(FRICTION))), jnp.asarray(STIFFNESS), jnp.asarray(FRICTION), bent,
        jnp.full((4, 1), 0.008), jnp.asarray(DT),
    )  # fmt: skip
    assert list(np.asarray(found.tells)) == [True, True, False, False]
    assert (np.asarray(found.likelihood)[:, 2:] == 0).all()


def test_a_bump_comes_and_goes_and_a_road_begins_and_stays() -> None:
    p = jnp.zeros((slip_jump.MODES, 1, 2)).at[slip_jump.STAYS].set(0.5)
    born = jnp.array([[0.1, 0.0]])
    after = slip_jump.moved(p, born, jnp.asarray(DT))
    assert float(after.sum()) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(after[slip_jump.BEGAN], born, atol=1e-12)
    assert 0 < float(after[slip_jump.SHAKEN].sum()) < 1e-3
    later = slip_jump.moved(after, jnp.zeros((1, 2)), jnp.asarray(3600.0))
    assert float(later.sum()) == pytest.approx(1.0, abs=1e-9)
    assert float(later[slip_jump.BEGAN].sum()) < 1e-9
    np.testing.assert_allclose(later.sum(axis=0), after.sum(axis=0), rtol=1e-9)


@pytest.fixture(scope="module")
def middle() -> Callable[[Array, Array], Array]:
    """Slips and forces (k, 4) → lower bounds and middle values of the front and the rear wheels' friction at
    the end."""
    bank = FrictionBank(load_vehicle("suv"), ())

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
    forces = np.where(np.arange(330) < 100, 2 * FORCE, FORCE)[:, None] * np.ones(4)
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


@pytest.mark.parametrize("lasts", [3, 12])
def test_a_bump_is_not_taken_for_ice(middle: Callable[[Array, Array], Array], lasts: int) -> None:
    """Wheels that slip for 30 or 120 ms as if on ice, and then no more; and the rear ones as they follow."""
    vehicle = load_vehicle("suv")
    forces = np.full((360, 4), FORCE)
    slips = (
        np.asarray(elastic(forces, vehicle.tires.friction, vehicle.tires.shape))
        / vehicle.tires.slip_stiffness
    )
    slips = slips + 0.0005 * np.random.default_rng(4).standard_normal(slips.shape)
    slips[300 : 300 + lasts, :2] += 0.012
    slips[319 : 319 + lasts, 2:] += 0.012
    found = np.asarray(middle(jnp.asarray(slips), jnp.asarray(forces)))[1]
    assert (found > 0.6).all()


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
    assert lower[0] < 0.19
    assert 0.17 < found[0] < 0.29
    assert found[1] > 0.6
